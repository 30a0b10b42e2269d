"""Verdicts of the default method: whether each curve could be determined, and why."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ospc.arrays import ImageSize
from ospc.errors import counted, plain
from ospc.estimation.effect_models import SCATTERED_LIGHT
from ospc.estimation.fit import Fit
from ospc.exposures.table import range_in_words
from ospc.methods.contradictions import Contradictions
from ospc.observations import ExposedObservations
from ospc.photometry.verdict import Verdict
from ospc.settings import DefaultSettings
from ospc.settings.fit import CONFIDENCE, LOG_RATIO_DECIMALS
from ospc.settings.methods import (
    CONTRADICTING_UNEXPLAINED_SHARE,
    DOUBTED_UNEXPLAINED_SHARE,
    FAR_RADIAL_MOTION,
    IDENTIFIABLE_CORNER_SIGMA,
    IDENTIFIABLE_ERROR,
    MAX_CORNER_ERROR_SHARE,
    MIN_SCATTER_GROUPS,
    ONE_DIRECTION_RATIO,
    ONE_WAY_SHARE,
    POSSIBLE_LIGHT_SIGMAS,
    UNIDENTIFIABLE_FACTOR,
    WIDE_EXPOSURE_RATIO,
)

_SEE_MORE = (
    "record more frames of a scene with uniform surfaces from dark to bright: the exposure changes enough, "
    "but too little of the scene is well exposed in two frames"
)
_CHANGE_EXPOSURE = (
    f"let the exposure change by a factor of {WIDE_EXPOSURE_RATIO:g} or more: record with auto exposure on while "
    "moving between dark and bright places, or sweep the exposure up and down"
)
_THREE_EXPOSURES = (
    "use three or more different exposures: two do not show whether a constant is missing in both, on which the "
    "response depends"
)
_UP_AND_DOWN = (
    "raise and lower the exposure several times: it only rose or fell, so light that drifts meanwhile would look "
    "like another response"
)
_CLEARER = (
    "clean the lens, and keep haze, sun and lamps out of the view: it is uncertain whether there is {what}, and this "
    "limits the accuracy of the response; or record more frames"
)
_MOVE_RADIALLY = (
    "pan and tilt the camera so that the same objects cross the image between centre and corners, by a fifth of the "
    "half diagonal or more"
)
_MOVE_RADIALLY_AND_SLOWLY = (
    f"{_MOVE_RADIALLY}; if they did, turn more slowly: frames that share too little of the view cannot be compared"
)
_SEE_MORE_MOVING = (
    "record more frames of uniform surfaces that cross the image between centre and corners: they move far enough"
)
_MOVE_ACROSS = (
    "move the camera in the other direction, too (tilt it if it panned): objects cross the image in one direction "
    "only, so the centre of the vignette is uncertain"
)
_STEADIER = (
    "film in steadier light with a fixed white balance, or provide more accurate exposures, and record more frames: "
    "frames are brighter or darker than their exposures predict"
)
_CHECK_EXPOSURES = (
    "check that each exposure is a time and belongs to its frame, film in steady light that does not move with the "
    "camera, and switch off gain control and tone mapping"
)


def response_verdict(
    settings: DefaultSettings,
    fit: Fit | None,
    observations: ExposedObservations | None,
    unexplained: float,
    contradictions: Contradictions = (),
) -> Verdict:
    """Return whether the response is known, and what to record if it is not.

    ``unexplained`` is the share of a typical change of exposure that is missing in the images.
    """
    points = 0 if observations is None else len(observations.starts)
    low, high = (1.0, np.inf) if observations is None else observations.exposure_range_ms
    if np.log(high / low) < settings.min_log_exposure_change:
        return Verdict(
            "not identifiable",
            f"the exposure hardly changes ({range_in_words(low, high)}), so the response cannot be determined",
            _CHANGE_EXPOSURE,
        )
    if points < settings.min_points:
        return Verdict(
            "not identifiable",
            f"only {counted(points, 'scene point')} could be tracked (at least {settings.min_points} are needed)",
            "record a longer sequence of a well-exposed scene with uniform surfaces and some texture, moving slowly",
        )
    if fit is None:
        return Verdict(
            "not identifiable",
            f"hardly any scene points were seen at clearly different exposures (from {range_in_words(low, high)})",
            _CHANGE_EXPOSURE,
        )
    found = response_verdict_of_fit(fit, (low, high), unexplained, contradictions)
    if observations is None or found.remedy not in (_CHANGE_EXPOSURE, _SEE_MORE):
        return found
    if len(np.unique(observations.log_exposure.round(LOG_RATIO_DECIMALS))) == 2:
        return replace(found, remedy=_THREE_EXPOSURES)
    return replace(found, remedy=_UP_AND_DOWN) if _goes_one_way(observations) else found


def response_verdict_of_fit(
    fit: Fit, exposure_range_ms: tuple[float, float], unexplained: float, contradictions: Contradictions = ()
) -> Verdict:
    """Return whether a fit determines the response; the other arguments are as in :func:`response_verdict`."""
    error = fit.log_ratio_error_bound
    low, high = exposure_range_ms
    # If all exposures were raised to a power, so would g and V be, and no image would differ.
    figure = (
        f"typical irradiance ratios are {{known}} to within {plain(100 * error, 2)}% ({CONFIDENCE:.0%} confidence), "
        f"if the ratios of the exposures ({range_in_words(low, high)}) are right"
    )
    missing = f"{min(unexplained, 1):.0%} of a typical change of exposure does not show in the images"
    if unexplained > CONTRADICTING_UNEXPLAINED_SHARE:
        return Verdict("not identifiable", missing, _CHECK_EXPOSURES)
    remedy = _CHANGE_EXPOSURE if high < WIDE_EXPOSURE_RATIO * low else _clearer_view(fit) or _SEE_MORE
    remedy = _STEADIER if _is_unsteady(fit) else remedy
    if unexplained > DOUBTED_UNEXPLAINED_SHARE:
        # What contradicts the model may be why the changes are missing, and has the more specific remedy.
        doubts = (missing, *(what for what, _ in contradictions[:1]))
        contradictions = (("; ".join(doubts), contradictions[0][1] if contradictions else _CHECK_EXPOSURES),)
    return doubted(_graded(fit, error / IDENTIFIABLE_ERROR, figure, remedy), contradictions)


def vignette_verdict(
    fit: Fit | None,
    radial_motion: float,
    stationary: bool,
    unexplained: float,
    *,
    size: ImageSize,
    contradictions: Contradictions = (),
) -> Verdict:
    """Return whether the vignette is known, and what to record if it is not.

    Parameters
    ----------
    radial_motion
        Radial displacement, in half diagonals, of the scene points that determine the vignette: half of the
        information comes from points that move farther.
    unexplained
        Share of a typical change of exposure that is missing in the images.
    size
        Width and height of the images in pixels.
    """
    if stationary:
        return Verdict(
            "not identifiable", "the camera is stationary: the vignette of each point never changes", _MOVE_RADIALLY
        )
    moves_far = round(radial_motion, 2) >= FAR_RADIAL_MOTION  # as the reason shows it
    if fit is None or unexplained > CONTRADICTING_UNEXPLAINED_SHARE:
        reason = "without a response there is no irradiance to compare"
        return Verdict("not identifiable", reason, "" if moves_far else _MOVE_RADIALLY)
    errors, radius = fit.vignette_errors(size), fit.vignette_basis.usable_radius
    error, sigma = errors.bound(radius), errors.worst_log_sigma(radius)
    where = "at the corner" if radius >= 1 else f"at the edge of the usable image ({radius:.2f} half diagonals)"
    figure = (
        f"the vignette is {{known}} to within {plain(100 * error, 2)}% ({CONFIDENCE:.0%} confidence), {where} to "
        f"±{plain(100 * sigma, 2)}% (1σ), from radial motion of {radial_motion:.2f} half diagonals"
    )
    remedy = _SEE_MORE_MOVING if moves_far else _MOVE_RADIALLY_AND_SLOWLY
    remedy = _MOVE_ACROSS if _moves_in_one_direction(fit) else remedy
    remedy = _STEADIER if _is_unsteady(fit) else remedy
    at_corner = sigma / IDENTIFIABLE_CORNER_SIGMA
    if sigma <= MAX_CORNER_ERROR_SHARE * errors.largest_correction(radius):
        at_corner = min(at_corner, UNIDENTIFIABLE_FACTOR)  # a dark corner is no reason to leave all else uncorrected
    relative = max(error / IDENTIFIABLE_ERROR, at_corner)
    return doubted(_graded(fit, relative, figure, remedy), contradictions)


def _moves_in_one_direction(fit: Fit) -> bool:
    """Return whether the vignette's centre is much more uncertain in one direction than in the other."""
    if not fit.vignette_basis.free_centre:
        return False
    least, most = np.sqrt(np.linalg.eigvalsh(fit.covariance[fit.centre_part, fit.centre_part]))
    return bool(most > ONE_DIRECTION_RATIO * least)


