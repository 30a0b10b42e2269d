"""Verdicts on the recorded exposures: whether they agree with the images, and what to do if they do not."""

from __future__ import annotations

import numpy as np

from ospc.errors import counted
from ospc.exposures.brightness_report import BrightnessReport
from ospc.exposures.lag_choice import lag_in_words
from ospc.exposures.lag_selection import LagEstimate
from ospc.exposures.table import ExposureReport
from ospc.photometry.verdict import Verdict
from ospc.settings.brightness import DRIFT_FRAMES
from ospc.settings.exposures import MAX_UNEXPLAINED_SHARE, MIN_CHECKED_FRAMES

CHANGE_IRREGULARLY = (
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
    "record at least sixty consecutive frames; if the exposures surely belong to these images, set --correct-lag to 0"
)


def verdict_on(
    recorded: ExposureReport,
    lag: LagEstimate,
    brightness: BrightnessReport | None,
    frames: int,
    inverse_share: float,
    *,
    moved: int = 0,
) -> Verdict:
    """Return the verdict on the exposures of a recording.

    Parameters
    ----------
    recorded, lag, brightness
        The parts of :class:`~ospc.exposures.findings.ExposureFindings`.
    frames
        Number of frames of the recording.
    inverse_share
        Share of the brightness changes that the inverse of the exposures explains.
    moved
        Number of frames by which the exposures were moved before, positive if they were recorded late.
    """
    if brightness is None and frames < MIN_CHECKED_FRAMES:
        few = f"the recording has only {counted(frames, 'frame')}, too few to check whether exposures belong to them"
        return Verdict("marginal", few, _MORE_FRAMES)
    if brightness is None:
        few = f"only {counted(lag.pairs, 'pair')} of consecutive frames could be compared"
        return Verdict("marginal", f"{few}, too few to check the exposures", _SLOWER)
    contradiction = _contradiction(recorded, lag, brightness, inverse_share)
    if contradiction is not None:
        return contradiction
    if lag.state == "constant exposure":
        return Verdict("identifiable", f"the exposure is constant at {recorded.in_words()}, and the images agree")
    return verdict_on_lag(recorded, lag, _explained(brightness), moved)


def _contradiction(
    recorded: ExposureReport,
    lag: LagEstimate,
    brightness: BrightnessReport,
    inverse_share: float,
) -> Verdict | None:
    """Return the verdict on exposures that contradict the images; None if they do not."""
    if brightness.stale:
        stay = "stay constant" if recorded.values == 1 else "often stay constant"
        changes = (
            f"the recorded exposures {stay} while the brightness of the same objects changes by "
            f"{_percent(brightness.drift_at_constant_exposure_log)} within {DRIFT_FRAMES} frames"
        )
        causes = "the metadata are stale, rounded or lack a gain"
        return Verdict("not identifiable", f"{changes}: {causes}", _FIX_METADATA)
    if inverse_share > 1 - MAX_UNEXPLAINED_SHARE:
        return Verdict(
            "not identifiable",
            "the images get darker when the recorded exposures get longer: the inverse of the exposures explains "
            f"{inverse_share:.0%} of the brightness changes",
            _GIVE_TIMES,
        )
    if lag.state == "no response to exposure":
        text = f"exposures range from {recorded.in_words()}, but the brightness of the scene does not follow them"
        return Verdict("not identifiable", text, _FIX_METADATA)
    if brightness.fits_badly and not lag.frames:
        rest = f"the rest, {_percent(brightness.unexplained_rms_log)} per frame, may be flicker or an unrecorded gain"
        only = "only " if round(1 - brightness.unexplained_share, 2) > 0 else ""
        text = f"exposures fit poorly: they explain {only}{_explained(brightness)}; {rest}"
        return Verdict("marginal", text, _STEADY_LIGHT)
    return None


def _explained(brightness: BrightnessReport) -> str:
    """Return the share of the brightness changes that exposures explain; they may also add changes instead."""
    share = 1 - brightness.unexplained_share
    few = "hardly any" if share > 0 else "none"
    return f"{f'{share:.0%}' if round(share, 2) > 0 else few} of the brightness changes"


def verdict_on_lag(recorded: ExposureReport, lag: LagEstimate, explained: str, moved: int = 0) -> Verdict:
    """Return the verdict on exposures that agree with the images, given in words what they explain.

    The lag is that of exposures that were ``moved`` by a number of frames before.
    """
    certain = lag.correction(recorded.cycle_frames)
    if certain is None:
        return _unknown_lag(recorded, lag.plus(moved))
    if certain:
        late = certain + moved
        text = f"exposures are recorded {lag_in_words(late)}" if late else "exposures are recorded with their frames"
        text += f"; once moved {'' if late else 'back '}to their frames, they explain {explained}"
        return Verdict("marginal", text, f"set --correct-lag to {late}")
    text = "exposures belong to their frames"
    if lag.frames is None:
        text += f", or to others with the same exposure, because they repeat every {recorded.cycle_frames} frames"
    return Verdict("identifiable", f"{text}: they explain {explained}")


def either(lag: LagEstimate) -> str:
    """Return the candidate lags as text, such as "0 or 1" or "-1 to 2"."""
    lags = sorted(lag.candidates)
    is_range = len(lags) > 2 and lags[-1] - lags[0] == len(lags) - 1
    return f"{lags[0]} to {lags[-1]}" if is_range else " or ".join(map(str, lags))


def _unknown_lag(recorded: ExposureReport, lag: LagEstimate) -> Verdict:
    lags = either(lag)
    reasons = {
        "changes too small": "the exposures change too little between the compared frames to check them",
        "too few pairs": f"only {counted(lag.pairs, 'pair')} of consecutive frames could be compared",
        "follows flicker": "the exposures follow a flickering light, which hides their lag",
        "between frames": f"the exposures fit best between two frames (offset {lag.fraction_frames:+.1f} frames)",
        "out of range": f"the exposures fit best with a lag of {lags} frames, the largest tried, but implausible",
        "changing": "the lag of the exposures differs between the two halves of the recording",
    }
    reason = reasons.get(lag.state, f"lags of {lags} frames fit the images equally well")
    if lag.state == "ambiguous" and recorded.cycle_frames is not None:
        reason = f"the exposures repeat every {recorded.cycle_frames} frames: lags of {lags} cannot be distinguished"
    return Verdict("marginal", reason, CHANGE_IRREGULARLY)


def _percent(log_change: float) -> str:
    """Return a change in per cent, with one decimal below 10 %."""
    return f"{np.expm1(log_change):.1%}" if log_change < 0.1 else f"{np.expm1(log_change):.0%}"
