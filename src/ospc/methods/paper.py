"""The paper's method: response, then vignette, each accepted by the exposures it predicts (paper, section 3)."""

from __future__ import annotations

import copy

import numpy as np

from ospc.arrays import FloatArray, ImageSize
from ospc.correspondence.correspondences import Correspondences
from ospc.correspondence.feature_matching import FeatureMatcher, Matcher
from ospc.correspondence.features import Features, make_extractor
from ospc.correspondence.match_filter import DirectionFilter
from ospc.correspondence.pair_selection import ExposureChangePairs, OffsetPairs
from ospc.estimation.exposure_ratio import disagreement, estimate_ratios
from ospc.estimation.polynomial_vignette import solve_vignette, vignette_rows, vignette_solver
from ospc.estimation.quadratic_response import Positivity, polynomial_response, response_rows, solve_response
from ospc.estimation.repetition import Estimates
from ospc.methods.method import Progress, check_size
from ospc.methods.paper_verdicts import response_verdict, vignette_verdict
from ospc.photometry.calibration import PROFILE_RADII, Calibration, ExposureRatios
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette
from ospc.recording.frame import Frame
from ospc.settings import PaperSettings


def feature_matcher(settings: PaperSettings) -> FeatureMatcher:
    """Return what finds and matches features as the settings say."""
    return FeatureMatcher(
        make_extractor(settings.features, settings.max_features),
        DirectionFilter(
            settings.filter_blocks, settings.filter_bins, settings.filter_min_matches, settings.filter_length_sigmas
        ),
        settings.match_ratio,
    )


