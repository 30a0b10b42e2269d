"""Verdicts on the recorded exposures: whether they agree with the images, and what to do if they do not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from ospc.errors import counted
from ospc.exposures.brightness_report import (
    BrightnessReport,
    largest_error_of_points,
    largest_jump_of_pairs,
    unrefuted,
)
from ospc.exposures.evidence import ExposureEvidence
from ospc.exposures.findings import ExposureFindings
from ospc.exposures.lag_choice import lag_in_words
from ospc.exposures.lag_selection import UNRESPONSIVE, LagEstimate
from ospc.photometry.verdict import Verdict
from ospc.settings.brightness import CONTRADICTING_JUMP_LOG, DRIFT_FRAMES, EXPLAINED_POINTS
from ospc.settings.exposures import (
    BLENDED_LAG_FRAMES,
    DOUBTED_LAG_FRAMES,
    DOUBTED_LAG_SIGMAS,
    DOUBTED_WRONG_SHARE,
    MIN_CHECKED_FRAMES,
)

_CHANGE_IRREGULARLY = (
    "record for a minute with abrupt, irregular exposure changes: briefly cover the lens, point at a window, or "
    "switch a lamp on or off"
)
_FIX_METADATA = (
    "read exposure and gain from each frame's own metadata, not from the driver's settings, and switch off tone "
    "mapping"
)
_STEADY_LIGHT = "record under light that does not flicker; if there was no flicker, " + _FIX_METADATA
_GIVE_TIMES = (
    "give exposure times, not their inverses: 1/250 s is 4 ms, not 250; if they are times, record the gain as well"
)
_SLOWER = "record a well-exposed scene with uniform surfaces and some texture, and move slowly"
_MORE_FRAMES = (
    "record at least sixty consecutive frames; if the exposures surely belong to these images, set correct_lag to 0"
)
_NO_BLENDING = (
    "switch off temporal noise reduction and anything else that blends frames; if the images come from a video, "
    "record images or MJPEG instead"
)
_ONE_GAIN = "lock the gain and aperture, or record them; give all exposures in one unit; do not switch lamps"
_PROGRESSIVE = "record progressive video, or use one field of each frame as a recording of half the height"

_Standing = Literal["settled", "settled by fit", "open", "contradicted"]
"""Whether the exposures belong to the frames with which they are used."""


def findings_from(evidence: ExposureEvidence) -> ExposureFindings:
    """Return the findings that follow from all evidence; of the rules below, the first that applies decides."""
    by_fit, agreement, standing = _agreement(evidence)
    spoiled = _spoiled(evidence)
    lag, brightness = evidence.lag, evidence.brightness
    if standing == "settled by fit":
        lag = replace(lag, state="determined", candidates=(evidence.corrected_frames,))
    if brightness is not None:
        brightness = replace(
            brightness, jumps=unrefuted(brightness.jumps, evidence.ratios, evidence.corrected_frames)
        )
        if by_fit:
            # If exposures seem to have no effect, what they would explain looks like jumps.
            jumps = () if evidence.remaining_lag.state in UNRESPONSIVE else brightness.jumps
            brightness = replace(brightness, stale=False, fits_badly=False, jumps=jumps)
    uncertain = standing == "open" and not evidence.corrected_frames
    warned = [agreement, *spoiled] if standing == "contradicted" else spoiled
    return ExposureFindings(
        evidence,
        lag,
        brightness,
        verdict=_doubted(evidence, brightness, agreement, spoiled),
        question=f"it is uncertain whether exposures belong to their frames: {agreement.reason}" if uncertain else "",
        warnings=tuple(verdict.reason for verdict in warned),
    )


# Whether exposures and brightness agree, and if they do, whether the exposures belong to their frames.


def _agreement(evidence: ExposureEvidence) -> tuple[str, Verdict, _Standing]:
    """Return what a fit explains in spite of doubts, in words, and the verdict that follows."""
    if evidence.choice == "estimated":
        return "", Verdict("marginal", "the exposures were estimated from the images"), "settled"
    by_fit = _explained_by_fit(evidence)
    against = None if by_fit else _contradiction(evidence)
    if against is not None:
        return by_fit, against, "contradicted"
    return by_fit, *_on_lag(evidence, by_fit)


def _explained_by_fit(evidence: ExposureEvidence) -> str:
    """Return what a fit to exposures that images contradict explains, in words; empty if it leaves a doubt."""
    brightness = evidence.brightness
    if brightness is None or evidence.recorded.values == 1 or evidence.follows_inverse:
        return ""
    in_place = evidence.corrected_frames or not evidence.remaining_lag.frames
    doubted = brightness.stale or (
        (brightness.fits_badly or evidence.remaining_lag.state in UNRESPONSIVE) and in_place
    )
    error = largest_error_of_points(evidence.ratios) if doubted else None
    if error is None:
        return ""
    return (
        f"the brightness of {EXPLAINED_POINTS:.0%} of the scene points to within {np.expm1(error):.1%}, with the "
        "fitted curves"
    )


def _contradiction(evidence: ExposureEvidence) -> Verdict | None:
    """Return the verdict on exposures that contradict the images; None if they do not."""
    recorded, lag, brightness = evidence.recorded, evidence.remaining_lag, evidence.brightness
    if brightness is None:
        return None
    if brightness.stale:
        stay = "stay constant" if recorded.values == 1 else "often stay constant"
        changes = (
            f"the recorded exposures {stay} while the brightness of the same objects changes by "
            f"{_percent(brightness.drift_at_constant_exposure_log)} within {DRIFT_FRAMES} frames"
        )
        causes = "the metadata are stale, rounded or lack a gain, or much light is scattered in the lens"
        return Verdict("not identifiable", f"{changes}: {causes}", _FIX_METADATA)
    if evidence.follows_inverse:
        text = (
            "the images get darker when the recorded exposures get longer: the inverse of the exposures explains "
            f"{evidence.inverse_share:.0%} of the brightness changes"
        )
        return Verdict("not identifiable", text, _GIVE_TIMES)
    if lag.state == "no response to exposure":
        text = f"exposures range from {recorded.in_words()}, but the brightness of the scene does not follow them"
        return Verdict("not identifiable", text, _FIX_METADATA)
    if brightness.fits_badly and not lag.frames:
        rest = f"the rest, {_percent(brightness.unexplained_rms_log)} per frame, may be flicker or an unrecorded gain"
        only = "only " if round(1 - brightness.unexplained_share, 2) > 0 else ""
        text = f"exposures fit poorly: they explain {only}{_explained(brightness)}; {rest}"
        return Verdict("marginal", text, _STEADY_LIGHT)
    return None


def _on_lag(evidence: ExposureEvidence, by_fit: str) -> tuple[Verdict, _Standing]:
    """Return the verdict on exposures that explain the brightness, and on their lag."""
    lag, recorded, moved = evidence.remaining_lag, evidence.recorded, evidence.corrected_frames
    if evidence.brightness is None:
        return _on_unknown_lag(evidence)
    if lag.state == "constant exposure":
        text = f"the exposure is constant at {recorded.in_words()}, and the images agree"
        return Verdict("identifiable", text), "settled"
    if by_fit and moved:  # the fit is to the moved exposures
        lag = replace(lag, state="determined", candidates=(0,))
    explained = by_fit or _explained(evidence.brightness)
    certain = lag.certain_frames(recorded.cycle_frames)
    if certain is None:
        return _on_unknown_lag(evidence)
    if certain:
        late = certain + moved
        text = f"exposures are recorded {lag_in_words(late)}" if late else "exposures are recorded with their frames"
        text += f"; once moved {'' if late else 'back '}to their frames, they explain {explained}"
        return Verdict("marginal", text, f"set correct_lag to {late}"), "contradicted"
    text = "exposures belong to their frames"
    if lag.frames is None:
        text += f", or to others with the same exposure, because they repeat every {recorded.cycle_frames} frames"
    return Verdict("identifiable", f"{text}: they explain {explained}"), "settled"


def _on_unknown_lag(evidence: ExposureEvidence) -> tuple[Verdict, _Standing]:
    """Return the verdict on exposures whose lag the images leave open; it may be stated, or a fit may show it."""
    candidates, moved, compared = evidence.remaining_lag.candidates, evidence.corrected_frames, evidence.brightness
    if candidates and 0 not in candidates:
        return _open(evidence), "contradicted"
    if isinstance(evidence.choice, int):
        whose = f"be recorded {lag_in_words(moved)}" if moved else "belong to their frames"
        checked = "are too few or too different to check it" if compared is None else "do not contradict this"
        return Verdict("identifiable", f"exposures are taken to {whose}; the images {checked}"), "settled"
    if compared is None and evidence.frames < MIN_CHECKED_FRAMES:
        few = f"the recording has only {counted(evidence.frames, 'frame')}"
        text = f"{few}, too few to check whether exposures belong to them"
        return Verdict("marginal", text, _MORE_FRAMES), "settled"
    if compared is not None and evidence.recorded.changes_evenly and 0 in candidates:
        text = "exposures change by the same factor from frame to frame, so that a lag would not change their ratios"
        return Verdict("identifiable", f"{text}: they explain {_explained(compared)}"), "settled"
    if _fit_settles_lag(evidence):
        few = "consecutive frames overlap too little to check them otherwise"
        if compared is not None and candidates:
            few = f"brightness changes alone would also allow lags of {either(evidence.lag)} frames"
        text = f"exposures belong to their frames, as the fit shows; {few}"
        return Verdict("identifiable", text), "settled by fit"
    return _open(evidence), "open"


def _fit_settles_lag(evidence: ExposureEvidence) -> bool:
    """Return whether a fit to exposures as used settles a lag that the images leave open."""
    lag = evidence.remaining_lag
    # After large steps of the exposure, few points are exposed well in both of two consecutive frames.
    unknown = ("too few pairs", "refuted", *UNRESPONSIVE)
    can_be_zero = lag.state in unknown or (lag.state == "ambiguous" and 0 in lag.candidates)
    return can_be_zero and evidence.fit_shows_no_lag


def _open(evidence: ExposureEvidence) -> Verdict:
    """Return the verdict on exposures whose lag is unknown."""
    lag, cycle = evidence.remaining_lag.plus(evidence.corrected_frames), evidence.recorded.cycle_frames
    lags = either(lag)
    if evidence.brightness is None:
        few = f"only {counted(lag.pairs, 'pair')} of consecutive frames could be compared"
        return Verdict("marginal", f"{few}, too few to check the exposures", _SLOWER)
    small = "the exposures change too little between the compared frames to check them"
    reasons = {
        "changes too small": small,
        "no response to exposure": small,
        "follows flicker": "the exposures follow a flickering light, which hides their lag",
        "between frames": f"the exposures fit best between two frames (offset {lag.fraction_frames:+.1f} frames)",
        "out of range": f"the exposures fit best with a lag of {lags} frames, the largest tried, but implausible",
        "changing": "the lag of the exposures differs between the two halves of the recording",
    }
    reason = reasons.get(lag.state, f"lags of {lags} frames fit the images equally well")
    if lag.state == "ambiguous" and cycle is not None:
        reason = f"the exposures repeat every {cycle} frames: lags of {lags} cannot be distinguished"
    if lag.state == "refuted":
        suggested = f"brightness changes alone suggest that exposures are recorded {lag_in_words(lag.candidates[1])}"
        reason = f"{suggested}, but the fit shows that they belong to their frames"
    return Verdict("marginal", reason, _CHANGE_IRREGULARLY)


# What else makes exposures, or all that is found from them, doubtful.


def _spoiled(evidence: ExposureEvidence) -> list[Verdict]:
    """Return a verdict for everything that also spoils response and vignette, the gravest last."""
    found = []
    lag = _fitted_lag(evidence)
    if lag and evidence.late is not None and evidence.late.corrected:
        mixed = f"each image seems to contain part of the previous one: exposures are {lag}"
        found.append(Verdict("marginal", mixed, _NO_BLENDING))
    if evidence.interlaced:
        text = "alternate rows of the images show different moments, as in interlaced video"
        found.append(Verdict("marginal", text, _PROGRESSIVE))
    return found


def _doubted(
    evidence: ExposureEvidence, brightness: BrightnessReport | None, agreement: Verdict, spoiled: Sequence[Verdict]
) -> Verdict:
    """Return the verdict on exposures, given whether they agree with the images and what else is doubtful."""
    if not agreement.known:
        return agreement
    verdict = spoiled[-1] if spoiled else agreement
    if evidence.interlaced:
        return verdict
    lag = _fitted_lag(evidence)
    if lag and verdict.state == "identifiable":
        reason = f"{verdict.reason}, but the fit shows that they are {lag}"
        verdict = Verdict("marginal", reason, _CHANGE_IRREGULARLY)
    wrong = len(evidence.wrong)
    if wrong > DOUBTED_WRONG_SHARE * evidence.compared and verdict.state == "identifiable":
        reason = f"{verdict.reason}, but {wrong} of {counted(evidence.frames, 'exposure')} are wrong"
        verdict = Verdict("marginal", reason, _FIX_METADATA)
    # Consecutive frames show a jump, or the fitted exposure ratios of pairs of frames.
    jump = None if brightness is None else brightness.largest_jump
    if jump is None or abs(jump.log_change) < CONTRADICTING_JUMP_LOG:
        jump = largest_jump_of_pairs(evidence.ratios, () if brightness is None else brightness.momentary)
    return verdict if jump is None else Verdict("marginal", f"{verdict.reason}, but {jump.in_words}", _ONE_GAIN)


def _fitted_lag(evidence: ExposureEvidence) -> str:
    """Return the lag that a fit shows, in words; empty if there is none, or a usual one."""
    late = evidence.late
    if late is None:
        return ""
    # Time-stamped or interpolated exposures lag by a fraction of a frame, which the fit corrects.
    usual = late.corrected and evidence.corrected_frames + late.value > 0
    least_frames = BLENDED_LAG_FRAMES if late.corrected else DOUBTED_LAG_FRAMES
    frames = abs(late.value)
    if usual or frames < max(least_frames, DOUBTED_LAG_SIGMAS * late.sigma):
        return ""
    return f"{frames:.2g} ± {late.sigma:.1g} frames {'late' if late.value > 0 else 'early'}"


def _explained(brightness: BrightnessReport) -> str:
    """Return the share of the brightness changes that exposures explain; they may also add changes instead."""
    share = 1 - brightness.unexplained_share
    few = "hardly any" if share > 0 else "none"
    return f"{f'{share:.0%}' if round(share, 2) > 0 else few} of the brightness changes"


def either(lag: LagEstimate) -> str:
    """Return the candidate lags as text, such as "0 or 1" or "-1 to 2"."""
    lags = sorted(lag.candidates)
    is_range = len(lags) > 2 and lags[-1] - lags[0] == len(lags) - 1
    return f"{lags[0]} to {lags[-1]}" if is_range else " or ".join(map(str, lags))


def _percent(log_change: float) -> str:
    """Return a change in per cent, with one decimal below 10 %."""
    return f"{np.expm1(log_change):.1%}" if log_change < 0.1 else f"{np.expm1(log_change):.0%}"
