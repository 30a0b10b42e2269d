"""A small, additive summary of a recording: the information of its likelihood, without a prior.

Near its maximum, a log likelihood is quadratic, -½ θᵀAθ + bᵀθ + const. The likelihoods of independent recordings
multiply, so A and b add up; the prior is added once, when the sum is solved.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from hashlib import sha256
from typing import Any

import numpy as np

from ospc.arrays import ByValue, FloatArray, ImageSize
from ospc.errors import FormatError
from ospc.estimation.fit import Fit
from ospc.estimation.fitted import Fitted
from ospc.estimation.model import Model
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.methods.exposure_ratios import unexplained_share
from ospc.methods.fit_inputs import FitInputs
from ospc.numerics.symmetric import eigh
from ospc.photometry.geometry import image_size
from ospc.photometry.grey_range import FULL_RANGE, LARGEST_GREY, GreyRange
from ospc.photometry.noise import NoiseModel
from ospc.settings.pooling import SUMMARY_RADIAL_TERMS, SUMMARY_RESPONSE_INTERVALS
from ospc.settings.vignette import MAX_VIGNETTE_REACH, MIN_USABLE_RADIUS, VIGNETTE_REACH

RESPONSE = ResponseBasis(SUMMARY_RESPONSE_INTERVALS)
VIGNETTE = VignetteBasis(SUMMARY_RADIAL_TERMS, free_centre=True, non_radial=True)
"""The models whose parameters all summaries share, whatever settings their recordings used: the richest models of the
default settings. The knots of the vignette depend on the usable radius and on their reach."""

RESPONSE_PART = slice(0, len(RESPONSE))
VIGNETTE_PART = slice(len(RESPONSE), len(RESPONSE) + len(VIGNETTE))
"""Slices of the two parts in the parameters."""

PARAMETERS = VIGNETTE_PART.stop
"""Number of parameters."""

_TRIANGLE = np.tril_indices(PARAMETERS)

_MOST, _LONGEST_MS, _FARTHEST, _LARGEST = 2**40, 1e9, 3.0, 1e15
"""Limits for values in files: counts, an exposure, a displacement in half diagonals, and other numbers. Measurements
do not come close to them, and nothing within them overflows."""

_ROUNDING = 1e-6
"""Share of the largest eigenvalue of A by which rounding may make another eigenvalue negative."""


@dataclass(frozen=True, eq=False)
class Summary(ByValue):
    """Summary of one recording.

    Attributes
    ----------
    key, name
        Identifier of the recording, equal for all runs over the same recording; name for messages.
    size, max_grey
        Width and height of the frames in pixels, and their largest grey value.
    frames, pairs, points, groups
        Number of frames pushed, pairs compared, scene points used, and groups of these.
    estimate
        Estimate of the common parameters, at which the likelihood was approximated, shape (p,).
    triangle, vector
        Lower triangle of A, row by row, and b of the approximation, shapes (p (p + 1) / 2,) and (p,), scaled to
        account for errors that samples have in common.
    systematic
        Lower triangle of A S A, shape (p (p + 1) / 2,), where S is the covariance of errors that more samples do not
        reduce: differences between parts of the recording, and effects that it cannot determine.
    exposure_range_ms
        Shortest and longest exposure.
    radial_motion
        Radial displacement, in half diagonals, of the scene points that determine the vignette.
    stationary
        Whether the camera did not move.
    support
        Lowest and highest grey level observed, without the outermost two in a thousand.
    unexplained
        Share of a typical exposure change that does not appear in the images.
    noise, grey_range
        Noise of a grey value; black and white levels, between which the grey levels of the response model lie.
    usable_radius, measured_radius
        Radius in half diagonals of the usable part of the image, in (0, 1], and distance of the last observations
        from the centre of the vignette.
    vignette_reach
        Radius of the last knot of the vignette in usable radii.
    """

    key: str
    name: str
    size: ImageSize
    max_grey: int
    frames: int
    pairs: int
    points: int
    groups: int
    estimate: FloatArray
    triangle: FloatArray
    vector: FloatArray
    systematic: FloatArray
    exposure_range_ms: tuple[float, float]
    radial_motion: float
    stationary: bool
    support: tuple[float, float]
    unexplained: float
    noise: NoiseModel
    grey_range: GreyRange = FULL_RANGE
    usable_radius: float = 1.0
    measured_radius: float = 1.0
    vignette_reach: float = VIGNETTE_REACH

    def __post_init__(self) -> None:
        p = PARAMETERS
        arrays = (self.estimate, self.vector, self.triangle, self.systematic)
        if [values.shape for values in arrays] != 2 * [(p,)] + 2 * [(p * (p + 1) // 2,)]:
            raise ValueError(f"a summary has {p} parameters")
        if not all(np.isfinite(values).all() for values in arrays):
            raise ValueError("a summary has values that are not finite")

    def check(self) -> None:
        """Check the values of a summary from a file.

        Raises
        ------
        FormatError
            If a number is out of range, or a matrix is not positive semidefinite.
        """
        image_size(*self.size)
        shortest_ms, longest_ms = self.exposure_range_ms
        low, high = self.support
        noise = (self.noise.read_variance, self.noise.shot_variance, *self.noise.table)
        counts = (self.frames, self.pairs, self.points, self.groups)
        holds = (
            0 < self.max_grey <= LARGEST_GREY
            and all(0 <= count <= _MOST for count in counts)
            and 0 < shortest_ms <= longest_ms <= _LONGEST_MS
            and 0 <= self.radial_motion <= _FARTHEST
            and 0 <= low <= high <= 1
            and 0 <= self.grey_range.black < self.grey_range.white <= 1
            and MIN_USABLE_RADIUS <= self.usable_radius <= 1
            and 0 <= self.measured_radius <= _FARTHEST
            and 1 <= self.vignette_reach <= MAX_VIGNETTE_REACH
            and abs(self.unexplained) <= _LARGEST
            and all(0 <= variance <= 1 for variance in noise)
            and len(noise) <= LARGEST_GREY
            and all(0 <= level <= 1 for level in self.noise.measured)
            and max(np.abs(self.estimate).max(), np.abs(self.vector).max(), np.abs(self.triangle).max()) <= _LARGEST
            and np.abs(self.systematic).max() <= _LARGEST**2
        )
        if not holds:
            raise FormatError("a number of a summary is out of range")
        for matrix in (self.matrix, self.systematic_matrix):
            values = np.linalg.eigvalsh(matrix)
            if values[0] < -_ROUNDING * max(values[-1], 1.0):
                raise FormatError("a matrix of a summary is not positive semidefinite")

    @property
    def matrix(self) -> FloatArray:
        """A, shape (p, p), symmetric."""
        return _full(self.triangle)

    @property
    def systematic_matrix(self) -> FloatArray:
        """A S A, shape (p, p), symmetric."""
        return _full(self.systematic)

    @property
    def observed_radius(self) -> float:
        """Distance of the last observations from the image centre, in half diagonals, at least."""
        return self.measured_radius - float(np.hypot(*VIGNETTE.centre(self.estimate[VIGNETTE_PART])))

    def with_knots(self, usable_radius: float, vignette_reach: float) -> Summary:
        """Return the summary in the parameters of the common models for another usable radius or reach of the knots.

        Its likelihood is that of the curves between the new knots.
        """
        own = replace(VIGNETTE, usable_radius=self.usable_radius, reach=self.vignette_reach)
        other = replace(VIGNETTE, usable_radius=usable_radius, reach=vignette_reach)
        if own == other:
            return self
        whole = np.eye(PARAMETERS)
        whole[VIGNETTE_PART, VIGNETTE_PART] = own.conversion(other)
        estimate = self.estimate.copy()
        estimate[VIGNETTE_PART] = other.conversion(own) @ estimate[VIGNETTE_PART]
        return replace(
            self,
            estimate=estimate,
            triangle=triangle_of(whole.T @ self.matrix @ whole),
            vector=whole.T @ self.vector,
            systematic=triangle_of(whole.T @ self.systematic_matrix @ whole),
            usable_radius=usable_radius,
            vignette_reach=vignette_reach,
        )

    @property
    def rank(self) -> tuple[int, int, str]:
        """Total order of summaries of the same recording; the largest is kept."""
        return self.frames, self.points, sha256(self.vector.tobytes() + self.triangle.tobytes()).hexdigest()


def summary_of(inputs: FitInputs, first_frames: str, source: dict[str, Any], frames: int) -> Summary | None:
    """Return the summary of a run of this many frames; None if it allowed no fit.

    ``source`` identifies the recording. It is empty for a live stream, which is identified by the hash of its first
    frames.
    """
    if inputs.fitted is None:
        return None
    fit, observations = inputs.fitted.fit, inputs.fitted.observations
    matrix, vector, systematic, estimate = _information(inputs.fitted)
    return Summary(
        key=recording_key(first_frames, source),
        name=str(source.get("name", "live")),
        size=inputs.size,
        max_grey=inputs.max_grey,
        frames=frames,
        pairs=inputs.pairs,
        points=fit.points,
        groups=fit.groups,
        estimate=estimate,
        triangle=triangle_of(matrix),
        vector=vector,
        systematic=triangle_of(systematic),
        exposure_range_ms=observations.exposure_range_ms,
        radial_motion=inputs.radial_motion,
        stationary=inputs.stationary,
        support=inputs.support,
        grey_range=inputs.grey_range,
        unexplained=unexplained_share(inputs.ratios),
        noise=inputs.noise,
        usable_radius=fit.vignette_basis.usable_radius,
        measured_radius=fit.measured_radius,
        vignette_reach=fit.vignette_basis.reach,
    )


def triangle_of(matrix: FloatArray) -> FloatArray:
    """Return the lower triangle of a matrix, symmetric up to rounding, shape (p, p) -> (p (p + 1) / 2,)."""
    return np.asarray(((matrix + matrix.T) / 2)[_TRIANGLE])


def _full(triangle: FloatArray) -> FloatArray:
    full = np.zeros((PARAMETERS, PARAMETERS))
    full[_TRIANGLE] = triangle
    return np.asarray(full + np.tril(full, -1).T)


def joint_range(ranges: Iterable[tuple[float, float]]) -> tuple[float, float]:
    """Return the smallest range that includes all ranges."""
    lows, highs = zip(*ranges, strict=True)
    return min(lows), max(highs)


def recording_key(first_frames: str, source: dict[str, Any]) -> str:
    """Return a key for a recording from the hashes in its source, or from its first frames if there are none.

    It does not depend on exposures and masks: a recording with others is still the same and must count once.
    """
    hashes = ("scene_sha256",) if "scene_sha256" in source else ("frames_sha256", "images_sha256")
    content = {name: source[name] for name in hashes if name in source}
    return sha256(json.dumps(content or first_frames, sort_keys=True).encode()).hexdigest()[:32]


def _information(fitted: Fitted) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return A, b, A S A and the estimate, all in the common parameters."""
    fit = fitted.fit
    vignette = replace(VIGNETTE, usable_radius=fit.vignette_basis.usable_radius, reach=fit.vignette_basis.reach)
    in_common = _in_common(fit, vignette)
    estimate = in_common @ fit.parameters[: fit.vignette_part.stop]
    model = Model(RESPONSE, vignette, fit.effects)
    equations = fitted.information(model, np.concatenate([estimate, fit.effect_parameters]))
    equations = equations.without_last(np.diag(1 / fit.effects.sigma**2))
    matrix = equations.information_scale * equations.matrix
    systematic = matrix @ in_common @ _systematic_errors(fit)
    return matrix, equations.information_scale * equations.vector, systematic @ systematic.T, estimate


def _systematic_errors(fit: Fit) -> FloatArray:
    """Return a square root of the covariance of errors that more samples do not reduce, shape (q, q)."""
    curves = fit.vignette_part.stop
    variance, directions = eigh(fit.covariance[:curves, :curves] - fit.chance[:curves, :curves])
    return np.asarray(directions * np.sqrt(np.maximum(variance, 0.0)))


def _in_common(fit: Fit, vignette: VignetteBasis) -> FloatArray:
    """Return the matrix that converts the q parameters of a fit's curves to the common models, shape (p, q)."""
    n = len(fit.response_basis)
    matrix = np.zeros((PARAMETERS, fit.vignette_part.stop))
    matrix[RESPONSE_PART, :n] = RESPONSE.conversion(fit.response_basis)
    matrix[VIGNETTE_PART, n:] = vignette.conversion(fit.vignette_basis)
    return matrix
