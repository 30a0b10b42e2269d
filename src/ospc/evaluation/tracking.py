"""Measure the effect of a calibration on tracking: track points through the raw and the corrected recording.

Both sets of tracks start from the same points, detected in the raw frames, and use the same Lucas-Kanade method with
the same settings (:mod:`ospc.evaluation.lucas_kanade`):

- *raw*: in the grey values as recorded;
- *corrected*: in what the same camera would have recorded without vignette and at the longer exposure of the two
  frames (:class:`~ospc.evaluation.tracks.CorrectedFrames`). These images are encoded by the camera's own response, so
  both kinds of frames have similar grey levels, noise and contrast, and no setting favours one of them.

A track ends when it is lost. It is censored when it leaves the image or the recording ends. It is lost if tracking to
the next frame fails, or if the brightness of its window has changed so much since its first frame that a direct
method would reject it (monitoring against the first appearance as in Shi and Tomasi 1994, but by brightness alone).
Abrupt exposure changes cause the former, slow ones the latter. Losses are counted by cause.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ospc.errors import NotObservableError, counted
from ospc.evaluation.tracks import TrackFigures, Tracks
from ospc.photometry.correction import Corrector
from ospc.recording import Frame, Recording
from ospc.recording.stream import usable_frames
from ospc.settings.evaluation import NOTICEABLE_RATIO, TRACKS_EVERY_FRAMES


@dataclass(frozen=True)
class TrackingComparison:
    """The effect of a calibration on tracking.

    The residuals of ``raw`` and ``corrected`` frames are computed at the same points: along the track in the
    corrected frames or, if only that one is lost, along the raw one. ``tracks`` is the number of tracks, ``frames``
    the number of frames used, and ``skipped`` the number of unusable ones. Each track is followed for at most
    ``horizon`` frames. ``largest_step`` is the largest exposure ratio of two consecutive frames.
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
        """Mean life in corrected frames over the mean life in raw ones."""
        return self.corrected.mean_life / self.raw.mean_life

    @property
    def residual_ratio(self) -> float:
        """Factor by which correction reduces the residual."""
        return self.raw.residual / self.corrected.residual

    @property
    def sentence(self) -> str:
        """The result as one sentence."""
        gains = [self.life_ratio, self.residual_ratio]
        better = any(gain > NOTICEABLE_RATIO for gain in gains)
        worse = any(gain < 1 / NOTICEABLE_RATIO for gain in gains)
        verdict = {
            (True, False): "helps",
            (True, True): "helps in one respect and harms in another",
            (False, True): "harms (is it for this camera, and do the exposures belong to their frames?)",
            (False, False): "hardly changes anything here",
        }[better, worse]
        life = f"{self.raw.mean_life:.1f} → {self.corrected.mean_life:.1f} of at most {self.horizon} frames"
        residual = f"{self.raw.residual:.3f} → {self.corrected.residual:.3f} of the local contrast"
        longer = _times(self.life_ratio, "long", "as long as before")
        smaller = _times(1 / self.residual_ratio, "large", "as before")
        return (
            f"The calibration {verdict}: tracks last {longer} ({life}), and their brightness residual is {smaller} "
            f"({residual})."
        )


def _times(ratio: float, what: str, same: str) -> str:
    """Return a ratio as text, such as "4.2 times as long" or "1/20 as large"."""
    if not ratio > 0:
        return "unknown"
    if 1 / NOTICEABLE_RATIO <= ratio <= NOTICEABLE_RATIO:
        return same
    number = max(ratio, 1 / ratio)
    digits = f"{number:.0f}" if number >= 10 else f"{number:.1f}"
    return f"{digits} times as {what}" if ratio > 1 else f"1/{digits} as {what}"


def compare_tracking(
    recording: Recording, corrector: Corrector, progress: Callable[[int, int], None] = lambda _done, _total: None
) -> TrackingComparison:
    """Track points through the raw and the corrected frames of a recording.

    ``progress`` is called with the number of frames done and the total.

    Raises
    ------
    NotObservableError
        If the calibration lacks a part, fewer than two frames can be read, or nothing in them can be tracked.
    SettingError
        If the calibration is for images of another size.
    """
    tracks = Tracks(corrector)
    before: Frame | None = None
    used, largest = 0, 1.0
    skipped: list[str] = []
    for frame in usable_frames(recording, skipped.append):
        progress(frame.index + 1, len(recording))
        if before is not None:
            tracks.follow(before, frame)
            ratio = before.exposure_ms / frame.exposure_ms
            largest = max(largest, ratio, 1 / ratio)
        if used % TRACKS_EVERY_FRAMES == 0:
            tracks.begin(frame)
        before, used = frame, used + 1
    raw, corrected, horizon = tracks.figures()
    if raw.steps == 0:
        raise NotObservableError(
            f"{recording.path}: nothing to track in {counted(used, 'readable frame')}; tracks need at least two "
            "frames with texture that is not saturated"
        )
    return TrackingComparison(raw, corrected, tracks.begun, used, len(skipped), horizon, largest)
