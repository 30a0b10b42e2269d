"""Observations: scene points with their grey levels in two or more frames, the input of the estimators."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from ospc.arrays import ByValue, Float32Array, FloatArray, IntArray
from ospc.errors import SettingError
from ospc.numerics.robust import weighted_median
from ospc.observation_checks import check_values, whole_numbers
from ospc.photometry.grey_range import GreyRange
from ospc.settings.fit import MAX_SKEWNESS
from ospc.settings.registration import SURROUND_SIGMAS
from ospc.settings.sampling import CLIPPED_MARGIN, GREY_POWERS

MOMENTS = GREY_POWERS + 1
"""The means of the powers of the grey level, and the share of saturated pixels, whose grey level does not determine
their irradiance."""

SURROUND_MOMENTS = (len(SURROUND_SIGMAS), 1 + MOMENTS)
"""Shape of the sums of these and of 1 around a point: a row for each distance over which light is scattered."""

_WIDTHS = {"position": (2,), "frame_moments": (MOMENTS,), "surround_moments": SURROUND_MOMENTS}
"""Additional dimensions of fields with more than one."""

_SINGLE_PRECISION = ("frame_moments", "surround_moments")
"""Fields of 32-bit floats: they take most of the memory, and rounding errors of 1e-7 are below the noise."""

_OF_A_FRAME = (
    "grey",
    "grey_variance",
    "grey_third_moment",
    "position",
    "gradient",
    "frame_moments",
    "surround_moments",
    "frame",
)


class ExposureLookup(Protocol):
    """Exposures by frame number.

    They are looked up for each estimate, not when a frame is observed, so that a lag found later also applies to
    earlier observations.
    """

    def log_exposure_of(self, frames: IntArray) -> FloatArray:
        """Return ln of the exposure in milliseconds of frames, NaN if unknown, shape (n,) -> (n,)."""
        ...


@dataclass(frozen=True, eq=False)
class Observations(ByValue):
    """Grey levels of scene points; the observations of one point are consecutive.

    Attributes
    ----------
    grey
        Grey level in [0, 1], shape (n,).
    grey_variance
        Variance of the pixels averaged into the grey level, including noise, shape (n,). It is needed because for a
        nonlinear response, the mean grey level is not the grey level of the mean irradiance. Zero if unknown.
    grey_third_moment
        Third central moment of these pixels, shape (n,): coarse texture is often skewed. Zero if unknown.
    position
        Position relative to the image centre in half diagonals, shape (n, 2).
    gradient
        Magnitude of the grey gradient at the position, per pixel of the sampled image, shape (n,).
    frame_moments
        Means of M … M⁵ over the frame, and the share of saturated pixels, shape (n, 6). They give the mean
        irradiance of the frame. Zero if unknown; veiling glare is then not detected.
    surround_moments
        Sums of 1, M … M⁵ and of saturated pixels around the position, shape (n, 2, 7), with Gaussian weights whose
        standard deviations are a tenth and a quarter of the longer side; pixels outside the frame count as zero. Zero
        if unknown; scattered light and local tone mapping are then not detected.
    frame
        Number of the frame, shape (n,).
    point
        Number of the scene point, not decreasing, shape (n,).
    group
        Number of the pair of frames (for a static series of three or more frames: of the frame) that the point
        belongs to, shape (n,).
        Errors within a group may have a common cause.
    """

    grey: FloatArray
    grey_variance: FloatArray
    grey_third_moment: FloatArray
    position: FloatArray
    gradient: FloatArray
    frame_moments: Float32Array
    surround_moments: Float32Array
    frame: IntArray
    point: IntArray
    group: IntArray

    @classmethod
    def of_pairs(  # noqa: PLR0917 (the same three values of both frames)
        cls,
        grey0: npt.ArrayLike,
        grey1: npt.ArrayLike,
        position0: npt.ArrayLike,
        position1: npt.ArrayLike,
        frame0: npt.ArrayLike,
        frame1: npt.ArrayLike,
        *,
        grey_variance0: npt.ArrayLike = 0.0,
        grey_variance1: npt.ArrayLike = 0.0,
        grey_third_moment0: npt.ArrayLike = 0.0,
        grey_third_moment1: npt.ArrayLike = 0.0,
        gradient0: npt.ArrayLike = 0.0,
        gradient1: npt.ArrayLike = 0.0,
        frame_moments0: npt.ArrayLike = 0.0,
        frame_moments1: npt.ArrayLike = 0.0,
        surround_moments0: npt.ArrayLike = 0.0,
        surround_moments1: npt.ArrayLike = 0.0,
    ) -> Observations:
        """Return the observations of scene points that were each seen in two frames.

        Parameters
        ----------
        grey0, grey1
            Grey levels in [0, 1] of each point in its two frames, shape (points,). Leave out points that are clipped
            in either frame.
        position0, position1
            Positions in these frames relative to the image centre in half diagonals, shape (points, 2).
            :func:`ospc.photometry.geometry.normalised` computes them from pixel coordinates.
        frame0, frame1
            Numbers of these frames, from 0, shape (points,), or one number for all points.
        grey_variance0, grey_variance1, grey_third_moment0, grey_third_moment1, gradient0, gradient1
            As in the attributes, shape (points,) or one number. The gradient, in full scale per pixel, determines how
            much a registration error changes the grey level.
        frame_moments0, frame_moments1, surround_moments0, surround_moments1
            As in the attributes, shapes (points, 6) and (points, 2, 7), or one row for all points.

        Raises
        ------
        SettingError
            If shapes do not match or values are out of range.
        """
        n = np.size(grey0)
        if np.shape(grey0) != (n,) or np.shape(grey1) != (n,):
            raise SettingError(
                f"grey0 and grey1 must have one value per scene point, not shapes {np.shape(grey0)} and "
                f"{np.shape(grey1)}"
            )
        pixels0, pixels1 = (grey_variance0, grey_third_moment0), (grey_variance1, grey_third_moment1)
        given = (
            (grey0, *pixels0, position0, gradient0, frame_moments0, surround_moments0, frame0),
            (grey1, *pixels1, position1, gradient1, frame_moments1, surround_moments1, frame1),
        )
        first, second = (dict(zip(_OF_A_FRAME, values, strict=True)) for values in given)
        found = cls.alternating(first, second, np.zeros(n))
        pairs = found.frame.reshape(n, 2)
        group = np.unique(pairs, axis=0, return_inverse=True)[1].reshape(-1) if n else found.group
        found = replace(found, group=np.repeat(group, 2))
        found.check()
        return found

    @classmethod
    def alternating(
        cls, first: Mapping[str, npt.ArrayLike], second: Mapping[str, npt.ArrayLike], group: npt.ArrayLike
    ) -> Observations:
        """Return the observations of points seen in two frames, from the fields in the first and the second.

        A field has a value for each point or one for all; ``group`` is the pair of each, shape (points,). Only shapes
        are checked; a SettingError names a field with a wrong one.
        """
        n = np.size(first["grey"])

        def both(name: str) -> npt.NDArray[Any]:
            width = _WIDTHS.get(name, ())
            ends = np.empty((n, 2, *width), np.float32 if name in _SINGLE_PRECISION else np.float64)
            try:
                for number, end in enumerate((first, second)):
                    ends[:, number] = np.broadcast_to(np.asarray(end[name], np.float64), (n, *width))
            except (TypeError, ValueError):
                given = f"{np.shape(first[name])} and {np.shape(second[name])}"
                raise SettingError(
                    f"{name}0 and {name}1 of {n} scene points must be numbers of shape {(n, *width)}, not {given}"
                ) from None
            return ends.reshape(2 * n, *width)

        values = {name: both(name) for name in _OF_A_FRAME}
        frame = whole_numbers(values.pop("frame"))
        point, pair = np.repeat(np.arange(n), 2), np.repeat(np.asarray(group, dtype=np.int64), 2)
        return cls(**values, frame=frame, point=point, group=pair)

    def check(self) -> None:
        """Check observations from another source.

        Raises
        ------
        SettingError
            If shapes do not match, values are out of range, or a scene point has only one observation.
        """
        n, names = np.size(self.grey), [entry.name for entry in fields(Observations)]
        values = {name: getattr(self, name) for name in names}
        check_values(values, {name: (n, *_WIDTHS.get(name, ())) for name in names})
        if np.any(np.diff(self.point) < 0) or np.any(self.counts < 2):
            raise SettingError("each scene point needs two or more observations, stored consecutively")
        by_point = np.array_equal(self.group, np.repeat(self.group[self.starts], self.counts))
        if not by_point and (self.in_pairs or not self._grouped_by_frame):
            raise SettingError(
                "all observations of a scene point, or in a series of three or more frames all of a frame, need the "
                "same group"
            )

    def __len__(self) -> int:
        """Return the number of observations."""
        return len(self.grey)

    @cached_property
    def grey_skewness(self) -> FloatArray:
        """Skewness of the pixels averaged into each grey level, limited, shape (n,); 0 if unknown.

        Noise reduces it: that of little texture is chance.
        """
        cubed = self.grey_variance**1.5
        most = MAX_SKEWNESS * cubed
        return np.asarray(np.clip(self.grey_third_moment, -most, most) / np.maximum(cubed, np.finfo(np.float64).tiny))

    @property
    def radial_motion(self) -> float:
        """Radial displacement, in half diagonals, of the scene points that determine the vignette.

        The information about the vignette grows with the square of the displacement; half of it comes from points
        that move farther than this.
        """
        radius = np.linalg.norm(self.position, axis=1)
        motion = self.combined(np.maximum, radius) - self.combined(np.minimum, radius)
        return weighted_median(motion, motion**2)

    @cached_property
    def starts(self) -> IntArray:
        """Index of the first observation of each point, shape (points,)."""
        return np.flatnonzero(np.diff(self.point, prepend=self.point[:1] - 1))

    @cached_property
    def counts(self) -> IntArray:
        """Number of observations of each point, shape (points,)."""
        return np.diff(self.starts, append=len(self))

    @cached_property
    def in_pairs(self) -> bool:
        """Whether every point has two observations."""
        return bool(np.all(self.counts == 2))

    @property
    def _grouped_by_frame(self) -> bool:
        """Whether each group has the observations of one frame."""
        both = np.unique(np.stack([self.group, self.frame]), axis=1)
        return bool(both.shape[1] == len(np.unique(both[0])) == len(np.unique(both[1])))

    @cached_property
    def group_number(self) -> IntArray:
        """Number of the group of each observation, renumbered without gaps, shape (n,)."""
        return np.unique(self.group, return_inverse=True)[1]

    @cached_property
    def ends_of_groups(self) -> IntArray:
        """Indices of two observations of a point of each group, in its first and last frame, shape (groups, 2)."""
        point = np.unique(self.group_number[self.starts], return_index=True)[1]
        first = self.starts[point]
        return np.stack([first, first + self.counts[point] - 1], axis=1)

    def combined(self, combine: np.ufunc, values: FloatArray) -> FloatArray:
        """Reduce the values of each point by ``np.add`` or another ufunc, shape (n, ...) -> (points, ...)."""
        if self.in_pairs:  # ten times as fast
            return np.asarray(combine(values[0::2], values[1::2]))
        return np.asarray(combine.reduceat(values, self.starts, axis=0))

    def of_points(self: AnyObservations, chosen: Any) -> AnyObservations:
        """Return the observations of some points, by a mask, shape (points,), or by indices into :attr:`starts`."""
        mask = np.zeros(len(self.starts), bool)
        mask[chosen] = True
        return self.where(np.repeat(mask, self.counts))

    def seen_twice(self: AnyObservations, mask: Any) -> AnyObservations:
        """Return the observations where a mask, shape (n,), is true, and drop points with only one of them."""
        kept = self.where(mask)
        return kept.of_points(kept.counts >= 2)

    def where(self: AnyObservations, mask: Any) -> AnyObservations:
        """Return the observations where a mask, shape (n,), is true."""
        arrays = {f.name: value for f in fields(self) if isinstance(value := getattr(self, f.name), np.ndarray)}
        return replace(self, **{name: value[mask] for name, value in arrays.items()})

    def with_exposures(self, exposures: ExposureLookup) -> ExposedObservations:
        """Return the observations with the exposures of their frames, without those of unknown exposure."""
        frame = self.frame.astype(np.int64)  # users' frame numbers may be unsigned
        before, log_exposure, after = (exposures.log_exposure_of(frame + step) for step in (-1, 0, 1))
        own = {f.name: getattr(self, f.name) for f in fields(Observations)}
        rate = np.nan_to_num((after - before) / 2)
        found = ExposedObservations(**own, log_exposure=log_exposure, log_exposure_rate=rate)
        known = np.isfinite(log_exposure)
        return found if known.all() else found.seen_twice(known)


@dataclass(frozen=True, eq=False)
class ExposedObservations(Observations):
    """Observations with the exposures of their frames, the input of a fit.

    Attributes
    ----------
    log_exposure
        ln of the frame's exposure in milliseconds, shape (n,).
    log_exposure_rate
        Its increase per frame, from the previous to the next frame, shape (n,); 0 if one of these is unknown. It
        reveals exposures that lag by a fraction of a frame.
    error_factor
        Factor on the standard deviations that follow from the scatter of the observations; larger than 1 if many of
        them have errors in common, as in video with inter-frame compression.
    """

    log_exposure: FloatArray
    log_exposure_rate: FloatArray
    error_factor: float = 1.0

    @property
    def exposure_range_ms(self) -> tuple[float, float]:
        """Shortest and longest exposure; (inf, 0) without observations."""
        low, high = self.log_exposure.min(initial=np.inf), self.log_exposure.max(initial=-np.inf)
        return float(np.exp(low)), float(np.exp(high))

    def log_exposure_change(self, points: int = 1) -> float:
        """Change of ln exposure between the observations of a scene point that is reached by this many points."""
        if len(self.starts) < points:
            return 0.0
        highest, lowest = (self.combined(end, self.log_exposure) for end in (np.maximum, np.minimum))
        return float(np.partition(highest - lowest, -points)[-points])

    def stretched(self, grey_range: GreyRange) -> ExposedObservations:
        """Return the observations between black and white, rescaled to black at 0 and white at 1."""
        if grey_range.is_full:
            return self
        low = grey_range.black + CLIPPED_MARGIN * (grey_range.black > 0)
        high = grey_range.white - CLIPPED_MARGIN * (grey_range.white < 1)
        kept = self.seen_twice((self.grey >= low) & (self.grey <= high))
        # The matrix that converts the moments of grey levels, from the zeroth on, to those of rescaled grey levels.
        powers = np.eye(1 + MOMENTS)
        stretch = np.polynomial.Polynomial([-grey_range.black / grey_range.span, 1 / grey_range.span])
        for power in range(1 + GREY_POWERS):
            powers[: power + 1, power] = (stretch**power).coef
        known = kept.frame_moments.any(axis=1, keepdims=True).astype(np.float32)
        return replace(
            kept,
            grey=grey_range.level(kept.grey),
            grey_variance=kept.grey_variance / grey_range.span**2,
            grey_third_moment=kept.grey_third_moment / grey_range.span**3,
            gradient=kept.gradient / grey_range.span,
            frame_moments=(np.hstack([known, kept.frame_moments]) @ powers[:, 1:]).astype(np.float32),
            surround_moments=(kept.surround_moments @ powers).astype(np.float32),
        )


AnyObservations = TypeVar("AnyObservations", bound=Observations)
