"""Assess the recorded exposures against the images: lag, unexplained brightness changes, and verdict."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.errors import counted
from ospc.exposures.brightness import BrightnessChange
from ospc.exposures.brightness_report import BrightnessReport, Jump, brightness_report, largest_jump_of_pairs
from ospc.exposures.brightness_series import BrightnessSeries
from ospc.exposures.lag import estimate_lag, explained_by_inverse
from ospc.exposures.lag_choice import LagChoice, lag_in_words, leaves_frames
from ospc.exposures.lag_selection import LagEstimate
from ospc.exposures.table import ExposureReport, filled, without
from ospc.exposures.tone_mapping import NO_LOCAL_TONE, LocalTone, local_tone
from ospc.exposures.verdicts import CHANGE_IRREGULARLY, either, verdict_on, verdict_on_lag
from ospc.exposures.wrong_exposures import away_from, in_words, unshown_steps, wrong_exposures
from ospc.photometry.coverage import ExposureRatios
from ospc.photometry.verdict import LATE_EXPOSURES, EffectEstimate, State, Verdict
from ospc.settings.brightness import (
    CONTRADICTING_JUMP_LOG,
    EXPLAINED_POINTS,
    EXPLAINED_SIGMAS,
    MIN_STALE_PAIRS,
    NOTABLE_RMS_LOG,
    UNCHANGED_EXPOSURE_LOG,
)
from ospc.settings.exposures import (
    BLENDED_LAG_FRAMES,
    DOUBTED_LAG_FRAMES,
    DOUBTED_LAG_SIGMAS,
    MIN_CHECKED_FRAMES,
    REFUTED_LAG_FRAMES,
)

_NO_BLENDING = (
    "switch off temporal noise reduction and anything else that blends frames; if the images come from a video, "
    "record images or MJPEG instead"
)
_ONE_GAIN = "lock the gain and aperture, or record them; give all exposures in one unit; do not switch lamps"
_PROGRESSIVE = "record progressive video, or use one field of each frame as a recording of half the height"


@dataclass(frozen=True)
class ExposureFindings:
    """What the images show about the exposures.

    Attributes
    ----------
    recorded
        Summary of the exposures as recorded.
    lag
        Estimated lag of the recorded exposures, before any correction.
    corrected_frames
        Lag that was corrected, in frames; 0 for none.
    brightness
        How well the exposures explain the brightness changes; None if too few frames could be compared.
    local_tone
        Signs of local tone mapping; None if unknown.
    wrong
        Frames whose recorded exposures are wrong and were ignored, in order.
    verdict
        Whether exposures and images agree.
    correction, question
        How the exposures were moved to their frames, and what is uncertain about their lag, as notes; empty if
        nothing was moved or is uncertain.
    warnings
        Why the exposures, as used, are unreliable; empty if they are reliable.
    """

    recorded: ExposureReport
    lag: LagEstimate
    corrected_frames: int
    brightness: BrightnessReport | None
    verdict: Verdict
    correction: str = ""
    question: str = ""
    warnings: tuple[str, ...] = ()
    local_tone: LocalTone | None = None
    wrong: tuple[int, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found and corrected, and what is uncertain."""
        ignored = in_words(self.wrong) if self.wrong else ""
        return tuple(filter(None, (ignored, self.correction, self.question)))

    @property
    def lag_frames(self) -> int | None:
        """Number of frames by which the exposures lag; None if it cannot be determined."""
        return self.lag.frames

    def renumbered(self, offset: int) -> ExposureFindings:
        """Return the findings with an offset added to all frame numbers."""
        brightness = self.brightness
        if brightness is not None:
            jumps = tuple(replace(jump, frame=jump.frame + offset) for jump in brightness.jumps)
            brightness = replace(brightness, jumps=jumps)
        return replace(self, lag=replace(self.lag, frame=self.lag.frame + offset), brightness=brightness)

    def limited(self, verdict: Verdict) -> Verdict:
        """Return a verdict on response or vignette, lowered to marginal if the exposures are unreliable."""
        misplaced = self.lag.frames is not None and self.lag.frames != self.corrected_frames
        if not self.warnings or not (verdict.known or misplaced):
            return verdict
        state: State = "marginal" if verdict.known else verdict.state
        return Verdict(state, "; ".join([verdict.reason, *self.warnings]), self.verdict.remedy)

    def refuted_by(self, effects: Iterable[EffectEstimate]) -> bool:
        """Return whether a fit to the corrected exposures shows that they were right as recorded."""
        lateness = _lateness(effects)
        if lateness is None or abs(lateness.value) < DOUBTED_LAG_SIGMAS * lateness.sigma:
            return False
        return abs(self.corrected_frames + lateness.value) < REFUTED_LAG_FRAMES < abs(lateness.value)

    def without_correction(self) -> ExposureFindings:
        """Return the findings with the exposures as recorded and their lag undetermined."""
        reason = (
            f"brightness changes alone suggest that exposures are recorded {lag_in_words(self.corrected_frames)}, "
            "but the fit shows that they belong to their frames"
        )
        lag = replace(self.lag, state="refuted", candidates=(0, *self.lag.candidates))
        verdict = Verdict("marginal", reason, CHANGE_IRREGULARLY)
        return replace(self, lag=lag, corrected_frames=0, verdict=verdict, correction="", question=_uncertain(reason))

    def of_interlaced_images(self) -> ExposureFindings:
        """Return the findings with a warning that the images are interlaced."""
        reason = "alternate rows of the images show different moments, as in interlaced video"
        return self.with_warning(reason, _PROGRESSIVE)

    def doubted_for_jumps(self, ratios: ExposureRatios) -> ExposureFindings:
        """Return the findings, marginal if the brightness once jumps by much more or less than the exposure.

        Consecutive frames show it, or the fitted exposure ratios of pairs of frames.
        """
        jump = None if self.brightness is None else self.brightness.largest_jump
        if jump is None or abs(jump.log_change) < CONTRADICTING_JUMP_LOG:
            jump = largest_jump_of_pairs(ratios)
        if jump is None or not self.verdict.known:
            return self
        return replace(self, verdict=Verdict("marginal", f"{self.verdict.reason}, but {jump.in_words}", _ONE_GAIN))

    def judged_by(self, effects: Iterable[EffectEstimate], ratios: ExposureRatios) -> ExposureFindings:
        """Return the findings updated by a fit: its lag and its exposure ratios may settle doubts or raise them."""
        found = self._explained_by(ratios)
        lateness = _lateness(effects)
        return found if lateness is None else found._confirmed_by(lateness)._doubted_by(lateness)

    def _explained_by(self, ratios: ExposureRatios) -> ExposureFindings:
        """Return the findings without stale or badly fitting exposures if the fit explains the brightness."""
        # Brightness changes are compared through a typical response, from which extreme ones differ too much, and in
        # thumbnails, in which regular facades are easily registered wrongly.
        brightness = self.brightness
        if brightness is None or self.recorded.values == 1 or len(self.warnings) != 1:  # or there are other doubts
            return self
        lag = replace(self.lag, state="determined", candidates=(0,)) if self.corrected_frames else self.lag
        is_stale, fits_badly = brightness.stale and not self.verdict.known, brightness.fits_badly and not lag.frames
        if not (is_stale or fits_badly):
            return self
        # Points are counted rather than pairs, because a pair whose registration failed has few.
        by_chance = 0.0 if ratios.log_sigma is None else EXPLAINED_SIGMAS * ratios.log_sigma
        error = np.abs(ratios.log_residual)
        error, relative, metadata = (
            np.repeat(values, ratios.samples)
            for values in (error, error / np.maximum(NOTABLE_RMS_LOG, by_chance), ratios.metadata)
        )
        unchanged = np.abs(np.log(metadata)) < UNCHANGED_EXPOSURE_LOG
        parts = [part for part in (np.ones_like(unchanged), unchanged) if part.any()]
        unexplained = any(np.quantile(relative[part], EXPLAINED_POINTS) > 1 for part in parts)
        if len(ratios.samples) < MIN_STALE_PAIRS or unexplained:
            return self
        largest = max(float(np.quantile(error[part], EXPLAINED_POINTS)) for part in parts)
        points = f"{EXPLAINED_POINTS:.0%} of the scene points to within {np.expm1(largest):.1%}"
        verdict = verdict_on_lag(self.recorded, lag, f"the brightness of {points}, with the fitted curves")
        question = "" if verdict.state == "identifiable" else _uncertain(verdict.reason)
        settled = replace(brightness, stale=False, fits_badly=False)
        return replace(self, brightness=settled, verdict=verdict, question=question, warnings=())

    def _confirmed_by(self, lateness: EffectEstimate) -> ExposureFindings:
        """Return the findings with a lag of 0 if only the fit shows it and brightness changes leave it open."""
        unseen = self.lag.state == "too few pairs" and self.question != ""
        is_open = unseen or (self.lag.state == "ambiguous" and 0 in self.lag.candidates)
        if not is_open or self.corrected_frames or self.warnings or self.verdict.state != "marginal":
            return self
        if abs(lateness.value) + DOUBTED_LAG_SIGMAS * lateness.sigma > REFUTED_LAG_FRAMES:
            return self
        lag = replace(self.lag, state="determined", candidates=(0,))
        allowed = f"brightness changes alone allow lags of {either(self.lag)} frames"
        alone = "consecutive frames overlap too little to check them otherwise" if unseen else allowed
        reason = f"exposures belong to their frames, as the fit shows; {alone}"
        return replace(self, lag=lag, verdict=Verdict("identifiable", reason), question="")

    def _doubted_by(self, lateness: EffectEstimate) -> ExposureFindings:
        """Return the findings, marginal if a fit shows a lag that it cannot correct."""
        # Time-stamped or interpolated exposures lag by a fraction of a frame, which the fit corrects.
        usual = lateness.corrected and self.corrected_frames + lateness.value > 0
        least_frames = BLENDED_LAG_FRAMES if lateness.corrected else DOUBTED_LAG_FRAMES
        frames = abs(lateness.value)
        if usual or frames < max(least_frames, DOUBTED_LAG_SIGMAS * lateness.sigma):
            return self
        lag = f"{frames:.2g} ± {lateness.sigma:.1g} frames {'late' if lateness.value > 0 else 'early'}"
        if lateness.corrected:
            mixed = f"each image seems to contain part of the previous one: exposures are {lag}"
            return self.with_warning(mixed, _NO_BLENDING)
        if self.verdict.state != "identifiable":
            return self
        reason = f"{self.verdict.reason}, but the fit shows that they are {lag}"
        return replace(self, verdict=Verdict("marginal", reason, CHANGE_IRREGULARLY))

    def with_warning(self, reason: str, remedy: str) -> ExposureFindings:
        """Return the findings, marginal at best, with a warning that also applies to response and vignette."""
        verdict = Verdict("marginal", reason, remedy) if self.verdict.known else self.verdict
        return replace(self, verdict=verdict, warnings=(*self.warnings, reason))


