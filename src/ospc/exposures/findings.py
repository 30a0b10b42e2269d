"""What the images show about the exposures: the lag, what is left unexplained, and whether to rely on them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import counted
from ospc.exposures.brightness import BrightnessChange
from ospc.exposures.brightness_report import BrightnessReport, brightness_report
from ospc.exposures.brightness_series import BrightnessSeries
from ospc.exposures.lag import estimate_lag, explained_by_inverse
from ospc.exposures.lag_choice import LagChoice, check_lag, lag_in_words
from ospc.exposures.lag_selection import LagEstimate
from ospc.exposures.table import ExposureReport, filled
from ospc.exposures.tone_mapping import NO_LOCAL_TONE, LocalTone, local_tone
from ospc.photometry.verdict import LATE_EXPOSURES, EffectEstimate, Verdict
from ospc.settings.exposures import (
    DOUBTED_LAG_FRAMES,
    DOUBTED_LAG_SIGMAS,
    DRIFT_FRAMES,
    MAX_UNEXPLAINED_SHARE,
    MIN_CHECKED_FRAMES,
    NOTABLE_RMS_LOG,
    REFUTED_LAG_FRAMES,
)

_CHANGE_IRREGULARLY = (
    "record a minute in which the exposure changes abruptly and irregularly: cover the lens for a moment, point at a "
    "window, switch a lamp"
)
_FIX_METADATA = (
    "read exposure and gain from each frame's own metadata, not from the driver's settings, and switch off tone "
    "mapping"
)
_STEADY_LIGHT = "record where no lamp flickers; if none does, " + _FIX_METADATA
_NO_DENOISING = "switch off temporal noise reduction, and whatever else mixes images"
_PROGRESSIVE = "record progressive frames, or take one field of each as a recording of half the height"
_GIVE_TIMES = (
    "give exposure times, not their inverses: 1/250 s is 4 ms, not 250; if they are times, record the gain as well"
)
_SLOWER = "record a well-exposed scene with even surfaces and some texture, and move slowly"
_MORE_FRAMES = "record sixty consecutive frames or more"


@dataclass(frozen=True)
class ExposureFindings:
    """What the images show about the exposures.

    Attributes
    ----------
    course
        The exposures as written.
    lag
        By how many frames they are written late, before any correction.
    corrected_frames
        The lag they are corrected by; 0 for none.
    brightness
        How much of the changes of brightness they explain; None where too few frames could be compared.
    local_tone
        Whether parts of the image follow the exposures differently; None where that is unknown.
    verdict
        Whether exposures and images agree.
    notes
        What was found and done.
    warnings
        Why the exposures, as they are used, cannot be relied on; empty if they can.
    """

    course: ExposureReport
    lag: LagEstimate
    corrected_frames: int
    brightness: BrightnessReport | None
    verdict: Verdict
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    local_tone: LocalTone | None = None

    @property
    def lag_frames(self) -> int | None:
        """By how many frames the exposures are written late; None where that cannot be determined."""
        return self.lag.frames

    def renumbered(self, offset: int) -> ExposureFindings:
        """Return the findings with an offset added to the numbers of their frames."""
        brightness = self.brightness
        if brightness is not None:
            jumps = tuple(replace(jump, frame=jump.frame + offset) for jump in brightness.jumps)
            brightness = replace(brightness, jumps=jumps)
        return replace(self, lag=replace(self.lag, frame=self.lag.frame + offset), brightness=brightness)

    def limited(self, verdict: Verdict) -> Verdict:
        """Return the verdict on response or vignette: marginal at best where exposures cannot be relied on."""
        if not self.warnings or not verdict.known:
            return verdict
        return Verdict("marginal", f"{verdict.reason}, but {'; '.join(self.warnings)}", self.verdict.remedy)

    def refuted_by(self, effects: Iterable[EffectEstimate]) -> bool:
        """Return whether a fit to the corrected exposures shows that they were right as written."""
        lateness = _lateness(effects)
        if lateness is None or abs(lateness.value) < DOUBTED_LAG_SIGMAS * lateness.sigma:
            return False
        return abs(self.corrected_frames + lateness.value) < REFUTED_LAG_FRAMES < abs(lateness.value)

    def without_correction(self) -> ExposureFindings:
        """Return the findings with the exposures as they are written, and their lag as an open question."""
        alone = f"changes of brightness alone suggest that they are written {lag_in_words(self.corrected_frames)}"
        reason = f"{alone}, but the fit shows that they belong to their frames"
        lag = replace(self.lag, state="refuted", candidates=(0, *self.lag.candidates))
        verdict = Verdict("marginal", reason, _CHANGE_IRREGULARLY)
        return replace(self, lag=lag, corrected_frames=0, verdict=verdict, notes=(_uncertain(reason),))

    def of_interlaced_images(self) -> ExposureFindings:
        """Return the findings on images of which only every other row is exposed when their exposures say."""
        reason = "every other row of the images shows another moment, as in interlaced video"
        return self.with_warning(reason, _PROGRESSIVE)

    def judged_by(self, effects: Iterable[EffectEstimate]) -> ExposureFindings:
        """Return the findings after a fit: how late it shows exposures to be may settle a doubt, or raise one."""
        lateness = _lateness(effects)
        return self if lateness is None else self._confirmed_by(lateness)._doubted_by(lateness)

    def _confirmed_by(self, lateness: EffectEstimate) -> ExposureFindings:
        """Return the findings, without a lag if a fit shows it where changes of brightness alone leave it open."""
        is_open = self.lag.state == "ambiguous" and 0 in self.lag.candidates and not self.corrected_frames
        if not is_open or self.warnings or self.verdict.state != "marginal":
            return self
        if abs(lateness.value) + DOUBTED_LAG_SIGMAS * lateness.sigma > REFUTED_LAG_FRAMES:
            return self
        lag = replace(self.lag, state="determined", candidates=(0,))
        alone = f"changes of brightness alone allow for lags of {_either(self.lag)} frames"
        reason = f"exposures belong to their frames, as the fit shows; {alone}"
        notes = tuple(note for note in self.notes if note != _uncertain(self.verdict.reason))
        return replace(self, lag=lag, verdict=Verdict("identifiable", reason), notes=notes)

    def _doubted_by(self, lateness: EffectEstimate) -> ExposureFindings:
        """Return the findings, marginal if a fit shows exposures late or early for no reason that it can correct."""
        # Exposures that are stamped or interpolated come late by a part of a frame, and that is corrected.
        usual = lateness.corrected and self.corrected_frames + lateness.value > 0
        if self.verdict.state != "identifiable" or usual:
            return self
        frames = abs(lateness.value)
        if frames < max(DOUBTED_LAG_FRAMES, DOUBTED_LAG_SIGMAS * lateness.sigma):
            return self
        lag = f"{frames:.1f} ± {lateness.sigma:.1g} frames {'late' if lateness.value > 0 else 'early'}"
        if lateness.corrected:
            mixed = f"each image seems to have some of the one before in it: exposures are {lag}"
            return self.with_warning(mixed, _NO_DENOISING)
        reason = f"{self.verdict.reason}, but the fit shows them {lag}"
        return replace(self, verdict=Verdict("marginal", reason, _CHANGE_IRREGULARLY))

    def with_warning(self, reason: str, remedy: str) -> ExposureFindings:
        """Return the findings, marginal at best for a reason that concerns response and vignette as well."""
        verdict = Verdict("marginal", reason, remedy) if self.verdict.known else self.verdict
        return replace(self, verdict=verdict, warnings=(*self.warnings, reason))


def _lateness(effects: Iterable[EffectEstimate]) -> EffectEstimate | None:
    return next((effect for effect in effects if effect.name == LATE_EXPOSURES), None)


def _uncertain(reason: str) -> str:
    return f"whether exposures belong to their frames is not certain: {reason}"


def assess_exposures(
    changes: Sequence[BrightnessChange], log_exposure: FloatArray, choice: LagChoice = "auto", *, first_frame: int = 0
) -> ExposureFindings:
    """Compare the changes of brightness with the exposures written.

    Parameters
    ----------
    changes
        Changes of brightness between consecutive frames, in the order of frames.
    log_exposure
        ln of the exposure written beside every frame, NaN where there is none, shape (frames,).
    choice
        What to do about a lag.
    first_frame
        Number of the first frame that counts.
    """
    series = BrightnessSeries.from_changes(changes).renumbered(-first_frame)
    found = _assess_choice(series, filled(log_exposure[first_frame:]), choice).renumbered(first_frame)
    return found if choice == "trusted" else _with_local_tone(found, changes, filled(log_exposure))


def _assess_choice(series: BrightnessSeries, written: FloatArray, choice: LagChoice) -> ExposureFindings:
    if isinstance(choice, int):
        found = _assess_shifted(series, written, choice)
        return replace(_as_stated(found, choice), corrected_frames=choice)
    found = _assess(series, written)
    if choice == "trusted":
        reason = "the exposures were estimated from the images"
        return replace(found, verdict=Verdict("marginal", reason), notes=(), warnings=())
    certain = found.lag.correction(found.course.cycle_frames)
    if not certain or choice == "never":
        return found
    corrected = _assess_shifted(series, written, certain)
    note = (
        f"exposures are written {lag_in_words(certain)}, as {counted(found.lag.pairs, 'pair')} of frames show, and "
        "were moved to the frames they belong to; --correct-lag never leaves them"
    )
    return replace(corrected, lag=found.lag, corrected_frames=certain, notes=(note,))


def _as_stated(found: ExposureFindings, lag: int) -> ExposureFindings:
    """Leave no question open that only the images could not answer: the user, or the file format, states the lag."""
    asked = found.verdict.state == "marginal" and found.lag.frames is None and not found.warnings
    if not asked or (found.lag.candidates and lag not in found.lag.candidates):
        return found
    whose = "belong to their frames" if lag == 0 else f"are written {lag_in_words(lag)}"
    reason = f"exposures {whose}, as stated; the images do not contradict it"
    return replace(found, verdict=Verdict("identifiable", reason), notes=())


def _with_local_tone(
    found: ExposureFindings, changes: Sequence[BrightnessChange], log_exposure: FloatArray
) -> ExposureFindings:
    """Look for local tone mapping, with the exposures moved by the most likely lag."""
    lag = found.lag.candidates[0] if found.lag.candidates else found.corrected_frames
    inside = [c for c in changes if c.frame0 + lag >= 0 and c.frame1 + lag < len(log_exposure)]
    exposure_change = np.array([log_exposure[c.frame1 + lag] - log_exposure[c.frame0 + lag] for c in inside])
    tone = local_tone(inside, exposure_change)
    found = replace(found, local_tone=tone)
    return found.with_warning(tone.text, NO_LOCAL_TONE) if tone is not None and tone.is_clear else found


def _assess_shifted(series: BrightnessSeries, written: FloatArray, lag: int) -> ExposureFindings:
    """Assess the exposures moved to earlier frames by a lag; the lag found is that of the exposures as written."""
    check_lag(lag, len(written))
    first, last = max(0, -lag), len(written) - max(0, lag)
    inside = series.with_exposures(len(written), 0, lag).renumbered(-first)
    found = _assess(inside, written[first + lag : last + lag])
    candidates = tuple(candidate + lag for candidate in found.lag.candidates)
    return replace(found, lag=replace(found.lag, candidates=candidates, frame=found.lag.frame + first))


def _assess(series: BrightnessSeries, written: FloatArray) -> ExposureFindings:
    course = ExposureReport.of(written)
    lag = estimate_lag(series, written)
    brightness = brightness_report(lag, written)
    few = brightness is None and len(written) < MIN_CHECKED_FRAMES
    # Whether exposures leave much of the brightness unexplained, at their lag or at whichever fits best.
    unlike = (
        brightness is not None
        and (lag.frames is not None or lag.state == "ambiguous")
        and brightness.unexplained_share > MAX_UNEXPLAINED_SHARE
        and brightness.unexplained_rms_log > NOTABLE_RMS_LOG
    )
    opposed = explained_by_inverse(lag, series, written)
    verdict = next(_verdicts(course, lag, brightness, len(written), opposed, unlike=unlike))
    late = bool(lag.candidates) and 0 not in lag.candidates
    contradicted = not verdict.known or late or unlike
    warnings = (verdict.reason,) if contradicted and not few else ()
    open_question = lag.frames is None and verdict.state == "marginal" and not few and not warnings
    notes = (_uncertain(verdict.reason),) if open_question else ()
    return ExposureFindings(course, lag, 0, brightness, verdict, notes, warnings)


def _verdicts(
    course: ExposureReport,
    lag: LagEstimate,
    brightness: BrightnessReport | None,
    frames: int,
    opposed: float,
    *,
    unlike: bool,
) -> Iterator[Verdict]:
    """Give the verdicts that hold, the one that matters most first."""
    if brightness is None and frames < MIN_CHECKED_FRAMES:
        few = f"the recording has only {counted(frames, 'frame')}, too few to check whether exposures belong to them"
        yield Verdict("marginal", few, _MORE_FRAMES)
        return
    if brightness is None:
        few = f"only {counted(lag.pairs, 'pair')} of consecutive frames could be compared"
        yield Verdict("marginal", f"{few}, too few to check the exposures", _SLOWER)
        return
    if brightness.stale:
        course_of = "stay as they are" if course.values == 1 else "often stay as they are"
        yield Verdict(
            "not identifiable",
            f"the exposures written {course_of} while the same things change in brightness, by "
            f"{_percent(brightness.unexplained_drift_log)} within {DRIFT_FRAMES} frames: the metadata are stale, or "
            f"a gain is missing in them",
            _FIX_METADATA,
        )
    if lag.state == "constant exposure":
        yield Verdict("identifiable", f"the exposure is constant at {course.in_words()}, and the images agree")
    if opposed > 1 - MAX_UNEXPLAINED_SHARE:
        yield Verdict(
            "not identifiable",
            f"the images get darker where the exposures written get longer: {opposed:.0%} of the changes of "
            "brightness follow their inverse",
            _GIVE_TIMES,
        )
    if lag.state == "no response to exposure":
        silent = f"exposures range over {course.in_words()}, but the brightness of the scene does not follow them"
        yield Verdict("not identifiable", silent, _FIX_METADATA)
    figure = f"{1 - brightness.unexplained_share:.0%} of the changes of brightness follow them"
    if unlike and not lag.frames:
        rest = f"the rest changes by {_percent(brightness.unexplained_rms_log)} a frame"
        cause = "which flicker or a hidden gain would explain"
        yield Verdict("marginal", f"exposures fit badly: only {figure}; {rest}, {cause}", _STEADY_LIGHT)
    certain = lag.correction(course.cycle_frames)
    if certain is None:
        yield _unknown_lag(course, lag)
    if certain:
        yield Verdict(
            "marginal",
            f"exposures are written {lag_in_words(certain)}; moved back, {figure}",
            f"leave --correct-lag at auto, or set it to {certain}",
        )
    theirs = "exposures belong to their frames"
    if lag.frames is None:
        theirs += f" or to others with the same ones, for they repeat every {course.cycle_frames} frames"
    yield Verdict("identifiable", f"{theirs}: {figure}")


def _either(lag: LagEstimate) -> str:
    """Return the lags that fit the images equally well, in words."""
    lags = sorted(lag.candidates)
    is_range = len(lags) > 2 and lags[-1] - lags[0] == len(lags) - 1
    return f"{lags[0]} to {lags[-1]}" if is_range else " or ".join(map(str, lags))


def _unknown_lag(course: ExposureReport, lag: LagEstimate) -> Verdict:
    either = _either(lag)
    reasons = {
        "changes too small": "the exposures change too little, where they could be compared, to check them",
        "too few pairs": f"only {counted(lag.pairs, 'pair')} of consecutive frames could be compared",
        "follows flicker": "the exposures follow a flickering light, which hides their lag",
        "between frames": f"the exposures fit best between two frames ({lag.fraction_frames:+.1f})",
        "out of range": f"the exposures fit best with a lag of {either} frames, the largest tried, which is unlikely",
        "changing": "the lag of the exposures differs between the two halves of the recording",
    }
    reason = reasons.get(lag.state, f"lags of {either} frames fit the images equally well")
    if lag.state == "ambiguous" and course.cycle_frames is not None:
        reason = f"the exposures repeat every {course.cycle_frames} frames: lags of {either} look the same"
    return Verdict("marginal", reason, _CHANGE_IRREGULARLY)


def _percent(log_change: float) -> str:
    """Return a change in per cent, with a decimal below ten."""
    return f"{np.expm1(log_change):.1%}" if log_change < 0.1 else f"{np.expm1(log_change):.0%}"
