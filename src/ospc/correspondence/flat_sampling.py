"""Sampling of the same scene points in two frames, where the image is flat."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache

import numpy as np
import numpy.typing as npt

from ospc.arrays import BoolArray, Float32Array, FloatArray, ImageSize, IntArray, read_only
from ospc.correspondence.equal_smoothing import (
    CENTRE,
    NODES,
    further_smoothing,
    interpolation_smoothing,
    node_sums,
    node_weights,
)
from ospc.correspondence.preprocessing import PreprocessedFrame, ReducedFrame
from ospc.correspondence.registration import Registration, displacement_at, jacobian_at
from ospc.observations import Observations
from ospc.photometry.geometry import normalised
from ospc.settings import DefaultSettings
from ospc.settings.registration import MIN_OVERLAP
from ospc.settings.sampling import (
    MIN_MOTION_PLACES,
    MIN_PART_PLACES,
    MOTION_PARTS_PER_SIDE,
    NODES_PER_SIDE,
    SAMPLING_GREY_CELLS,
    SAMPLING_MARGIN_PX,
    SAMPLING_RADIUS_CELLS,
    STRUCTURE_QUANTILE,
)


@dataclass(frozen=True)
class Keyframe(ReducedFrame):
    """The data of a frame kept for comparison with later frames: a tenth of the preprocessed frame."""

    gradient: Float32Array
    """The frame's gradient at the grid points, shape (n,)."""
    flat: IntArray
    """Indices of the grid points that are flat and not clipped, shape (m,)."""
    grey: Float32Array
    squares: Float32Array
    cubes: Float32Array
    """Sums of smoothed grey levels, squares and cubes at the nodes around these, shape (m, 10)."""


@dataclass(frozen=True)
class Samples:
    """The result of comparing two frames."""

    observations: Observations
    """Two observations for each scene point."""
    overlap: float
    """Share of the grid points on the scene that were matched; 0 if the overlap is too small."""
    radial_motion: float
    """Root mean square of R₀ − R₁ over the matched points."""
    motion_px: float
    """Median displacement in pixels of the frame, at points with enough structure; NaN if there are none."""


NOTHING_FOUND = Samples(
    Observations.of_pairs([], [], np.empty((0, 2)), np.empty((0, 2)), 0, 0),
    overlap=0.0,
    radial_motion=0.0,
    motion_px=float("nan"),
)
"""The result for two views with too little overlap."""


