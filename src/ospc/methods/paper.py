"""The paper's method, in the order of its section 3: tracking, response, vignette, exposure.

The paper is "OSPC: Online Sequential Photometric Calibration" (Haidar, Khalil and Asmar, Pattern Recognition Letters
181, 2024). Its subscripts 1 and 2 are 0 and 1 here. M is a grey level in [0, 1], g = f⁻¹ the inverse response, V the
vignette, R the distance from the image centre (1 at the corner), and k = e₀/e₁ the exposure ratio of two frames. "The
released program" is the authors' own implementation, which differs from the paper in a few details.
"""

from __future__ import annotations

import copy
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, Self

import numpy as np
from numpy.polynomial.polynomial import polyval

from ospc.arrays import BoolArray, FloatArray, ImageSize
from ospc.correspondence.features import EXTRACTORS, Features, extract, match
from ospc.correspondence.preprocessing import PreprocessedFrame
from ospc.errors import counted
from ospc.exposures.table import range_in_words
from ospc.methods.change_detection import Change
from ospc.methods.method import Method, Progress, check_can_be_matched
from ospc.numerics.least_squares import non_negative_least_squares
from ospc.numerics.robust import huber_weights, robust_scale
from ospc.numerics.symmetric import eigh
from ospc.observations import ExposureLookup
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.coverage import ExposureRatios
from ospc.photometry.geometry import normalised
from ospc.photometry.grey_range import FULL_RANGE, GreyRange
from ospc.photometry.response import Response
from ospc.photometry.verdict import Verdict
from ospc.photometry.vignette import PolynomialVignette, Vignette
from ospc.recording.frame import Frame
from ospc.settings import PaperSettings
from ospc.settings.methods import (
    CONSTRAINT_WEIGHT,
    MAX_VIGNETTE_ROUNDS,
    MIN_POLYNOMIAL_IRRADIANCE,
    MONOTONICITY_LEVELS,
    RADIAL_MOTION_QUANTILE,
    VIGNETTE_TOLERANCE,
    ZERO_RESIDUAL,
)

# Section 3.1: tracking.


@dataclass(frozen=True)
class Correspondences:
    """n scene points seen in two frames."""

    frames: tuple[int, int]
    """Numbers of the two frames."""
    size: ImageSize
    """Width and height of the frames in pixels."""
    points0: FloatArray
    points1: FloatArray
    """Pixel coordinates (x, y) in the two frames, shape (n, 2)."""
    grey0: FloatArray
    grey1: FloatArray
    """Grey levels in [0, 1], shape (n,)."""

    def __len__(self) -> int:
        """Return the number of scene points."""
        return len(self.grey0)

    def select(self, mask: BoolArray) -> Self:
        """Return the correspondences for which the mask, shape (n,), is true."""
        kept = {name: getattr(self, name)[mask] for name in ("points0", "points1", "grey0", "grey1")}
        return replace(self, **kept)

    @property
    def radius0(self) -> FloatArray:
        """R₀, shape (n,)."""
        return np.asarray(np.linalg.norm(normalised(self.points0, self.size), axis=-1))

    @property
    def radius1(self) -> FloatArray:
        """R₁, shape (n,)."""
        return np.asarray(np.linalg.norm(normalised(self.points1, self.size), axis=-1))

    @property
    def radial_displacement(self) -> FloatArray:
        """|R₀ − R₁|, shape (n,)."""
        return np.abs(self.radius0 - self.radius1)


