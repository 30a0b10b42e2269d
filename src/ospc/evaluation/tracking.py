"""Does a calibration help, and how much: points followed through a recording as it is and corrected.

Both start from the same points, found in the frames as they are. Both are followed by the same Lucas–Kanade method
with the same settings (:class:`~ospc.evaluation.lucas_kanade.Follower`), from frame to frame:

- *raw*: in the grey values as recorded;
- *corrected*: in what the same camera would have recorded without vignette and at the longer exposure of the two
  frames (:class:`~ospc.evaluation.frame_kinds.CorrectedFrames`). Encoded by the camera's own response, the two kinds
  of frames have like grey levels, noise and contrast, and no setting suits one better.

A track's life ends when it is lost; when it leaves the image or the recording ends it merely stops being watched. It
is lost where the method from frame to frame loses it, or where its window is so much brighter or darker than when the
track began that direct methods, which compare with the frame a point was first seen in, would reject it (features are
monitored against their first appearance, as Shi and Tomasi 1994 do, by their brightness alone). The former happens
where the exposure leaps, the latter also where it creeps. How many were lost by which cause is counted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from ospc.errors import FrameError, NotObservableError
from ospc.evaluation.tracks import TrackFigures, TrackingSettings, Tracks
from ospc.photometry.correction import Corrector
from ospc.recording import Frame, Recording

_NOTICEABLE = 1.1
"""Ratio up to which nothing is claimed to have changed."""


@dataclass(frozen=True)
class TrackingComparison:
    """What a calibration does for tracking.

    Attributes
    ----------
    raw, corrected
        Figures of either kind of frames. Both residuals are read at the same places: along the track in the corrected
        frames, and where that is lost and the other is not, along the other.
    tracks
        Points that tracks began at.
    frames, skipped
        Frames used, and those that could not be read.
    horizon
        Frames that tracks were watched at most.
    largest_step
        Largest ratio of the exposures of two successive frames.
    """

    raw: TrackFigures
    corrected: TrackFigures
    tracks: int
    frames: int
    skipped: int
    horizon: int
    largest_step: float

    @property
    def life_ratio(self) -> float:
        """Mean life in corrected frames over that in raw ones."""
        return self.corrected.mean_life / self.raw.mean_life

    @property
    def residual_ratio(self) -> float:
        """Residual in raw frames over that in corrected ones: how many times smaller it is."""
        return self.raw.residual / self.corrected.residual

    @property
    def sentence(self) -> str:
        """The result as one sentence."""
        gains = [self.life_ratio, self.residual_ratio]
        better = any(gain > _NOTICEABLE for gain in gains)
        worse = any(gain < 1 / _NOTICEABLE for gain in gains)
        verdict = {
            (True, False): "helps",
            (True, True): "helps in one way and harms in another",
            (False, True): "harms (is it this camera's, and are the exposures those of their frames?)",
            (False, False): "hardly changes anything here",
        }[better, worse]
        life = f"{self.raw.mean_life:.1f} → {self.corrected.mean_life:.1f} of at most {self.horizon} frames"
        residual = f"{self.raw.residual:.3f} → {self.corrected.residual:.3f} of the local contrast"
        longer = _times(self.life_ratio, "long", "as long as before")
        smaller = _times(1 / self.residual_ratio, "large", "as before")
        return (
            f"The calibration {verdict}: tracks live {longer} ({life}), and their brightness residual is {smaller} "
            f"({residual})."
        )


def _times(ratio: float, what: str, same: str) -> str:
    """Say a ratio in words: 4.2 times as long, 1/20 as large."""
    if not ratio > 0:
        return "unknown"
    if 1 / _NOTICEABLE <= ratio <= _NOTICEABLE:
        return same
    number = max(ratio, 1 / ratio)
    digits = f"{number:.0f}" if number >= 10 else f"{number:.1f}"
    return f"{digits} times as {what}" if ratio > 1 else f"1/{digits} as {what}"


def compare_tracking(
    recording: Recording,
    corrector: Corrector,
    settings: TrackingSettings | None = None,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> TrackingComparison:
    """Follow points through a recording as it is and corrected.

    Parameters
    ----------
    recording
        The recording.
    corrector
        What corrects its images.
    settings
        How tracks are made.
    progress
        Called with the number of frames done and of all frames.

    Raises
    ------
    NotObservableError
        If the calibration lacks a part, less than two frames can be read, or nothing in them can be followed.
    SettingError
        If the calibration is for images of another size.
    """
    chosen = settings or TrackingSettings()
    tracks = Tracks(chosen, corrector)
    before: Frame | None = None
    used, skipped, largest = 0, 0, 1.0
    for number, frame in enumerate(_readable(recording), start=1):
        progress(number, len(recording))
        if frame is None:
            skipped += 1
            continue
        if before is not None:
            tracks.follow(before, frame)
            ratio = before.exposure_ms / frame.exposure_ms
            largest = max(largest, ratio, 1 / ratio)
        if used % chosen.every == 0:
            tracks.begin(frame)
        before, used = frame, used + 1
    raw, corrected, horizon = tracks.figures()
    if raw.steps == 0:
        raise NotObservableError(
            f"{recording.path}: nothing to follow in {used} readable frames; tracks need at least two frames with "
            f"structure that is not saturated"
        )
    return TrackingComparison(raw, corrected, tracks.begun, used, skipped, horizon, largest)


def _readable(recording: Recording) -> Iterator[Frame | None]:
    """Give the frames; None for those that cannot be read."""
    for frame in recording:
        try:
            _ = frame.image
        except FrameError:
            yield None
        else:
            yield frame