@dataclass(frozen=True)
class FlatSampler:
    """Selects grid points that are flat in both frames, and samples smoothed grey values there.

    Any registration is wrong by a fraction of a pixel, which is harmless in flat regions. Corners would bias the
    result: they are extremes of the grey value, and any error leads to a less extreme value.

    Flat points, too, are often extremes, and the mean over a larger area is less extreme. A pinhole camera magnifies
    objects that move towards the border, and an approaching floor grows more in depth than in width. Grey levels are
    therefore averaged over the same part of the scene: along each direction, the view with the larger scale is
    smoothed correspondingly more.
    """

    settings: DefaultSettings
    """Spacing of the grid, limits of the gradient and of the registration error, and points per pair."""

    def keyframe(self, frame: PreprocessedFrame) -> Keyframe:
        """Return the keyframe of a frame: its small images, and its values on the grid."""
        places = _grid(frame.reduced_size, self.settings.grid_spacing_px)
        flat = np.flatnonzero(self._is_flat(frame, places))
        return Keyframe(
            **{field.name: getattr(frame, field.name) for field in fields(ReducedFrame)},
            gradient=frame.values_at(frame.gradient, places).astype(np.float32),
            flat=flat,
            grey=_sums_around(frame.grey, places[flat]),
            squares=_sums_around(frame.squares, places[flat]),
            cubes=_sums_around(frame.cubes, places[flat]),
        )

    def __call__(
        self, keyframe: Keyframe, frame: PreprocessedFrame, registration: Registration | None, group: int
    ) -> Samples:
        """Compare a keyframe with a frame; ``group`` is the number of the pair."""
        if registration is None:
            return NOTHING_FOUND
        places0 = _grid(keyframe.reduced_size, self.settings.grid_spacing_px)
        scale = keyframe.further_reduction
        displacement, forward_backward_error = displacement_at(registration, places0, scale)
        places1 = places0 + displacement
        far = np.array(frame.reduced_size) - 1 - SAMPLING_MARGIN_PX
        inside = np.all((places1 >= SAMPLING_MARGIN_PX) & (places1 <= far), axis=1)
        seen = keyframe.shows_scene(places0)
        found = (forward_backward_error < self.settings.max_forward_backward_error_px) & inside
        found &= seen & frame.shows_scene(places1)
        overlap = float(found[seen].mean()) if seen.any() else 0.0
        if overlap < MIN_OVERLAP:
            return NOTHING_FOUND
        row = np.flatnonzero(found[keyframe.flat])
        row = row[self._is_flat(frame, places1[keyframe.flat[row]])]
        index = keyframe.flat[row]
        position0, position1 = (
            normalised(one.to_frame(places), one.size) for one, places in ((keyframe, places0), (frame, places1))
        )
        radius0, radius1 = (np.linalg.norm(position, axis=1) for position in (position0, position1))
        radial = (radius0 - radius1)[found]
        motion = _typical_motion(places0[found], displacement[found], keyframe.gradient[found].astype(np.float64))
        # Select by the mean of both frames: a selection by one grey level would depend on its noise.
        grey = np.sqrt(np.clip(keyframe.grey[row, CENTRE] * frame.values_at(frame.grey, places1[index]), 0, 1))
        row = row[self._spread(grey, radius0[index], group)]
        chosen = keyframe.flat[row]
        places0, places1 = places0[chosen], places1[chosen]
        jacobian = jacobian_at(registration, places0, scale)
        # The points of the keyframe are at pixels.
        further0, further1 = further_smoothing(jacobian, frame.smoothing_px, interpolation_smoothing(places1))
        nodes1 = places1[:, None] + NODES
        sums0 = (sums[row] for sums in (keyframe.grey, keyframe.squares, keyframe.cubes))
        sums1 = (node_sums(frame.values_at(image, nodes1)) for image in (frame.grey, frame.squares, frame.cubes))
        smoothed0, smoothed1 = _moments(further0, *sums0), _moments(further1, *sums1)
        observations = Observations.alternating(
            _seen(keyframe, places0, position0[chosen], keyframe.gradient[chosen], smoothed0),
            _seen(frame, places1, position1[chosen], frame.values_at(frame.gradient, places1), smoothed1),
            np.full(len(chosen), group),
        )
        radial_motion = float(np.sqrt(np.mean(radial**2)))
        return Samples(observations, overlap, radial_motion, motion * keyframe.reduction)

    def _is_flat(self, frame: PreprocessedFrame, places: FloatArray) -> BoolArray:
        """Return where a frame is flat and not clipped, (n, 2) -> (n,)."""
        flat = frame.values_at(frame.gradient, places) < self.settings.max_gradient
        flat[flat] = ~_clipped_at(frame, places[flat])
        return flat

    def _spread(self, grey: FloatArray, radius: FloatArray, seed: int) -> IntArray:
        """Return the indices of some points, spread evenly over cells of grey level and radius."""
        n, most = len(grey), self.settings.points_per_pair
        if n <= most:
            return np.arange(n)
        grey_cell = np.minimum((np.sqrt(grey) * SAMPLING_GREY_CELLS).astype(int), SAMPLING_GREY_CELLS - 1)
        radius_cell = np.minimum((radius * SAMPLING_RADIUS_CELLS).astype(int), SAMPLING_RADIUS_CELLS - 1)
        cell = grey_cell * SAMPLING_RADIUS_CELLS + radius_cell
        random = np.random.default_rng(seed).random(n)
        rank = ranks_in_cells(cell, np.argsort(cell + random))
        return np.sort(np.argpartition(rank + random, most)[:most])


