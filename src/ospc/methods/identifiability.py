"""Verdicts of the default method: whether each curve could be determined, and why."""

from __future__ import annotations

import numpy as np

from ospc.errors import counted
from ospc.estimation.effect_models import GAIN_STEPS, LIGHT_FIXED_TO_CAMERA
from ospc.estimation.effects import Effects
from ospc.estimation.fit import Fit
from ospc.estimation.residual_effects import (
    UNEVEN,
    UNSTEADY_LIGHT,
    UNSTEADY_RADIANCE,
    UNSTEADY_RESPONSE,
    UNSTEADY_VIGNETTE,
)
from ospc.observations import ExposedObservations
from ospc.photometry.calibration import ExposureRatios
from ospc.photometry.verdict import LATE_EXPOSURES, NOMINAL_EXPOSURES, EffectEstimate, State, Verdict
from ospc.settings import DefaultSettings
from ospc.settings.methods import (
    CONTRADICTING_UNEXPLAINED_SHARE,
    DOUBTED_UNEXPLAINED_SHARE,
    FAR_RADIAL_REACH,
    IDENTIFIABLE_CORNER_SIGMA,
    IDENTIFIABLE_ERROR,
    MIN_COMPARED_LOG_K,
    MIN_SCATTER_GROUPS,
    UNIDENTIFIABLE_FACTOR,
    WIDE_EXPOSURE_RATIO,
)

_SEE_MORE = (
    "record more frames of a scene with uniform surfaces of all brightnesses: the exposure changes enough, "
    "but too little of the scene is well exposed in two frames"
)
_CHANGE_EXPOSURE = (
    "record with auto exposure on while moving between dark and bright places, or sweep the exposure by a factor of "
    f"{WIDE_EXPOSURE_RATIO:g} or more"
)
_MOVE_RADIALLY = (
    "pan and tilt the camera so that the same objects cross the image between centre and corners, by a fifth of the "
    "half diagonal or more"
)
_SEE_MORE_MOVING = (
    "record more frames of uniform surfaces that cross the image between centre and corners: they move far enough"
)
_STEADIER = (
    "film in steadier light with a fixed white balance, or provide more accurate exposures, and record more frames: "
    "frames are brighter or darker than their exposures predict"
)
_CHECK_EXPOSURES = (
    "check that each exposure is a time and belongs to its frame, film in steady light that does not move with the "
    "camera, and switch off gain control and tone mapping"
)

Contradictions = tuple[tuple[str, str], ...]
"""The description and the remedy of each contradiction, the clearest first."""


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
    if high < low * np.exp(settings.min_log_exposure_change):
        return Verdict(
            "not identifiable",
            f"the exposure hardly changes ({low:.4g} to {high:.4g} ms), so the response cannot be determined",
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
            f"hardly any scene point was seen at different exposures (all are {low:.4g} to {high:.4g} ms)",
            _CHANGE_EXPOSURE,
        )
    return response_verdict_of_fit(fit, (low, high), unexplained, contradictions)


def response_verdict_of_fit(
    fit: Fit, exposure_range_ms: tuple[float, float], unexplained: float, contradictions: Contradictions = ()
) -> Verdict:
    """Return whether a fit determines the response; the others as in :func:`response_verdict`."""
    error = fit.log_ratio_error_bound
    low, high = exposure_range_ms
    # If all exposures were raised to a power, so would g and V be, and no image would differ.
    figure = (
        f"ratios of irradiance are known to within {100 * error:.2g}% (95% confidence) "
        f"from exposures of {low:.4g} to {high:.4g} ms, assumed proportional to the light"
    )
    missing = f"{min(unexplained, 1):.0%} of a typical change of exposure does not show in the images"
    if unexplained > CONTRADICTING_UNEXPLAINED_SHARE:
        return Verdict("not identifiable", missing, _CHECK_EXPOSURES)
    remedy = _CHANGE_EXPOSURE if high < WIDE_EXPOSURE_RATIO * low else _SEE_MORE
    remedy = _STEADIER if _is_unsteady(fit) else remedy
    if unexplained > DOUBTED_UNEXPLAINED_SHARE:
        # What contradicts the model may be why the changes are missing, and has the more specific remedy.
        doubts = (missing, *(what for what, _ in contradictions[:1]))
        contradictions = (("; ".join(doubts), contradictions[0][1] if contradictions else _CHECK_EXPOSURES),)
    return judged(_graded(fit, error / IDENTIFIABLE_ERROR, figure, remedy), contradictions)