def _is_unsteady(fit: Fit) -> bool:
    """Return whether unsteady light prevents the response, and with it the vignette, from being known."""
    between_frames = float(np.sqrt(2 * sum(fit.errors.gain_variances)))
    return between_frames > IDENTIFIABLE_ERROR and fit.log_ratio_error_bound > IDENTIFIABLE_ERROR


def _goes_one_way(observations: ExposedObservations) -> bool:
    """Return whether the exposure hardly ever rises, or hardly ever falls."""
    _, first = np.unique(observations.frame, return_index=True)
    changes = np.diff(observations.log_exposure[first])
    return bool(abs(changes.sum()) > ONE_WAY_SHARE * np.abs(changes).sum())


def _clearer_view(fit: Fit) -> str:
    """Return what to do about scattered light that may make the response uncertain; empty if there is no sign."""
    for found in fit.effect_estimates:
        clear = found.value > POSSIBLE_LIGHT_SIGMAS * found.sigma
        if found.name in SCATTERED_LIGHT and clear and not found.corrected:
            return _CLEARER.format(what=f"{found.name} ({found.value:.1%} ± {found.sigma:.1%})")
    return ""


def _graded(fit: Fit, relative_error: float, figure: str, remedy: str) -> Verdict:
    """Return the verdict on a curve, given its error relative to the limit; ``figure`` is a format for ``known``."""
    if relative_error > UNIDENTIFIABLE_FACTOR:
        return Verdict("not identifiable", figure.format(known="known only"), remedy)
    figure = figure.format(known="known")
    if relative_error > 1:
        return Verdict("marginal", figure, remedy)
    if fit.groups >= MIN_SCATTER_GROUPS:
        return Verdict("identifiable", figure)
    few = f"{figure}, but based on only {counted(fit.groups, 'comparison')} of frames"
    return Verdict("marginal", few, "record more frames: their scatter shows how accurate the curve is")


def doubted(verdict: Verdict, contradictions: Contradictions) -> Verdict:
    """Return a verdict, lowered to marginal if anything contradicts the model."""
    if not contradictions:
        return verdict
    what, remedy = contradictions[0]
    return Verdict("marginal" if verdict.known else verdict.state, f"{verdict.reason}, but {what}", remedy)