@cache
def _grid(size: ImageSize, spacing_px: int) -> FloatArray:
    """Return the grid points (x, y) of an image, with a spacing, shape (n, 2)."""
    margin = SAMPLING_MARGIN_PX
    x, y = np.meshgrid(*(np.arange(margin, side - margin, spacing_px, dtype=np.float64) for side in size))
    return read_only(np.stack([x.ravel(), y.ravel()], axis=1))


def _sums_around(image: Float32Array, places: FloatArray) -> Float32Array:
    """Return the sums of an image's values at the nodes around pixels, (h, w) and (n, 2) -> (n, 10)."""
    around = np.lib.stride_tricks.sliding_window_view(image, (NODES_PER_SIDE, NODES_PER_SIDE))
    x, y = (places + NODES[0]).T.astype(np.int64)
    return node_sums(around[y, x].reshape(-1, len(NODES))).astype(np.float32)


def ranks_in_cells(cell: IntArray, order: IntArray) -> IntArray:
    """Return the rank of each point in its cell, shape (n,).

    ``order`` sorts the points by their cell, and within it as they are ranked. The points of the lowest ranks are one
    of each cell, then a second one of each, and so on.
    """
    count = np.bincount(cell)
    rank = np.empty(len(cell), np.int64)
    rank[order] = np.arange(len(cell)) - np.repeat(np.cumsum(count) - count, count)
    return rank


def _typical_motion(places: FloatArray, displacement: FloatArray, gradient: FloatArray) -> float:
    """Return the median displacement over image tiles, at points with structure; NaN if there are none."""
    if len(places) < MIN_MOTION_PLACES:
        return float("nan")
    structured = gradient >= np.quantile(gradient, STRUCTURE_QUANTILE)
    places, displacement = places[structured], displacement[structured]
    parts = MOTION_PARTS_PER_SIDE
    part = np.floor(parts * places / (places.max(axis=0) + 1)).astype(np.int64) @ [parts, 1]
    number = np.bincount(part, minlength=parts**2)
    sums = np.stack([np.bincount(part, displacement[:, i], minlength=len(number)) for i in (0, 1)], axis=1)
    known = number >= MIN_PART_PLACES
    if not known.any():
        return float("nan")
    return float(np.median(np.linalg.norm(sums[known] / number[known, None], axis=1)))


def _seen(
    view: ReducedFrame,
    places: FloatArray,
    position: FloatArray,
    gradient: FloatArray | Float32Array,
    moments: tuple[FloatArray, FloatArray, FloatArray],
) -> dict[str, npt.ArrayLike]:
    """Return the fields of the observations at some places in one view, given the moments of the pixels there."""
    return {
        "grey": moments[0],
        "grey_variance": moments[1],
        "grey_third_moment": moments[2],
        "position": position,
        "gradient": gradient,
        "frame_moments": view.moments,
        "surround_moments": np.stack([view.values_at(moments, places) for moments in view.surround_moments], axis=1),
        "frame": view.number,
    }


def _clipped_at(frame: PreprocessedFrame, places: FloatArray) -> BoolArray:
    """Return whether any of the pixels interpolated at each point is clipped, shape (n,)."""
    return frame.values_at(frame.clipped.view(np.uint8) * np.uint8(255), places) > 0


def _moments(
    further: FloatArray,
    grey: FloatArray | Float32Array,
    squares: FloatArray | Float32Array,
    cubes: FloatArray | Float32Array,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean, variance and third central moment of the pixels after additional smoothing, shape (n,) each."""
    weights = node_weights(further)
    mean, square, cube = (np.sum(weights * sums, axis=1) for sums in (grey, squares, cubes))
    variance, third = square - mean**2, cube - 3 * mean * square + 2 * mean**3
    return np.clip(mean, 0.0, 1.0), np.clip(variance, 0.0, 1.0), np.clip(third, -1.0, 1.0)
