"""From figures to judgements: what a calibration of this recording could find, and what to record instead."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ospc.diagnosis.exposures import BrightnessReport, ExposureReport
from ospc.diagnosis.lag import LagEstimate
from ospc.diagnosis.motion import MotionReport
from ospc.diagnosis.pixel_statistics import GREY_CELLS, PixelReport
from ospc.photometry.calibration import Verdict
from ospc.settings import DefaultSettings

_WEAK_RATIO = 1.25
_UNEXPLAINED_SHARE = 0.25
_NOTABLE_RMS_LOG = 0.006
_NARROW_GREY = 0.4
_WIDE_GREY = 0.6
_NEEDED_REACH = 0.1
_WEAK_REACH = 1.2
_FEW_FOUND = 0.25
_FEW_FRAMES = 40

_CHANGE_EXPOSURE = (
    "record with auto exposure on while moving between dark and bright places, or sweep the exposure by a factor of "
    "four or more"
)
_CHANGE_IRREGULARLY = (
    "record a minute in which the exposure changes abruptly and irregularly: cover the lens for a moment, point at a "
    "window, switch a lamp"
)
_MOVE_RADIALLY = (
    "pan and roll the camera so that the same objects cross the image between centre and corners, by a fifth of the "
    "half diagonal or more"
)
_FIX_METADATA = (
    "read exposure and gain from each frame's own metadata, not from the driver's settings, and switch off tone "
    "mapping"
)
_MIX_BRIGHTNESS = "film dark and bright things together, so that all grey levels occur at all exposures"
_MORE_FRAMES = (
    "take it from a longer recording, of sixty consecutive frames or more, if exposures may belong to others"
)
_SLOWER = "record a well-exposed scene with even surfaces and some texture, and move slowly"


@dataclass(frozen=True)
class Figures:
    """What verdicts are drawn from; attributes as in :class:`~ospc.diagnosis.report.RecordingReport`."""

    exposure: ExposureReport
    lag: LagEstimate
    brightness: BrightnessReport | None
    pixels: PixelReport
    motion: MotionReport
    settings: DefaultSettings
    frames: int

    @property
    def few_frames(self) -> bool:
        """Whether there are too few frames to check exposures, as in a series of photographs."""
        return self.brightness is None and self.frames < _FEW_FRAMES

    @property
    def constant(self) -> bool:
        """Whether the exposures hardly change."""
        return bool(np.log(self.exposure.ratio) < self.settings.min_log_exposure_change)


def verdicts(figures: Figures) -> dict[str, Verdict]:
    """Return the verdicts on ``"response"``, ``"vignette"`` and ``"exposures"``."""
    exposures = next(_exposures(figures))
    response = next(_response(figures, exposures))
    return {"response": response, "vignette": next(_vignette(figures, response, exposures)), "exposures": exposures}


# Each of these gives the verdicts that hold, the one that matters most first.


def _exposures(figures: Figures) -> Iterator[Verdict]:
    brightness, lag = figures.brightness, figures.lag
    if figures.few_frames:
        few = f"the recording has only {figures.frames} frames, too few to check whether exposures belong to them"
        yield Verdict("marginal", few, _MORE_FRAMES)
        return
    if brightness is None:
        few = f"only {lag.pairs} pairs of consecutive frames could be compared, too few to check the exposures"
        yield Verdict("marginal", few, _SLOWER)
        return
    if brightness.stale:
        course = "stay as they are" if figures.constant else "often stay as they are"
        yield Verdict(
            "not identifiable",
            f"the exposures written {course} while the same things change in brightness, by "
            f"{_percent(brightness.unexplained_drift_log)} within 40 frames: the metadata are stale, or a gain is "
            f"missing in them",
            _FIX_METADATA,
        )
    if lag.state == "constant exposure":
        agreed = f"the exposure is constant at {_range(figures.exposure)}, and the images agree"
        yield Verdict("identifiable", agreed)
    if lag.state == "no response to exposure":
        silent = f"exposures range over {_range(figures.exposure)}, but the brightness of things does not follow them"
        yield Verdict("not identifiable", silent, _FIX_METADATA)
    if lag.frames is None:
        yield _unknown_lag(figures)
        return
    figure = f"{1 - brightness.unexplained_share:.0%} of the changes of brightness follow them"
    if lag.frames != 0:
        yield Verdict(
            "marginal",
            f"exposures are written {_lag_in_words(lag.frames)}; moved back, {figure}",
            f"correct them by the lag of {lag.frames}: ospc convert --lag {lag.frames}",
        )
    if brightness.unexplained_share > _UNEXPLAINED_SHARE and brightness.unexplained_rms_log > _NOTABLE_RMS_LOG:
        rest = _percent(brightness.unexplained_rms_log)
        yield Verdict(
            "marginal", f"exposures fit badly: only {figure}; the rest changes by {rest} a frame", _FIX_METADATA
        )
    yield Verdict("identifiable", f"exposures belong to their frames: {figure}")


def _unknown_lag(figures: Figures) -> Verdict:
    lag = figures.lag
    either = " or ".join(str(frames) for frames in sorted(lag.candidates))
    reasons = {
        "changes too small": "the exposures change too little, where they could be compared, to check them",
        "too few pairs": f"only {lag.pairs} pairs of consecutive frames could be compared",
        "follows flicker": "the exposures follow a flickering light, which hides by how many frames they are late",
        "between frames": f"the exposures fit best between two frames ({lag.fraction_frames:+.1f})",
        "out of range": f"the exposures fit best with a lag of {either} frames, the largest tried, which is unlikely",
        "changing": "the exposures belong to other frames in one half of the recording than in the other",
    }
    reason = reasons.get(lag.state, f"the exposures fit with a lag of {either} frames alike")
    if lag.state == "ambiguous" and figures.exposure.cycle_frames is not None:
        reason = f"the exposures repeat every {figures.exposure.cycle_frames} frames: lags of {either} look the same"
    return Verdict("marginal", reason, _CHANGE_IRREGULARLY)


def _response(figures: Figures, exposures: Verdict) -> Iterator[Verdict]:
    if figures.constant:
        yield Verdict(
            "not identifiable",
            f"the exposure hardly changes ({_range(figures.exposure)}), so the response leaves no trace",
            _CHANGE_EXPOSURE,
        )
    if not exposures.known:
        unreliable = f"the exposures cannot be relied on: {exposures.reason}"
        yield Verdict("not identifiable", unreliable, exposures.remedy)
    covered = float(figures.pixels.covered_grey.mean())
    figure = (
        f"exposures of {_range(figures.exposure)}, and {covered:.0%} of the grey levels occur "
        f"({_levels_in_words(figures.pixels)})"
    )
    if covered < _NARROW_GREY:
        yield Verdict("marginal", f"{figure}: too few", _MIX_BRIGHTNESS)
    if exposures.state != "identifiable" and not figures.few_frames:
        yield Verdict("marginal", f"{figure}, but {exposures.reason}", exposures.remedy)
    if figures.exposure.ratio < _WEAK_RATIO:
        yield Verdict("marginal", f"{figure}: a small range of exposures", _CHANGE_EXPOSURE)
    if covered < _WIDE_GREY:
        yield Verdict("marginal", figure, _MIX_BRIGHTNESS)
    yield Verdict("identifiable", figure)


def _vignette(figures: Figures, response: Verdict, exposures: Verdict) -> Iterator[Verdict]:
    motion = figures.motion
    # A few dozen small frames show motion less exactly than a calibration does, which asks for less.
    needed = max(figures.settings.min_radial_reach, _NEEDED_REACH)
    if motion.still:
        yield Verdict("not identifiable", "the camera stands still: every point keeps its vignette", _MOVE_RADIALLY)
    if motion.radial_reach < needed:
        short = (
            f"nine in ten scene points move radially by less than {motion.radial_reach:.3f} of the half diagonal "
            f"({needed:g} is needed)"
        )
        yield Verdict("not identifiable", short, _MOVE_RADIALLY)
    if not response.known:
        yield Verdict("not identifiable", "without a response there is no irradiance to compare", response.remedy)
    figure = f"a tenth of the scene moves radially by {motion.radial_reach:.2f} of the half diagonal or more"
    if motion.found_share < _FEW_FOUND:
        lost = f"{figure}, but only {motion.found_share:.0%} of a frame is found in the next"
        yield Verdict("marginal", lost, _SLOWER)
    if motion.radial_reach < _WEAK_REACH * needed:
        yield Verdict("marginal", figure, _MOVE_RADIALLY)
    if exposures.state != "identifiable" and not figures.few_frames:
        yield Verdict("marginal", f"{figure}, but {exposures.reason}", exposures.remedy)
    yield Verdict("identifiable", figure)


def _range(exposure: ExposureReport) -> str:
    if exposure.values == 1:
        return f"{exposure.lowest_ms:.4g} ms"
    return f"{exposure.lowest_ms:.4g} to {exposure.highest_ms:.4g} ms"


def _percent(log_change: float) -> str:
    return f"{np.expm1(log_change):.1%}" if log_change < 0.1 else f"{np.expm1(log_change):.0%}"


def _lag_in_words(lag: int) -> str:
    frames = "frame" if abs(lag) == 1 else "frames"
    return f"{abs(lag)} {frames} {'late' if lag > 0 else 'early'}"


def _levels_in_words(pixels: PixelReport) -> str:
    covered = np.flatnonzero(pixels.covered_grey)
    if not len(covered):
        return "none"
    step = (pixels.max_grey + 1) / GREY_CELLS
    return f"grey {round(covered[0] * step)} to {round((covered[-1] + 1) * step) - 1} of {pixels.max_grey}"