def follows_its_block(
    points0: FloatArray, points1: FloatArray, size: ImageSize, settings: PaperSettings
) -> BoolArray:
    """Return which matches move in the same direction as most others nearby.

    Displacements longer than the mean plus some standard deviations are rejected. The image is then divided into
    blocks; in each block with enough matches, only the fullest bin of the histogram of directions is kept. The bins
    are centred on the block's mean direction, because fixed bins would split motion along a bin's edge. Points have
    shape (n, 2), in pixels; the mask has shape (n,).
    """
    displacement = points1 - points0
    length = np.linalg.norm(displacement, axis=1)
    if not len(length):
        return np.zeros(0, dtype=np.bool_)
    # The last term allows for rounding: equal displacements are all kept.
    longest = length.mean() + settings.filter_length_sigmas * length.std() + 1e-9 * length.max()
    kept = np.flatnonzero(length <= longest)
    unit = displacement[kept] / np.where(length > 0, length, 1)[kept, None]
    blocks, bins = settings.filter_blocks, settings.filter_bins
    column, row = np.clip((points0[kept] / np.array(size) * blocks).astype(np.int64), 0, blocks - 1).T
    block = row * blocks + column
    mean_x, mean_y = (np.bincount(block, unit[:, axis], minlength=blocks**2)[block] for axis in (0, 1))
    # The angle to the block's mean direction comes from its sine and cosine, so that ±180° is no special case.
    angle = np.arctan2(mean_x * unit[:, 1] - mean_y * unit[:, 0], mean_x * unit[:, 0] + mean_y * unit[:, 1])
    direction = np.floor(angle / (2 * np.pi / bins) + 0.5).astype(np.int64) % bins
    histogram = np.zeros((blocks**2, bins), np.int64)
    np.add.at(histogram, (block, direction), 1)
    crowded = histogram.sum(axis=1)[block] > settings.filter_min_matches
    survives = np.zeros(len(length), dtype=np.bool_)
    survives[kept] = ~crowded | (direction == histogram.argmax(axis=1)[block])
    return survives


class Matcher(Protocol):
    """Extracts and matches features, the slowest step of the method; variants of the method may share a matcher."""

    def features(self, frame: Frame) -> Features:
        """Return the features of a frame; raises :class:`FrameError` if its image cannot be read."""

    def correspondences(self, left: Features, right: Features, size: ImageSize) -> Correspondences:
        """Return the matches of two frames of a size in pixels."""


class FeatureMatcher:
    """Matches features by their descriptors, with Lowe's ratio test, and filters the matches by direction."""

    def __init__(self, settings: PaperSettings) -> None:
        self._settings = settings
        self._extractor = EXTRACTORS[settings.features](settings.max_features)

    def features(self, frame: Frame) -> Features:
        """Return the features of a frame."""
        return extract(frame, self._extractor)

    def correspondences(self, left: Features, right: Features, size: ImageSize) -> Correspondences:
        """Return the filtered matches of two frames."""
        index0, index1 = match(left, right, self._extractor.norm, self._settings.match_ratio)
        points, grey = (left.points[index0], right.points[index1]), (left.grey[index0], right.grey[index1])
        found = Correspondences((left.frame, right.frame), size, *points, *grey)
        return found.select(follows_its_block(*points, size, self._settings))


# Section 3.2, response.


def exposure_ratio(pairs: Correspondences, exposures: ExposureLookup) -> float:
    """Return k = e₀/e₁ of the two frames, as currently known."""
    log_exposure = exposures.log_exposure_of(np.array(pairs.frames))
    return float(np.exp(log_exposure[0] - log_exposure[1]))


def in_order(pairs: Correspondences, ratio: float) -> Correspondences:
    """Return the matches that are brighter at the larger exposure, as an increasing response requires."""
    return pairs.select((pairs.grey0 - pairs.grey1) * (ratio - 1) > 0)


def response_rows(pairs: Correspondences, ratio: float, degree: int = 2) -> FloatArray:
    """Return the rows [1−k, M₀−kM₁, …, M₀ᵈ−kM₁ᵈ] of A in A c = 0, shape (n, degree + 1) (eq. matrix_form)."""
    powers = np.arange(degree + 1)
    return np.asarray(pairs.grey0[:, None] ** powers - ratio * pairs.grey1[:, None] ** powers)