def _lateness(effects: Iterable[EffectEstimate]) -> EffectEstimate | None:
    return next((effect for effect in effects if effect.name == LATE_EXPOSURES), None)


def _uncertain(reason: str) -> str:
    return f"it is uncertain whether exposures belong to their frames: {reason}"


def assess_exposures(
    changes: Sequence[BrightnessChange], log_exposure: FloatArray, choice: LagChoice = "auto", *, first_frame: int = 0
) -> ExposureFindings:
    """Compare the brightness changes with the recorded exposures.

    Parameters
    ----------
    changes
        Brightness changes between consecutive frames, in frame order.
    log_exposure
        ln of the exposure recorded for each frame, NaN if missing, shape (frames,).
    choice
        What to do about a lag.
    first_frame
        Number of the first frame to use.
    """
    series = BrightnessSeries.from_changes(changes).renumbered(-first_frame)
    if choice == "estimated":
        return _assess_choice(series, filled(log_exposure[first_frame:]), choice).renumbered(first_frame)
    wrong = tuple((wrong_exposures(series, filled(log_exposure[first_frame:])) + first_frame).tolist())
    known = filled(without(log_exposure, wrong))
    steps = unshown_steps(series, known[first_frame:])
    found = _assess_choice(away_from(steps, series), known[first_frame:], choice)
    found = _with_jumps(found, steps, known[first_frame:]).renumbered(first_frame)
    found = _with_local_tone(found, changes, known)
    return replace(found, wrong=wrong)