def vignette_verdict(
    settings: DefaultSettings,
    fit: Fit | None,
    reach: float,
    standing_still: bool,
    unexplained: float,
    *,
    contradictions: Contradictions = (),
    usable_radius: float = 1.0,
) -> Verdict:
    """Return whether the vignette is known, and what to record if it is not.

    Parameters
    ----------
    reach
        Radial displacement, in half diagonals, of the scene points that determine the vignette: half of the
        information comes from points that move farther.
    unexplained
        Share of a typical change of exposure that is missing in the images.
    usable_radius
        Radius, in half diagonals, of the usable part of the image.
    """
    if standing_still:
        return Verdict(
            "not identifiable", "the camera is stationary: the vignette of each point never changes", _MOVE_RADIALLY
        )
    if reach < settings.min_radial_reach:
        return Verdict(
            "not identifiable",
            f"scene points move radially by {reach:.3f} of the half diagonal "
            f"({settings.min_radial_reach:g} is needed)",
            _MOVE_RADIALLY,
        )
    if fit is None or unexplained > CONTRADICTING_UNEXPLAINED_SHARE:
        return Verdict("not identifiable", "without a response there is no irradiance to compare", "")
    error, sigma = fit.vignette_error_bound(usable_radius), fit.worst_log_vignette_sigma(usable_radius)
    where = "at the corner" if usable_radius >= 1 else f"at {usable_radius:.2f} half diagonals, the image edge,"
    figure = (
        f"V is known to within {100 * error:.2g}% (95% confidence), and ln V {where} to ±{sigma:.2g}, "
        f"from radial motion of {reach:.2f} half diagonals"
    )
    # The reason shows two decimals, so the remedy must not ask for what they already show.
    remedy = _MOVE_RADIALLY if round(reach, 2) < FAR_RADIAL_REACH else _SEE_MORE_MOVING
    remedy = _STEADIER if _is_unsteady(fit) else remedy
    relative = max(error / IDENTIFIABLE_ERROR, sigma / IDENTIFIABLE_CORNER_SIGMA)
    return judged(_graded(fit, relative, figure, remedy), contradictions)


def _is_unsteady(fit: Fit) -> bool:
    """Return whether unsteady light prevents the response, and with it the vignette, from being known."""
    return bool(fit.errors.gain_variances) and fit.log_ratio_error_bound > IDENTIFIABLE_ERROR


def _graded(fit: Fit, relative_error: float, figure: str, remedy: str) -> Verdict:
    """Return the verdict on a curve, given its error relative to the limit for an identifiable curve."""
    if relative_error > 1:
        state: State = "not identifiable" if relative_error > UNIDENTIFIABLE_FACTOR else "marginal"
        return Verdict(state, figure, remedy)
    if fit.groups >= MIN_SCATTER_GROUPS:
        return Verdict("identifiable", figure)
    few = f"{figure}, but from only {counted(fit.groups, 'comparison')} of frames"
    return Verdict("marginal", few, "record more frames: their scatter shows how accurate the curve is")


def unexplained_share(ratios: ExposureRatios) -> float:
    """Return the median misfit of ln k over its median size, for changing exposures."""
    # Count scene points, not pairs: a pair whose registration failed has few points, which are wrong.
    log_k, residual = (np.repeat(values, ratios.samples) for values in (np.log(ratios.metadata), ratios.log_residual))
    changing = np.abs(log_k) > MIN_COMPARED_LOG_K
    if not changing.any():
        return 0.0
    return float(np.median(np.abs(residual[changing])) / np.median(np.abs(log_k[changing])))


_SAME_FOR_ALL_PLACES = "switch off local contrast, HDR and tone mapping in the camera, and film in steady light"
_VIGNETTE_STAYS = (
    "switch off all stabilisation, including that of the lens, and fix zoom, image orientation and white balance"
)