def solve_kkt(gram: FloatArray) -> FloatArray:
    """Minimise ‖Ac‖² subject to Σc = 1 and c₀ = 0 with the pseudo-inverse of the KKT system (eq. final_form).

    AᵀA has shape (d+1, d+1), the coefficients c₀ … c_d (d+1,).
    """
    n = len(gram)
    E = np.stack([np.ones(n), np.eye(n)[0]])
    system = np.block([[2 * _scaled(gram), E.T], [E, np.zeros((2, 2))]])
    target = np.append(np.zeros(n), [1.0, 0.0])
    return np.asarray(np.linalg.pinv(system, hermitian=True) @ target)[:n]


def solve_nonnegative(gram: FloatArray) -> FloatArray:
    """Minimise ‖Ac‖² subject to Σc = 1, c₀ = 0 and c ≥ 0, as the released program does; see :func:`solve_kkt`."""
    n = len(gram)
    scale, vectors = eigh(_scaled(gram))
    root = np.sqrt(np.clip(scale, 0, None))[:, None] * vectors.T
    # One row enforces Σc = 1, with a weight far above that of all others, whose squares add up to one. The remaining
    # error is divided out.
    rows = np.vstack([root[:, 1:], np.full((1, n - 1), CONSTRAINT_WEIGHT)])
    solution = non_negative_least_squares(rows, np.append(np.zeros(n), CONSTRAINT_WEIGHT))
    return np.concatenate([[0.0], solution / solution.sum()])


def _scaled(gram: FloatArray) -> FloatArray:
    """Return the Gram matrix with a trace of one, which makes the constraints independent of the sample count."""
    return np.asarray(gram / max(float(np.trace(gram)), float(np.finfo(float).tiny)))


def increases(coefficients: FloatArray) -> bool:
    """Return whether a polynomial increases strictly between levels of [0, 1]."""
    return bool(np.all(np.diff(polyval(np.linspace(0, 1, MONOTONICITY_LEVELS), coefficients)) > 0))


def solve_response(gram: FloatArray, positivity: str) -> FloatArray | None:
    """Return the coefficients of g; None if the solution does not increase and is therefore not a response.

    c ≥ 0 is enforced "never", "always", or "when needed", that is, if the solution does not increase.
    """
    coefficients = solve_nonnegative(gram) if positivity == "always" else solve_kkt(gram)
    if positivity == "when needed" and not increases(coefficients):
        coefficients = solve_nonnegative(gram)
    return coefficients if increases(coefficients) else None


RESPONSE_LEVELS = np.linspace(0, 1, 256)
"""Grey levels at which g is tabulated: those of 8-bit images."""


def polynomial_response(
    coefficients: FloatArray, estimates: FloatArray | None = None, support: tuple[float, float] = (0.0, 1.0)
) -> Response:
    """Return the response whose inverse is the polynomial with coefficients c₀ … c_d.

    ``support`` is the lowest and highest grey level of the samples. The uncertainty is the scatter of the estimates,
    shape (n, d+1), of which the coefficients are the mean.
    """
    log_sigma = scale_sigma = None
    if estimates is not None and len(estimates) > 1:
        greys = np.append(RESPONSE_LEVELS, sum(support) / 2)
        curves = np.log([np.maximum(polyval(greys, c), MIN_POLYNOMIAL_IRRADIANCE) for c in estimates])
        log_sigma = standard_error(curves[:, :-1] - curves[:, -1:])
        scale_sigma = float(np.std(curves[:, -1], ddof=1) / np.sqrt(len(curves)))
    return Response.from_values(
        polyval(RESPONSE_LEVELS, coefficients),
        log_sigma=log_sigma,
        scale_sigma=scale_sigma,
        support=support,
        model={"name": "polynomial", "coefficients": coefficients.tolist()},
    )


# Section 3.2, vignette.

_VIGNETTE_POWERS = np.array([2, 4, 6])
"""Powers of R in V(R) = 1 + v₁R² + v₂R⁴ + v₃R⁶ (eq. radial)."""