def _with_jumps(found: ExposureFindings, steps: IntArray, log_exposure: FloatArray) -> ExposureFindings:
    """Return the findings with steps of the exposures, after these frames, that the images do not show."""
    if found.brightness is None or not len(steps):
        return found
    unshown = (Jump(at + 1, float(log_exposure[at] - log_exposure[at + 1])) for at in steps.tolist())
    jumps = tuple(sorted((*found.brightness.jumps, *unshown), key=lambda jump: jump.frame))
    return replace(found, brightness=replace(found.brightness, jumps=jumps))


def _assess_choice(series: BrightnessSeries, written: FloatArray, choice: LagChoice) -> ExposureFindings:
    if isinstance(choice, int):
        enough = leaves_frames(choice, len(written))
        found = (
            _assess_shifted(series, written, choice)
            if enough
            else _assess(BrightnessSeries.from_changes(()), written)
        )
        return replace(_as_stated(found, choice), corrected_frames=choice)
    found = _assess(series, written)
    if choice == "estimated":
        reason = "the exposures were estimated from the images"
        return replace(found, verdict=Verdict("marginal", reason), question="", warnings=())
    certain = found.lag.correction(found.recorded.cycle_frames)
    if not certain or choice == "never":
        return found
    corrected = _assess_shifted(series, written, certain)
    note = (
        f"exposures are recorded {lag_in_words(certain)}, as {counted(found.lag.pairs, 'pair')} of frames show, and "
        "were moved to their frames; use --correct-lag never to keep them as recorded"
    )
    return replace(corrected, lag=found.lag, corrected_frames=certain, correction=note, question="")