_CONTRADICTIONS = {
    "local tone mapping": (
        "grey levels depend on the brightness around them, as with local tone mapping or flickering light",
        _SAME_FOR_ALL_PLACES,
    ),
    "curved exposures": (
        "the brightness of the images is not proportional to the exposures over their whole range",
        "check the unit of the exposures: they must be times, not logarithms or steps, multiplied by the linear "
        "gain; switch off digital gain and HDR",
    ),
    "drifting response": (
        "the response changes during the recording",
        "fix the picture profile, contrast and gamma of the camera",
    ),
    "drifting black level": (
        "the black level changes during the recording",
        "let the camera warm up, and switch off automatic contrast",
    ),
    "black level by exposure": (
        "the black level differs between long and short exposures, or the light changed",
        "fix the gain of the camera, let it control the exposure time alone, and film in steady light without sun or "
        "lamps in or near the view",
    ),
    UNSTEADY_VIGNETTE: (
        "the vignette has a different position in each frame, as with stabilisation, glossy surfaces or a lamp on "
        "the camera",
        "switch off electronic stabilisation and cropping of the camera, and avoid glossy floors and walls, and "
        "lamps that move with the camera",
    ),
    UNSTEADY_RESPONSE: (
        "the response differs from frame to frame (automatic contrast, sun or lamps in or near the view, haze, fog), "
        "or the frames show too little texture to be registered",
        "switch off automatic contrast and scene modes of the camera, keep sun and lamps out of the view, and film "
        "scenes with texture in clear air",
    ),
    UNSTEADY_RADIANCE: (
        "the same points differ in brightness between frames by more than noise and exposure explain, in ln",
        _SAME_FOR_ALL_PLACES,
    ),
    UNEVEN: (
        "a region of the image is darker or brighter than a smooth vignette predicts (dirt, wipers, reflections in a "
        "window, parts of the sensor with another gain), in ln V",
        "clean lens and sensor, avoid wipers and reflections of the dashboard or in a window, and switch off shading "
        "correction",
    ),
    "drifting vignette": (
        "the vignette changes during the recording",
        "fix zoom, focus and aperture, and switch off shading correction",
    ),
    "vignette moving sideways": ("the vignette moves sideways during the recording", _VIGNETTE_STAYS),
    "vignette moving vertically": ("the vignette moves vertically during the recording", _VIGNETTE_STAYS),
}
"""The description and the remedy of each contradiction."""


_STRAY = "light that is fixed to the camera (dark signal, a leak, a reflection) adds {share} of white at {typical}"

_ADDED_LIGHT = {
    "veiling glare": "veiling glare of {share} of the mean irradiance of each frame was found and corrected",
    "light scattered nearby": "{share} of the light is scattered nearby; this was corrected",
    "stray light at the corners": f"{_STRAY}, more at the corners than in the centre; this was corrected",
    "stray light sideways": f"{_STRAY}, more at one side than in the centre; this was corrected",
    "stray light vertically": f"{_STRAY}, more at the top or bottom than in the centre; this was corrected",
}
"""The note on each kind of light that was added; the second figure is the exposure."""


def notes_of(fit: Fit) -> tuple[str, ...]:
    """Return a sentence for each effect that was found and corrected or accounted for."""
    return tuple(_corrected(found, fit.effects) for found in fit.effect_estimates if found.corrected)


def contradictions_of(fit: Fit) -> Contradictions:
    """Return what contradicts the model of one response and one vignette."""
    found = [estimate for estimate in fit.effect_estimates if estimate.contradicts]
    found.sort(key=lambda estimate: -abs(estimate.value) / estimate.sigma)
    return tuple(
        (f"{_CONTRADICTIONS[one.name][0]}: {one.value:.2g} ± {one.sigma:.1g}", _CONTRADICTIONS[one.name][1])
        for one in found
    )


def judged(verdict: Verdict, contradictions: Contradictions) -> Verdict:
    """Return the verdict by the error of a curve, at best marginal if anything contradicts the model."""
    if not contradictions:
        return verdict
    what, remedy = contradictions[0]
    return Verdict("marginal" if verdict.known else verdict.state, f"{verdict.reason}, but {what}", remedy)


def _corrected(found: EffectEstimate, effects: Effects) -> str:
    typical_ms = float(np.exp(effects.log_typical_exposure))
    digits = 2 if found.name in LIGHT_FIXED_TO_CAMERA else 1
    share = f"{abs(found.value):.{digits}%} ± {found.sigma:.{digits}%}"
    if found.name in _ADDED_LIGHT:
        return _ADDED_LIGHT[found.name].format(share=share, typical=f"{typical_ms:.3g} ms")
    if found.name in GAIN_STEPS:
        limit_ms = effects.step_exposures[GAIN_STEPS.index(found.name)] * typical_ms
        than = "brighter" if found.value > 0 else "darker"
        return (
            f"images are {share} {than} beyond exposures of {limit_ms:.3g} ms than their exposures predict, as with "
            "a gain that is not exact; this was corrected"
        )
    if found.name == NOMINAL_EXPOSURES:
        return "exposures are nominal, such as 1/60 s for 1/64 s; the exact thirds of a stop were used instead"
    if found.name == LATE_EXPOSURES:
        when, lag = ("late" if found.value > 0 else "early"), f"{abs(found.value):.2f} ± {found.sigma:.1g}"
        return f"exposures are {lag} frames {when}; this was corrected"
    if found.name == UNSTEADY_LIGHT:
        return (
            f"frames are brighter or darker than their exposures predict, by {found.value:.1%} between pairs; "
            "this was accounted for"
        )
    offset = f"{abs(found.value) * typical_ms:.3g} ± {found.sigma * typical_ms:.1g} ms"
    too = "short" if found.value > 0 else "long"
    return f"all exposures are {offset} too {too}; this was corrected"