def vignette_rows(pairs: Correspondences, ratio: float, response: Response) -> tuple[FloatArray, FloatArray]:
    """Return the rows [R₀²−ψR₁², R₀⁴−ψR₁⁴, R₀⁶−ψR₁⁶] and right-hand sides ψ−1, ψ = g(M₀)/g(M₁)/k (eq. martix_v)."""
    psi = response.inverse(pairs.grey0) / response.inverse(pairs.grey1) / ratio
    rows = pairs.radius0[:, None] ** _VIGNETTE_POWERS - psi[:, None] * pairs.radius1[:, None] ** _VIGNETTE_POWERS
    return np.asarray(rows), np.asarray(psi - 1)


def solver_weights(solver: str, residuals: FloatArray, tuning: float) -> FloatArray:
    """Return the weights of equations, shape (n,), from their residuals, shape (n,) (section 5).

    "l2" is ordinary least squares, "l1" minimises the sum of absolute residuals, and "m-estimator" is Huber's (1964),
    with a threshold of ``tuning`` standard deviations, estimated from the residuals.
    """
    if solver == "l2":
        return np.ones_like(residuals)
    scale = max(robust_scale(residuals), float(np.finfo(float).tiny))
    if solver == "m-estimator":
        return huber_weights(residuals, tuning * scale)
    # A residual far below the scale counts as zero; without the limit its weight would be infinite.
    return np.asarray(1 / np.maximum(np.abs(residuals), ZERO_RESIDUAL * scale))


def solve_vignette(rows: FloatArray, target: FloatArray, solver: str, tuning: float) -> FloatArray:
    """Return (v₁, v₂, v₃) by iteratively reweighted least squares with :func:`solver_weights`."""
    solution = np.linalg.lstsq(rows, target, rcond=None)[0]
    for _ in range(MAX_VIGNETTE_ROUNDS):
        root = np.sqrt(solver_weights(solver, rows @ solution - target, tuning))
        previous, solution = solution, np.linalg.lstsq(rows * root[:, None], target * root, rcond=None)[0]
        if np.linalg.norm(solution - previous) <= VIGNETTE_TOLERANCE * max(float(np.linalg.norm(solution)), 1e-12):
            break
    return np.asarray(solution)


# Section 3.2, exposure.


def irradiance_ratios(pairs: Correspondences, response: Response, vignette: Vignette | None) -> FloatArray:
    """Return g(M₀)V(R₁) / (g(M₁)V(R₀)) of each correspondence, shape (n,), with V ≡ 1 if the vignette is None."""
    ratio = response.inverse(pairs.grey0) / response.inverse(pairs.grey1)
    if vignette is not None:
        ratio = ratio * vignette.at(pairs.points1) / vignette.at(pairs.points0)
    return np.asarray(ratio)


def estimate_ratios(
    samples: Sequence[tuple[Correspondences, float]], response: Response, vignette: Vignette | None
) -> ExposureRatios:
    """Return k̂, the mean ratio of each pair of frames (eq. mean), together with its recorded k."""
    used = [(pairs, ratio) for pairs, ratio in samples if len(pairs)]
    if not used:
        return ExposureRatios.none()
    return ExposureRatios(
        np.array([pairs.frames for pairs, _ in used], dtype=np.int64),
        np.array([ratio for _, ratio in used]),
        np.array([float(np.mean(irradiance_ratios(pairs, response, vignette))) for pairs, _ in used]),
        np.array([len(pairs) for pairs, _ in used], dtype=np.int64),
    )


def disagreement(ratios: ExposureRatios) -> float:
    """Return the median of |ln k̂ − ln k| over the pairs; infinite without pairs."""
    residual = np.abs(ratios.log_residual)
    return float(np.median(residual)) if residual.size else float("inf")


# Section 4.1: estimates are repeated over the sequence and averaged.


@dataclass
class Estimates:
    """Accepted estimates of one curve's coefficients, one per window, and the number of other estimates.

    ``rejected`` ones did not predict the exposure ratios, or were not a response. ``impossible`` ones were vignettes
    that are not positive everywhere.
    """

    accepted: list[FloatArray] = field(default_factory=list)
    rejected: int = 0
    impossible: int = 0

    @property
    def mean(self) -> FloatArray:
        """Average of the accepted estimates."""
        return np.asarray(np.mean(self.accepted, axis=0))

    def covariance(self, symbol: str, first: int) -> dict[str, object] | None:
        """Return the covariance of the mean and its parameters' names, numbered from ``first``; None for one."""
        if len(self.accepted) < 2:
            return None
        matrix = np.cov(np.array(self.accepted).T) / len(self.accepted)
        return {"parameters": [f"{symbol}{first + i}" for i in range(len(matrix))], "matrix": matrix.tolist()}