class PaperMethod:
    """The preset ``paper``.

    Parameters
    ----------
    settings
        Every number of the method.
    size
        Width and height of the frames in pixels.
    max_grey
        Largest grey value of the frames.
    matcher
        Finds and matches features; that of the settings where not given. Methods that differ in what comes after may
        share one.
    """

    def __init__(
        self, settings: PaperSettings, size: ImageSize, max_grey: int, matcher: Matcher | None = None
    ) -> None:
        check_size(size)
        self._settings = settings
        self._size = size
        self._max_grey = max_grey
        self._matcher = matcher or feature_matcher(settings)
        self._weights = vignette_solver(settings.vignette_solver, settings.huber_tuning)
        self._response_pairs = ExposureChangePairs(
            settings.response_window, settings.exposure_ratio_low, settings.exposure_ratio_high
        )
        self._vignette_pairs = OffsetPairs(settings.vignette_window, settings.vignette_offset)
        self._response_samples: list[Correspondences] = []
        self._vignette_samples: list[Correspondences] = []
        self._responses = Estimates()
        self._vignettes = Estimates()
        self._ratios = ExposureRatios.none()
        self._exposure_range = (np.inf, 0.0)
        self._reach = 0.0
        self._compared = 0
        self._used = 0

    def push(self, frame: Frame) -> None:
        """Take the next frame: match it with earlier ones, and solve at the end of each window."""
        features = self._matcher.features(frame)
        self._exposure_range = (
            min(self._exposure_range[0], frame.exposure_ms),
            max(self._exposure_range[1], frame.exposure_ms),
        )
        for pair in self._response_pairs.push(features):
            self._response_samples.append(self._still_points(self._correspondences(*pair)))
        for pair in self._vignette_pairs.push(features):
            self._vignette_samples.append(self._moving_points(self._correspondences(*pair)))
        if self._response_pairs.window_full:
            self._close_response_window()
        if self._vignette_pairs.window_full:
            self._close_vignette_window()

    @property
    def progress(self) -> Progress:
        """How far it has come."""
        response = self._responses.spread_of_curve(self._response_curves())
        vignette = self._vignettes.spread_of_curve(self._vignette_curves())
        return Progress(
            self._compared,
            self._used,
            None if response is None else float(response.max()),
            None if vignette is None else float(vignette[-1]),
        )

    def calibration(self) -> Calibration:
        """Return the averages of the accepted estimates; an open window counts only where no full one did."""
        return self._with_open_windows_closed()._summary()

    def _with_open_windows_closed(self) -> PaperMethod:
        """Return a copy whose open windows made their estimates, so that being asked changes nothing here."""
        closed = copy.copy(self)
        closed._responses, closed._vignettes = copy.deepcopy((self._responses, self._vignettes))
        if not closed._responses.accepted:
            closed._close_response_window()
        if closed._responses.accepted and not closed._vignettes.accepted:
            closed._close_vignette_window()
        return closed

    def _summary(self) -> Calibration:
        response, vignette = self._mean_response(), self._mean_vignette()
        verdicts = {
            "response": response_verdict(self._settings, self._responses, self._exposure_range),
            "vignette": vignette_verdict(self._settings, self._vignettes, self._reach, response is not None),
        }
        return Calibration(
            size=self._size,
            response=response,
            vignette=vignette,
            verdicts=verdicts,
            vignette_sigma=self._vignettes.spread_of_curve(self._vignette_curves()),
            exposure_ratios=self._ratios,
            covariance=self._covariance(),
            max_grey=self._max_grey,
            converged=min(len(self._responses.accepted), len(self._vignettes.accepted)) >= 2,
            counts={"pairs": self._compared, "samples": self._used},
            advice=tuple(verdict.remedy for verdict in verdicts.values() if verdict.remedy),
        )

    # The steps of the method, in the paper's order.

    def _correspondences(self, left: Features, right: Features) -> Correspondences:
        found = self._matcher.correspondences(left, right, self._size)
        grey0, grey1 = found.grey0, found.grey1
        exposed = (grey0 > 0) & (grey0 < 1) & (grey1 > 0) & (grey1 < 1)
        # Equal grey levels, or the brighter one at the smaller exposure, contradict an increasing response.
        ordered = (grey0 - grey1) * (found.exposure_ratio - 1) > 0
        self._compared += 1
        moved = found.radial_displacement
        if len(moved):
            self._reach = max(self._reach, float(np.quantile(moved, 0.9)))
        return found.select(exposed & ordered)

    def _still_points(self, pairs: Correspondences) -> Correspondences:
        kept = pairs.select(pairs.radial_displacement <= self._settings.response_max_radial_displacement)
        self._used += len(kept)
        return kept

    def _moving_points(self, pairs: Correspondences) -> Correspondences:
        kept = pairs.select(pairs.radial_displacement >= self._settings.vignette_min_radial_displacement)
        self._used += len(kept)
        return kept

    def _close_response_window(self) -> None:
        pairs, self._response_samples = self._response_samples, []
        if sum(map(len, pairs)) < self._settings.min_samples:
            self._responses.poor += 1
            return
        rows = (response_rows(p, self._settings.response_degree) for p in pairs)
        positivity: Positivity = self._settings.response_positivity  # type: ignore[assignment]
        coefficients = solve_response(np.sum([a.T @ a for a in rows], axis=0), positivity)
        if coefficients is None:
            self._responses.rejected += 1
            return
        ratios = estimate_ratios(pairs, polynomial_response(coefficients, None, (0, 1)), None)
        if disagreement(ratios) > self._settings.acceptance_tolerance:
            self._responses.rejected += 1
            return
        self._responses.accepted.append(coefficients)
        self._ratios = ratios

    def _close_vignette_window(self) -> None:
        pairs, self._vignette_samples = self._vignette_samples, []
        response = self._mean_response()
        if response is None or sum(map(len, pairs)) < self._settings.min_samples:
            self._vignettes.poor += 1
            return
        rows, targets = zip(*(vignette_rows(p, response) for p in pairs), strict=True)
        coefficients = solve_vignette(np.concatenate(rows), np.concatenate(targets), self._weights)
        vignette = PolynomialVignette(self._size, tuple(coefficients.tolist()))
        if not np.all(vignette.profile(PROFILE_RADII) > 0):
            self._vignettes.impossible += 1
            return
        ratios = estimate_ratios(pairs, response, vignette)
        if disagreement(ratios) > self._settings.acceptance_tolerance:
            self._vignettes.rejected += 1
            return
        self._vignettes.accepted.append(coefficients)
        self._ratios = ratios

    # What the accepted estimates amount to.

    def _mean_response(self) -> Response | None:
        if not self._responses.accepted:
            return None
        spread = self._responses.spread_of_curve(self._response_curves())
        return polynomial_response(self._responses.mean, spread, (1 / 255, 254 / 255))

    def _mean_vignette(self) -> PolynomialVignette | None:
        if not self._vignettes.accepted:
            return None
        return PolynomialVignette(self._size, tuple(self._vignettes.mean.tolist()))

    def _response_curves(self) -> FloatArray:
        levels = np.linspace(0, 1, 256)
        return np.array([np.polynomial.polynomial.polyval(levels, c) for c in self._responses.accepted])

    def _vignette_curves(self) -> FloatArray:
        estimates = self._vignettes.accepted
        return np.array([PolynomialVignette(self._size, tuple(v)).profile(PROFILE_RADII) for v in estimates])

    def _covariance(self) -> dict[str, dict[str, object]]:
        found: dict[str, dict[str, object]] = {}
        for name, symbol, estimates in (("response", "c", self._responses), ("vignette", "v", self._vignettes)):
            n = len(estimates.accepted)
            if n >= 2:
                matrix = np.cov(np.array(estimates.accepted).T) / n
                first = 0 if name == "response" else 1
                names = [f"{symbol}{i + first}" for i in range(len(matrix))]
                found[name] = {"parameters": names, "matrix": matrix.tolist()}
        return found
