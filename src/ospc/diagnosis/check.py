"""Checks a recording in seconds: a few hundred reduced frames, compared with their neighbours."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np

from ospc.arrays import FloatArray, Image, ImageSize
from ospc.diagnosis.brightness import BrightnessChange, Comparer
from ospc.diagnosis.exposures import ExposureReport, brightness_report
from ospc.diagnosis.frame_choice import choose_runs
from ospc.diagnosis.lag import MAX_LAG, LagEstimate, estimate_lag
from ospc.diagnosis.lag_likelihood import BrightnessChanges
from ospc.diagnosis.motion import AGES, motion
from ospc.diagnosis.notes import notes
from ospc.diagnosis.pixel_statistics import PixelStatistics
from ospc.diagnosis.report import RecordingReport
from ospc.diagnosis.thumbnail import Thumbnail, small_size, thumbnail
from ospc.diagnosis.timing import timing
from ospc.diagnosis.tone_mapping import LocalTone, local_tone
from ospc.diagnosis.verdicts import Figures, verdicts
from ospc.errors import FrameError, RecordingError, SettingError
from ospc.photometry.geometry import normalised, pixel_grid
from ospc.recording.frame import Frame
from ospc.recording.recording import Recording
from ospc.settings import DefaultSettings

DEFAULT_FRAMES = 240
_FEWEST_FRAMES = 2
_WIDE_EVERY = 8
_TELLING_LOG_CHANGE = 0.1


def check_recording(
    recording: Recording,
    *,
    frames: int = DEFAULT_FRAMES,
    max_lag: int = MAX_LAG,
    among: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> RecordingReport:
    """Say what a recording can tell of its camera, and what is wrong with it.

    Exposures and time stamps are looked at in full; images in runs of consecutive frames, up to a number of frames in
    all, each reduced to 160 pixels.

    Parameters
    ----------
    recording
        The recording.
    frames
        Most frames to look at.
    max_lag
        Largest lag of the metadata tried, either way, in frames.
    among
        Look only at some of the first so many frames, if the exposure changes there; None for the whole recording.
    progress
        Called with the number of frames looked at and to be looked at.

    Returns
    -------
    RecordingReport
        Figures, notes, and a verdict on response, vignette and exposures.

    Raises
    ------
    SettingError
        If ``frames`` is below 2 or ``max_lag`` below 1.
    RecordingError
        If none of the frames looked at can be read.
    """
    if frames < _FEWEST_FRAMES or max_lag < 1:
        raise SettingError(f"a check needs 2 frames or more and a lag of 1 or more, not {frames} and {max_lag}")
    look = _Look(recording.size)
    runs = choose_runs(_beginning(recording.exposures_ms, among), frames)
    wanted = [index for run in runs for index in run]
    starts, chosen = {run.start for run in runs}, set(wanted)
    for frame in recording:
        if frame.index not in chosen:
            continue
        if frame.index in starts:
            look.begin_run()
        look.at(frame)
        if progress is not None:
            progress(look.seen, len(wanted))
        if frame.index == wanted[-1]:
            break
    return _report(recording, look, tuple(wanted), max_lag)


def _beginning(exposures_ms: FloatArray, among: int | None) -> FloatArray:
    """Return the first exposures, if they tell as much as all do."""
    first = exposures_ms[:among]
    change = np.log(first.max() / first.min())
    return (
        first if change >= min(_TELLING_LOG_CHANGE, np.log(exposures_ms.max() / exposures_ms.min())) else exposures_ms
    )


class _Look:
    """Takes frames one by one and keeps what comparing them with earlier ones gives."""

    def __init__(self, size: ImageSize) -> None:
        width, height = small_size(size)
        self._radius = np.linalg.norm(normalised(pixel_grid((width, height)), (width, height)), axis=-1)
        self._compare = Comparer(size)
        self._recent: deque[Thumbnail] = deque(maxlen=max(AGES) + 1)
        self._before: Image | None = None
        self.seen = self.unreadable = self.compared = 0
        self.problem: FrameError | None = None
        self.duplicates: list[int] = []
        self.changes: list[BrightnessChange] = []
        self.wide_changes: list[BrightnessChange] = []
        self.pixels = PixelStatistics()

    def begin_run(self) -> None:
        """Forget the frames before: what follows is not consecutive to them."""
        self._recent.clear()
        self._before = None

    def at(self, frame: Frame) -> None:
        """Look at a frame."""
        self.seen += 1
        try:
            small = thumbnail(frame)
        except FrameError as error:
            self.unreadable += 1
            self.problem = self.problem or error
            self._before = None
            return
        self.pixels.add(frame, small, self._radius)
        if not self._repeats(frame):
            self._compare_with_earlier(small)
        self._recent.append(small)
        self._before = frame.image

    def _repeats(self, frame: Frame) -> bool:
        if self._before is None:
            return False
        self.compared += 1
        same = np.array_equal(self._before, frame.image) and np.ptp(frame.image) > 0
        if same:
            self.duplicates.append(frame.index)
        return bool(same)

    def _compare_with_earlier(self, small: Thumbnail) -> None:
        ages = {small.frame - earlier.frame: earlier for earlier in self._recent}
        if 1 in ages:
            self.changes.append(self._compare(ages[1], small))
        if small.frame % _WIDE_EVERY == 0:
            self.wide_changes += [self._compare(ages[age], small) for age in AGES if age in ages]


def _report(recording: Recording, look: _Look, looked_at: tuple[int, ...], max_lag: int) -> RecordingReport:
    pixels = look.pixels.report()
    if pixels is None:
        raise RecordingError(
            f"{recording.path}: none of the {look.seen} frames looked at can be read; the first: {look.problem}"
        )
    exposures_ms = recording.exposures_ms
    lag = estimate_lag(BrightnessChanges.of(look.changes), exposures_ms, max_lag)
    figures = Figures(
        ExposureReport.of(exposures_ms),
        lag,
        brightness_report(lag, exposures_ms),
        pixels,
        motion([*look.changes, *look.wide_changes], recording.size),
        DefaultSettings(),
        len(recording),
    )
    tone = _tone(look.changes, lag, exposures_ms)
    when = timing(recording.stamps_s, look.duplicates, look.compared)
    return RecordingReport(
        recording.path.name or recording.path.resolve().name,
        recording.kind,
        len(recording),
        recording.size,
        recording.max_grey,
        looked_at,
        look.unreadable,
        figures.exposure,
        lag,
        figures.brightness,
        tone,
        pixels,
        when,
        figures.motion,
        verdicts(figures),
        (*notes(figures, tone, when, look.unreadable), *recording.notes),
    )


def _tone(changes: list[BrightnessChange], lag: LagEstimate, exposures_ms: FloatArray) -> LocalTone | None:
    """Look for local tone mapping, with the exposures where they belong."""
    shift = lag.candidates[0] if lag.candidates else 0
    last = len(exposures_ms) - 1
    inside = [c for c in changes if c.frame0 + shift >= 0 and c.frame1 + shift <= last]
    log_exposure = np.log(exposures_ms)
    change = np.array([log_exposure[c.frame1 + shift] - log_exposure[c.frame0 + shift] for c in inside])
    return local_tone(inside, change)