def standard_error(curves: FloatArray) -> FloatArray | None:
    """Return the standard error of the mean of curves, shape (estimates, n) -> (n,); None for fewer than two."""
    if len(curves) < 2:
        return None
    return np.asarray(np.std(curves, axis=0, ddof=1) / np.sqrt(len(curves)))


# The method.


class PaperMethod(Method):
    """The preset ``paper``. It has no state: the features of hundreds of frames are too large for a file.

    Features are extracted and matched by the given matcher, or by one made from the settings. Images that are too
    small raise :class:`~ospc.errors.FrameError`.
    """

    def __init__(
        self, settings: PaperSettings, size: ImageSize, max_grey: int, matcher: Matcher | None = None
    ) -> None:
        check_can_be_matched(size)
        self._settings = settings
        self._size = size
        self._max_grey = max_grey
        self._matcher = matcher or FeatureMatcher(settings)
        self._frames = 0
        self._waiting: list[Features] = []
        self._recent: deque[Features] = deque()
        self._response_samples: list[Correspondences] = []
        self._vignette_samples: list[Correspondences] = []
        self._responses = Estimates()
        self._vignettes = Estimates()
        self._ratios = ExposureRatios.none()
        self._log_exposure_range = (np.inf, -np.inf)
        self._radial_motion = 0.0
        self._pairs = self._usable = 0

    def push(self, frame: Frame, prepared: PreprocessedFrame | None, exposures: ExposureLookup) -> Change | None:
        """Match the next frame with earlier ones, and solve at the end of each window.

        Only the frame's image and number are used; features are extracted from the full image.

        Raises
        ------
        FrameError
            If the frame's image cannot be read; the method continues as if the frame had not been pushed.
        """
        features = self._matcher.features(frame)
        log_exposure = float(exposures.log_exposure_of(np.array([frame.index]))[0])
        low, high = self._log_exposure_range
        self._log_exposure_range = float(np.fmin(low, log_exposure)), float(np.fmax(high, log_exposure))
        self._frames += 1
        for left in self._with_exposure_change(features, exposures):
            found = self._correspondences(left, features)
            still = found.radial_displacement <= self._settings.response_max_radial_displacement
            self._keep(found.select(still), self._response_samples, exposures)
        self._recent.append(features)
        if len(self._recent) > self._settings.vignette_offset:
            found = self._correspondences(self._recent.popleft(), features)
            moving = found.radial_displacement >= self._settings.vignette_min_radial_displacement
            self._keep(found.select(moving), self._vignette_samples, exposures)
        if self._frames % self._settings.response_window == 0:
            self._close_response_window(exposures)
        if self._frames % self._settings.vignette_window == 0:
            self._close_vignette_window(exposures)
        return None

    @property
    def progress(self) -> Progress:
        """The current progress."""
        response, vignette = self._mean_response(), self._vignette_sigma()
        sigma = None if response is None else response.inverse_sigma
        largest = None if sigma is None else float(sigma.max())
        return Progress(self._pairs, self._usable, largest, None if vignette is None else float(vignette[-1]))

    def calibration(self, exposures: ExposureLookup, grey_range: GreyRange = FULL_RANGE) -> Calibration:
        """Return the mean of the accepted estimates; an open window is used only if no complete one was accepted."""
        # Close the windows of a copy, so that this object does not change.
        closed = copy.copy(self)
        closed._responses, closed._vignettes = copy.deepcopy((self._responses, self._vignettes))
        if not closed._responses.accepted:
            closed._close_response_window(exposures)
        if closed._responses.accepted and not closed._vignettes.accepted:
            closed._close_vignette_window(exposures)
        return closed._summary()

    # The steps.

    def _with_exposure_change(self, latest: Features, exposures: ExposureLookup) -> list[Features]:
        """Return the waiting frames whose exposure first differs enough from that of the latest."""
        candidates = [*self._waiting, latest]
        log_exposure = exposures.log_exposure_of(np.array([one.frame for one in candidates]))
        log_ratio = log_exposure - log_exposure[-1]
        low, high = np.log([self._settings.exposure_ratio_low, self._settings.exposure_ratio_high])
        # The latest frame's ratio to itself is one, so it joins the waiting frames.
        changed = (log_ratio <= low) | (log_ratio >= high)
        self._waiting = [candidates[i] for i in np.flatnonzero(~changed)]
        return [candidates[i] for i in np.flatnonzero(changed)]

    def _correspondences(self, left: Features, right: Features) -> Correspondences:
        """Return the matches of two frames that are clipped in neither."""
        found = self._matcher.correspondences(left, right, self._size)
        if len(found):
            self._radial_motion = max(
                self._radial_motion, float(np.quantile(found.radial_displacement, RADIAL_MOTION_QUANTILE))
            )
        return found.select((np.minimum(found.grey0, found.grey1) > 0) & (np.maximum(found.grey0, found.grey1) < 1))

    def _keep(self, pairs: Correspondences, samples: list[Correspondences], exposures: ExposureLookup) -> None:
        samples.append(pairs)
        self._pairs += 1
        self._usable += len(in_order(pairs, exposure_ratio(pairs, exposures)))

    def _with_ratios(
        self, pairs: Sequence[Correspondences], exposures: ExposureLookup
    ) -> list[tuple[Correspondences, float]] | None:
        """Return the samples of a window, each pair with its exposure ratio; None if there are too few."""
        ratios = [exposure_ratio(p, exposures) for p in pairs]
        samples = [(in_order(p, ratio), ratio) for p, ratio in zip(pairs, ratios, strict=True)]
        return samples if sum(len(p) for p, _ in samples) >= self._settings.min_samples else None

    def _close_response_window(self, exposures: ExposureLookup) -> None:
        samples = self._with_ratios(self._response_samples, exposures)
        self._response_samples, self._waiting = [], []
        if samples is None:
            return
        rows = [response_rows(pairs, ratio, self._settings.response_degree) for pairs, ratio in samples]
        coefficients = solve_response(np.sum([a.T @ a for a in rows], axis=0), self._settings.response_positivity)
        if coefficients is None:
            self._responses.rejected += 1
            return
        ratios = estimate_ratios(samples, polynomial_response(coefficients), None)
        self._accept_or_reject(self._responses, coefficients, ratios)

    def _close_vignette_window(self, exposures: ExposureLookup) -> None:
        samples = self._with_ratios(self._vignette_samples, exposures)
        self._vignette_samples = []
        response = self._mean_response()
        if samples is None or response is None:
            return
        rows, targets = zip(*(vignette_rows(pairs, ratio, response) for pairs, ratio in samples), strict=True)
        solver, tuning = self._settings.vignette_solver, self._settings.huber_tuning
        coefficients = solve_vignette(np.concatenate(rows), np.concatenate(targets), solver, tuning)
        vignette = self._vignette(coefficients)
        if not np.all(vignette.profile(PROFILE_RADII) > 0):
            self._vignettes.impossible += 1
            return
        self._accept_or_reject(self._vignettes, coefficients, estimate_ratios(samples, response, vignette))

    def _accept_or_reject(self, estimates: Estimates, coefficients: FloatArray, ratios: ExposureRatios) -> None:
        """Judge an estimate by the exposure ratios it predicts."""
        if disagreement(ratios) > self._settings.acceptance_tolerance:
            estimates.rejected += 1
            return
        estimates.accepted.append(coefficients)
        self._ratios = ratios

    # The result.

    def _summary(self) -> Calibration:
        response = self._mean_response()
        low, high = np.exp(self._log_exposure_range).tolist()
        verdicts = {
            "response": response_verdict(self._settings, self._responses, (low, high)),
            "vignette": vignette_verdict(self._settings, self._vignettes, self._radial_motion, response is not None),
        }
        covariance = {"response": self._responses.covariance("c", 0), "vignette": self._vignettes.covariance("v", 1)}
        return Calibration(
            size=self._size,
            response=response,
            vignette=self._vignette(self._vignettes.mean) if self._vignettes.accepted else None,
            verdicts=verdicts,
            vignette_sigma=self._vignette_sigma(),
            exposure_ratios=self._ratios,
            covariance={name: known for name, known in covariance.items() if known is not None},
            max_grey=self._max_grey,
            converged=min(len(self._responses.accepted), len(self._vignettes.accepted)) >= 2,
            counts={"pairs": self._pairs, "samples": self._usable},
            advice=tuple(verdict.remedy for verdict in verdicts.values() if verdict.remedy),
        )

    def _mean_response(self) -> Response | None:
        if not self._responses.accepted:
            return None
        # No sample is clipped, so black and white are outside the support.
        support = (float(RESPONSE_LEVELS[1]), float(RESPONSE_LEVELS[-2]))
        return polynomial_response(self._responses.mean, np.array(self._responses.accepted), support)

    def _vignette(self, coefficients: FloatArray) -> PolynomialVignette:
        return PolynomialVignette(self._size, tuple(coefficients.tolist()))

    def _vignette_sigma(self) -> FloatArray | None:
        curves = [self._vignette(found).profile(PROFILE_RADII) for found in self._vignettes.accepted]
        return standard_error(np.array(curves))


