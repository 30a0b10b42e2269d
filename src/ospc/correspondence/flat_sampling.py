"""Grey values of the same scene points in two frames, read where the image is flat."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from ospc.arrays import BoolArray, Float32Array, FloatArray, ImageSize, IntArray
from ospc.correspondence.preprocessing import PreprocessedFrame, ReducedFrame
from ospc.correspondence.registration import Registration, displacement_at
from ospc.correspondence.thumbnail_registration import MIN_OVERLAP
from ospc.observations import Observations
from ospc.photometry.geometry import normalised

_GREY_CELLS, _RADIUS_CELLS = 8, 4
"""Ranges of the root of grey level and of radius from which scene points are taken in turn where there are too many:
otherwise the sky or a wall would make up most of them."""

_MIN_MOTION_PLACES = 100
"""Fewest places found again from which the motion is measured."""

_STRUCTURE_QUANTILE = 0.8
"""Quantile of the gradient above which a place shows motion: registration fills in flat ones from their
surroundings."""

_PARTS_PER_SIDE = 4
"""Parts of the image, along each side, within which displacements are averaged as vectors, so that noise cancels."""

_MIN_PART_PLACES = 8
"""Fewest places of such a part: with fewer, noise does not cancel, and a camera that stands still seems to move."""


@dataclass(frozen=True)
class Keyframe(ReducedFrame):
    """A frame that later ones are compared with, as far as they need it: with a tenth of the memory.

    Attributes
    ----------
    places
        Places (x, y) of the grid on which scene points are chosen, in reduced pixels, shape (n, 2).
    grey, variance, gradient, clipped
        The values of the frame there, shape (n,).
    """

    places: FloatArray
    grey: Float32Array
    variance: Float32Array
    gradient: Float32Array
    clipped: BoolArray


@dataclass(frozen=True)
class Samples:
    """What comparing two frames gave.

    Attributes
    ----------
    observations
        Two observations for each scene point.
    overlap
        Share of the places on the grid that the registration found again; 0 where the views have too little in
        common.
    radial_motion
        Root mean square of R₀ − R₁ of the places found again.
    motion_px
        Median displacement in pixels of the frame, at places with enough structure; NaN where there are none.
    """

    observations: Observations
    overlap: float
    radial_motion: float
    motion_px: float


NOTHING_FOUND = Samples(
    Observations.of_pairs([], [], np.empty((0, 2)), np.empty((0, 2)), 0, 0),
    overlap=0.0,
    radial_motion=0.0,
    motion_px=float("nan"),
)
"""What comparing two views gives that have too little in common."""


@dataclass(frozen=True)
class FlatSampler:
    """Chooses places on a grid that are flat in both frames, and reads smoothed grey values there.

    Any registration is wrong by a fraction of a pixel; where the image is flat that does no harm. Corners would bias
    the result: they are extreme grey values, and any error leads to a less extreme one.

    Attributes
    ----------
    spacing_px
        Distance between the places of the grid, in reduced pixels.
    margin_px
        Places nearer to the border are not used.
    max_gradient
        Largest grey gradient, in full scale per reduced pixel, of a flat place.
    max_forward_backward_error_px
        Largest distance between a place and where going there and back ends, in reduced pixels.
    max_points
        Most scene points taken from one pair, spread evenly over mean grey level and radius.
    """

    spacing_px: int = 8
    margin_px: int = 8
    max_gradient: float = 0.006
    max_forward_backward_error_px: float = 2.0
    max_points: int = 400

    def keyframe(self, frame: PreprocessedFrame) -> Keyframe:
        """Return what later frames need of a frame: its small images, and its values on the grid."""
        width, height = frame.reduced_size
        columns, rows = (slice(self.margin_px, side - self.margin_px, self.spacing_px) for side in (width, height))
        return Keyframe(
            frame.number,
            frame.size,
            frame.reduction,
            frame.small,
            frame.thumbnail,
            _grid((width, height), self.spacing_px, self.margin_px),
            frame.grey[rows, columns].ravel(),
            frame.variance[rows, columns].ravel(),
            frame.gradient[rows, columns].ravel(),
            frame.clipped[rows, columns].ravel(),
        )

    def __call__(
        self, keyframe: Keyframe, frame: PreprocessedFrame, registration: Registration, group: int
    ) -> Samples:
        """Compare two frames.

        Parameters
        ----------
        keyframe
            The first, as :meth:`keyframe` returns it.
        frame
            The second.
        registration
            Displacements from the first to the second.
        group
            Number of the pair.
        """
        places0 = keyframe.places
        scale = keyframe.reduced_size[0] / registration.forward.shape[1]
        displacement, forward_backward_error = displacement_at(registration, places0, scale)
        places1 = places0 + displacement
        found = (forward_backward_error < self.max_forward_backward_error_px) & self._inside(frame, places1)
        if not found.size or found.mean() < MIN_OVERLAP:
            return NOTHING_FOUND
        gradient0 = keyframe.gradient.astype(np.float64)
        flat = found & (gradient0 < self.max_gradient) & ~keyframe.clipped & self._usable(frame, places1)
        position0, position1 = (
            normalised(one.to_frame(places), one.size) for one, places in ((keyframe, places0), (frame, places1))
        )
        radial = np.linalg.norm(position0[found], axis=1) - np.linalg.norm(position1[found], axis=1)
        motion = _typical_motion(places0[found], displacement[found], gradient0[found])
        index = np.flatnonzero(flat)
        # By the mean of both frames: a choice by one grey level would be a choice by its noise.
        grey = np.sqrt(np.clip(keyframe.grey[index] * _at(frame.grey, places1[index]), 0, 1))
        chosen = index[self._spread(grey, np.linalg.norm(position0[index], axis=1), group)]
        first = _End.of_keyframe(keyframe, chosen, position0[chosen])
        second = _End.of_frame(frame, places1[chosen], position1[chosen])
        return Samples(
            _interleaved((first, second), group),
            float(found.mean()),
            float(np.sqrt(np.mean(radial**2))),
            motion * keyframe.reduction,
        )

    def _inside(self, frame: PreprocessedFrame, places: FloatArray) -> BoolArray:
        far = np.array(frame.reduced_size) - 1 - self.margin_px
        return np.asarray(np.all((places >= self.margin_px) & (places <= far), axis=1))

    def _usable(self, frame: PreprocessedFrame, places: FloatArray) -> BoolArray:
        clipped = _at(frame.clipped.view(np.uint8).astype(np.float32), places)
        return np.asarray((_at(frame.gradient, places) < self.max_gradient) & (clipped == 0))

    def _spread(self, grey: FloatArray, radius: FloatArray, seed: int) -> IntArray:
        """Return which places to take: as many as allowed, evenly over cells of grey level and radius."""
        n = len(grey)
        if n <= self.max_points:
            return np.arange(n)
        grey_cell = np.minimum((np.sqrt(grey) * _GREY_CELLS).astype(int), _GREY_CELLS - 1)
        radius_cell = np.minimum((radius * _RADIUS_CELLS).astype(int), _RADIUS_CELLS - 1)
        cell = grey_cell * _RADIUS_CELLS + radius_cell
        random = np.random.default_rng(seed).random(n)
        # First one of each cell, then a second one of each, and so on.
        order = np.argsort(cell + random)
        count = np.bincount(cell)
        rank = np.empty(n)
        rank[order] = np.arange(n) - np.repeat(np.cumsum(count) - count, count)
        return np.sort(np.argpartition(rank + random, self.max_points)[: self.max_points])


@cache
def _grid(size: ImageSize, spacing_px: int, margin_px: int) -> FloatArray:
    """Return the places (x, y) of an image, so far apart and away from the border, shape (n, 2)."""
    x, y = np.meshgrid(*(np.arange(margin_px, side - margin_px, spacing_px, dtype=np.float64) for side in size))
    places = np.stack([x.ravel(), y.ravel()], axis=1)
    places.setflags(write=False)
    return places


def _typical_motion(places: FloatArray, displacement: FloatArray, gradient: FloatArray) -> float:
    """Return the median displacement over parts of the image, at places with structure; NaN where there are none."""
    if len(places) < _MIN_MOTION_PLACES:
        return float("nan")
    structured = gradient >= np.quantile(gradient, _STRUCTURE_QUANTILE)
    places, displacement = places[structured], displacement[structured]
    part = np.floor(_PARTS_PER_SIDE * places / (places.max(axis=0) + 1)).astype(np.int64) @ [_PARTS_PER_SIDE, 1]
    number = np.bincount(part, minlength=_PARTS_PER_SIDE**2)
    sums = np.stack([np.bincount(part, displacement[:, i], minlength=len(number)) for i in (0, 1)], axis=1)
    known = number >= _MIN_PART_PLACES
    if not known.any():
        return float("nan")
    return float(np.median(np.linalg.norm(sums[known] / number[known, None], axis=1)))


def _at(image: Float32Array, places: FloatArray) -> FloatArray:
    flat = np.ascontiguousarray(places, dtype=np.float32).reshape(-1, 1, 2)
    if len(flat) == 0:
        return np.empty(0)
    values = cv2.remap(image, flat, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values, dtype=np.float64).reshape(-1)


@dataclass(frozen=True)
class _End:
    """What one of the two frames shows of n scene points; arrays of shape (n,) or (n, columns)."""

    frame: ReducedFrame
    grey: FloatArray
    variance: FloatArray
    gradient: FloatArray
    position: FloatArray
    surround_moments: FloatArray

    @classmethod
    def of_keyframe(cls, keyframe: Keyframe, chosen: IntArray, position: FloatArray) -> _End:
        values = (keyframe.grey, keyframe.variance, keyframe.gradient)
        grey, variance, gradient = (value[chosen].astype(np.float64) for value in values)
        surround_moments = _surroundings(keyframe, keyframe.places[chosen])
        return cls(keyframe, grey, variance, gradient, position, surround_moments)

    @classmethod
    def of_frame(cls, frame: PreprocessedFrame, places: FloatArray, position: FloatArray) -> _End:
        grey, variance, gradient = (_at(image, places) for image in (frame.grey, frame.variance, frame.gradient))
        return cls(frame, grey, variance, gradient, position, _surroundings(frame, places))


def _surroundings(frame: ReducedFrame, places: FloatArray) -> FloatArray:
    """Return the moments around places in the reduced size, shape (n, 4)."""
    coarse = frame.surround_moments
    scale = np.array(coarse.shape[1::-1]) / np.array(frame.reduced_size)
    there = (places + 0.5) * scale - 0.5
    return np.stack([_at(np.ascontiguousarray(moment), there) for moment in np.moveaxis(coarse, -1, 0)], axis=1)


def _interleaved(ends: tuple[_End, _End], group: int) -> Observations:
    """Return the two observations of each point one after the other."""
    n = len(ends[0].grey)

    def alternate(columns: list[FloatArray]) -> FloatArray:
        return np.stack(columns, axis=1).reshape(2 * n, *columns[0].shape[1:])

    return Observations(
        grey=alternate([end.grey for end in ends]),
        grey_variance=alternate([end.variance for end in ends]),
        position=alternate([end.position for end in ends]),
        gradient=alternate([end.gradient for end in ends]),
        frame_moments=np.tile([end.frame.moments for end in ends], (n, 1)),
        surround_moments=alternate([end.surround_moments for end in ends]),
        frame=np.tile([end.frame.number for end in ends], n).astype(np.int64),
        point=np.repeat(np.arange(n), 2),
        group=np.full(2 * n, group, np.int64),
    )