def _as_stated(found: ExposureFindings, lag: int) -> ExposureFindings:
    """Settle an open lag as stated by the user or the file format, unless the images contradict it."""
    is_open = found.verdict.state == "marginal" and found.lag.frames is None and not found.warnings
    if not is_open or (found.lag.candidates and lag not in found.lag.candidates):
        return found
    whose = "belong to their frames" if lag == 0 else f"are recorded {lag_in_words(lag)}"
    checked = "do not contradict this" if found.brightness is not None else "are too few or too different to check it"
    reason = f"exposures {whose}, as stated; the images {checked}"
    return replace(found, verdict=Verdict("identifiable", reason), question="")


def _with_local_tone(
    found: ExposureFindings, changes: Sequence[BrightnessChange], log_exposure: FloatArray
) -> ExposureFindings:
    """Look for local tone mapping, with the exposures shifted by the most likely lag."""
    lag = found.lag.candidates[0] if found.lag.candidates else found.corrected_frames
    inside = [c for c in changes if c.frame0 + lag >= 0 and c.frame1 + lag < len(log_exposure)]
    exposure_change = np.array([log_exposure[c.frame1 + lag] - log_exposure[c.frame0 + lag] for c in inside])
    tone = local_tone(inside, exposure_change)
    found = replace(found, local_tone=tone)
    return found.with_warning(tone.text, NO_LOCAL_TONE) if tone is not None and tone.is_clear else found


def _assess_shifted(series: BrightnessSeries, written: FloatArray, lag: int) -> ExposureFindings:
    """Assess the exposures shifted by a lag; the estimated lag refers to the exposures as recorded."""
    first, last = max(0, -lag), len(written) - max(0, lag)
    inside = series.with_exposures(len(written), 0, lag).renumbered(-first)
    found = _assess(inside, written[first + lag : last + lag], lag).renumbered(first)
    return replace(found, lag=found.lag.plus(lag))


def _assess(series: BrightnessSeries, written: FloatArray, moved: int = 0) -> ExposureFindings:
    """Assess exposures that were moved by a number of frames."""
    recorded = ExposureReport.of(written)
    lag = estimate_lag(series, written)
    brightness = brightness_report(lag, written)
    few = brightness is None and len(written) < MIN_CHECKED_FRAMES
    inverse_share = explained_by_inverse(lag, series, written)
    verdict = verdict_on(recorded, lag, brightness, len(written), inverse_share, moved=moved)
    late = bool(lag.candidates) and 0 not in lag.candidates
    contradicted = not verdict.known or late or (brightness is not None and brightness.fits_badly)
    warnings = (verdict.reason,) if contradicted and not few else ()
    is_open = lag.frames is None and verdict.state == "marginal" and not few and not warnings
    question = _uncertain(verdict.reason) if is_open else ""
    return ExposureFindings(recorded, lag, 0, brightness, verdict, question=question, warnings=warnings)