# Verdicts, with what to record instead.


def response_verdict(
    settings: PaperSettings, estimates: Estimates, exposure_range_ms: tuple[float, float]
) -> Verdict:
    """Return whether the response is known, given the estimates and the shortest and longest exposure."""
    low, high = exposure_range_ms
    if high / low < settings.exposure_ratio_high:
        return Verdict(
            "not identifiable",
            f"the exposure hardly changes ({range_in_words(low, high)}), so the response cannot be determined",
            "record with auto exposure on while moving between dark and bright places, or sweep the exposure",
        )
    remedy = (
        "check that exposures belong to their frames, and that gain and tone mapping are fixed"
        if estimates.rejected
        else "record a scene with more texture, moving slowly while the exposure changes"
    )
    return _verdict(estimates, "small radial displacement", remedy)


def vignette_verdict(
    settings: PaperSettings, estimates: Estimates, radial_motion: float, response_known: bool
) -> Verdict:
    """Return whether the vignette is known, given the estimates.

    ``radial_motion`` is the largest radial displacement, in half diagonals, that a tenth of the matches of any pair
    exceed.
    """
    if not response_known:
        return Verdict("not identifiable", "without a response there is no irradiance to compare", "")
    needed = settings.vignette_min_radial_displacement
    remedy = "pan and tilt the camera so that the same objects cross the image between centre and corners"
    if radial_motion < needed and not estimates.accepted:
        return Verdict(
            "not identifiable",
            f"hardly any scene points move radially by {needed:g} of the half diagonal "
            f"(nine in ten move less than {radial_motion:.2g})",
            remedy,
        )
    return _verdict(estimates, "large radial displacement", remedy)


def _verdict(estimates: Estimates, wanted: str, remedy: str) -> Verdict:
    """Return the verdict on a curve estimated from matches with the wanted displacement."""
    accepted = len(estimates.accepted)
    if accepted > 1:
        return Verdict("identifiable", f"{accepted} windows of frames gave accepted estimates")
    if accepted:
        return Verdict("marginal", "a single window of frames gave an estimate", "record longer")
    reason = f"too few matches with {wanted} between frames of different exposure"
    if estimates.rejected:
        reason = f"none of {counted(estimates.rejected, 'estimate')} predicted the exposure ratios of the metadata"
    elif estimates.impossible:
        reason = f"none of {counted(estimates.impossible, 'estimate')} is positive everywhere"
    return Verdict("not identifiable", reason, remedy)
