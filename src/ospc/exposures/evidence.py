"""What shows whether the exposures of a recording belong to its frames, before it is judged."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

from ospc.arrays import FloatArray, IntArray
from ospc.errors import counted
from ospc.exposures.brightness import BrightnessChange
from ospc.exposures.brightness_report import BrightnessReport, Jump, brightness_report
from ospc.exposures.brightness_series import BrightnessSeries
from ospc.exposures.lag import estimate_lag, explained_by_inverse
from ospc.exposures.lag_choice import LagChoice, lag_in_words, leaves_frames
from ospc.exposures.lag_selection import LagEstimate
from ospc.exposures.table import ExposureReport, ExposureTable, filled, without
from ospc.exposures.wrong_exposures import away_from, unreal_steps, unshown_steps, wrong_exposures
from ospc.photometry.coverage import ExposureRatios
from ospc.photometry.verdict import LATE_EXPOSURES, EffectEstimate
from ospc.settings.exposures import DOUBTED_LAG_SIGMAS, MAX_SETTLED_LAG_FRAMES, MAX_UNEXPLAINED_SHARE


@dataclass(frozen=True)
class ExposureEvidence:
    """What the images, and later a fit of response and vignette, show about the exposures."""

    choice: LagChoice
    """What to do about a lag."""
    frames: int
    """Number of frames with an exposure of their own."""
    recorded: ExposureReport
    """Summary of the exposures of these frames."""
    lag: LagEstimate
    """Estimated lag of the recorded exposures, before any correction."""
    remaining_lag: LagEstimate
    """Estimated lag of the exposures as used, after any correction."""
    brightness: BrightnessReport | None
    """How well the exposures explain the brightness changes; None if too few frames could be compared."""
    inverse_share: float
    """Share of the brightness changes that the inverse of the exposures explains."""
    corrected_frames: int = 0
    """Lag that was corrected, in frames; 0 for none."""
    wrong: tuple[int, ...] = ()
    """Frames whose recorded exposures are wrong and were ignored, in order."""
    compared: int = 0
    """Number of pairs of consecutive frames in which these were searched for."""
    late: EffectEstimate | None = None
    """Fitted lag of the exposures as used; None if no fit estimated it."""
    ratios: ExposureRatios = field(default_factory=ExposureRatios.none)
    """Exposure ratios of pairs of frames according to the fit; none without a fit."""
    interlaced: bool = False
    """Whether the images are interlaced."""

    def renumbered(self, offset: int) -> ExposureEvidence:
        """Return the evidence with an offset added to the frame numbers of the lag and of the brightness."""
        brightness = self.brightness
        if brightness is not None:
            jumps = tuple(replace(jump, frame=jump.frame + offset) for jump in brightness.jumps)
            momentary = tuple(frame + offset for frame in brightness.momentary)
            brightness = replace(brightness, jumps=jumps, momentary=momentary)
        return replace(self, lag=replace(self.lag, frame=self.lag.frame + offset), brightness=brightness)

    @property
    def follows_inverse(self) -> bool:
        """Whether the brightness follows the inverse of the exposures, which no fit can explain."""
        return self.inverse_share > 1 - MAX_UNEXPLAINED_SHARE

    def with_fit(self, effects: Iterable[EffectEstimate], ratios: ExposureRatios) -> ExposureEvidence:
        """Return the evidence with that of a fit to the exposures as used."""
        late = next((effect for effect in effects if effect.name == LATE_EXPOSURES), None)
        return replace(self, late=late, ratios=ratios)

    @property
    def correction_note(self) -> str:
        """How the exposures were moved to their frames, as a note; empty if they were not, or as stated."""
        if self.choice != "auto" or not self.corrected_frames:
            return ""
        shown = (
            "the fit shows" if self.lag.state == "ambiguous" else f"{counted(self.lag.pairs, 'pair')} of frames show"
        )
        return (
            f"exposures are recorded {lag_in_words(self.corrected_frames)}, as {shown}, and were moved to their "
            "frames; set correct_lag to never to keep them as recorded"
        )

    def used(self, table: ExposureTable) -> ExposureTable:
        """Return the recorded exposures as they are used: without wrong ones, and each moved to its frame."""
        return replace(table.without(self.wrong), lag_frames=self.corrected_frames)

    @property
    def fit_doubts_correction(self) -> bool:
        """Whether the fit to exposures that were moved as the images suggest shows that they were moved too far."""
        if self.choice != "auto" or self.late is None or self.late.value * self.corrected_frames >= 0:
            return False
        return abs(self.late.value) >= DOUBTED_LAG_SIGMAS * self.late.sigma

    def lag_is_smaller_than(self, other: ExposureEvidence) -> bool:
        """Return whether a fit to these exposures shows less of a lag than a fit to others."""
        own, others = self.late, other.late
        return own is not None and others is not None and abs(own.value) < abs(others.value)

    @property
    def lag_of_fit(self) -> int:
        """The lag that the fit shows, of several that the images leave open; 0 if it shows none."""
        if self.choice != "auto" or self.corrected_frames or self.lag.state != "ambiguous" or self.late is None:
            return 0
        frames = round(self.late.value)
        clear = abs(self.late.value) > DOUBTED_LAG_SIGMAS * self.late.sigma
        return frames if clear and frames in self.lag.candidates else 0

    @property
    def fit_shows_no_lag(self) -> bool:
        """Whether the fit shows that the exposures, as used, belong to their frames."""
        late = self.late
        return late is not None and abs(late.value) + DOUBTED_LAG_SIGMAS * late.sigma <= MAX_SETTLED_LAG_FRAMES

    def moved(self, frames: int) -> ExposureEvidence:
        """Return the evidence, without that of a fit, about exposures moved by a lag that the images leave open."""
        moved = replace(self, remaining_lag=self.lag.plus(-frames), corrected_frames=frames)
        return moved.with_fit((), ExposureRatios.none())

    def without_correction(self) -> ExposureEvidence:
        """Return the evidence, without that of a fit, about exposures as recorded whose correction was refuted."""
        suggested = self.corrected_frames
        others = (lag for lag in self.lag.candidates if lag != suggested)
        lag = replace(self.lag, state="refuted", candidates=(0, suggested, *others))
        return replace(self, lag=lag, remaining_lag=lag, corrected_frames=0).with_fit((), ExposureRatios.none())


def evidence_of_images(
    changes: Sequence[BrightnessChange], log_exposure: FloatArray, choice: LagChoice = "auto", *, first_frame: int = 0
) -> ExposureEvidence:
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
        return _as_used(series, filled(log_exposure[first_frame:]), choice).renumbered(first_frame)
    wrong = tuple((wrong_exposures(series, filled(log_exposure[first_frame:])) + first_frame).tolist())
    known = filled(without(log_exposure, wrong))
    steps = unshown_steps(series, known[first_frame:])
    found = _with_choice(away_from(steps, series), known[first_frame:], choice)
    certain = unreal_steps(steps, series, known[first_frame:])
    found = _with_jumps(found, certain, known[first_frame:]).renumbered(first_frame)
    return replace(found, wrong=wrong, compared=len(series))


def _with_choice(series: BrightnessSeries, log_exposure: FloatArray, choice: LagChoice) -> ExposureEvidence:
    """Compare exposures that are moved by the chosen lag or, if it is to be found, by a certain one."""
    if isinstance(choice, int):
        if leaves_frames(choice, len(log_exposure)):
            return _moved(series, log_exposure, choice, choice)
        found = _as_used(BrightnessSeries.from_changes(()), log_exposure, choice)
        return replace(found, corrected_frames=choice)
    found = _as_used(series, log_exposure, choice)
    certain = found.lag.certain_frames(found.recorded.cycle_frames)
    if not certain or choice == "never":
        return found
    return replace(_moved(series, log_exposure, choice, certain), lag=found.lag)


def _moved(series: BrightnessSeries, log_exposure: FloatArray, choice: LagChoice, lag: int) -> ExposureEvidence:
    """Compare exposures that are moved by a lag; the estimated lag refers to the exposures as recorded."""
    first, last = max(0, -lag), len(log_exposure) - max(0, lag)
    inside = series.with_exposures(len(log_exposure), 0, lag).renumbered(-first)
    found = _as_used(inside, log_exposure[first + lag : last + lag], choice).renumbered(first)
    return replace(found, lag=found.lag.plus(lag), corrected_frames=lag)


def _as_used(series: BrightnessSeries, log_exposure: FloatArray, choice: LagChoice) -> ExposureEvidence:
    lag = estimate_lag(series, log_exposure)
    return ExposureEvidence(
        choice=choice,
        frames=len(log_exposure),
        recorded=ExposureReport.of(log_exposure),
        lag=lag,
        remaining_lag=lag,
        brightness=brightness_report(lag, log_exposure),
        inverse_share=explained_by_inverse(lag, series, log_exposure),
    )


def _with_jumps(found: ExposureEvidence, steps: IntArray, log_exposure: FloatArray) -> ExposureEvidence:
    """Return the evidence with steps of the exposures, after these frames, that the images do not show."""
    if found.brightness is None or not len(steps):
        return found
    unshown = (Jump(at + 1, float(log_exposure[at] - log_exposure[at + 1])) for at in steps.tolist())
    jumps = tuple(sorted((*found.brightness.jumps, *unshown), key=lambda jump: jump.frame))
    return replace(found, brightness=replace(found.brightness, jumps=jumps))
