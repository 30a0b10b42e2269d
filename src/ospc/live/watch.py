"""Calibrate until it is known, then watch whether the camera is still the same."""

from __future__ import annotations

from dataclasses import replace

from ospc.calibrator import OnlineCalibrator, Status
from ospc.errors import SettingError
from ospc.photometry.calibration import Calibration
from ospc.pooling.pool import Pool
from ospc.pooling.prior_calibration import PriorCalibration
from ospc.recording import Frame
from ospc.settings import DefaultSettings, Settings, preset

FIRST_ESTIMATE = 32
"""Frames looked at before the first estimate; the next follow at one and a half times as many each."""

WATCHING_PAUSE = 12
"""Frames passed over between two looks once all is known: two to four looks a second with most cameras."""

SEGMENT = 192
"""Looks after which what was seen since the last such time is added to what was known before."""

_GROWTH = 1.5
_EVERY_FRAME = 10**9


class Watch:
    """Looks at frames one by one, in a thread's own time; the same frames give the same results.

    At first it collects and estimates now and then. Once response and vignette are known, it looks rarely, and
    compares what it sees with what is known: where they differ, the camera was changed, which is noted, and
    everything is estimated anew from the frames that follow.

    Parameters
    ----------
    settings
        Settings of the default method, or the name of a preset of it.

    Attributes
    ----------
    latest
        The calibration last estimated; None before the first. It is that of the camera as it is now.
    notes
        When it was first known, and what changed since; the last twenty.

    Raises
    ------
    SettingError
        If the settings are those of preset "paper", which is too slow for it.
    """

    REMEMBERED = 20

    def __init__(self, settings: Settings | str = "default") -> None:
        chosen = preset(settings) if isinstance(settings, str) else settings
        if not isinstance(chosen, DefaultSettings):
            raise SettingError(f"preset {chosen.name} cannot keep up with a camera; use the default preset")
        self._slowdown = chosen.frames_per_slowdown
        # What to pass over is decided here, before a frame is taken: those that come this far are looked at.
        self._settings = replace(chosen, frames_per_slowdown=_EVERY_FRAME, dense_frames=_EVERY_FRAME)
        self._calibrator = OnlineCalibrator(self._settings)
        self._looks = 0
        self._next_estimate = FIRST_ESTIMATE
        self._known: PriorCalibration | None = None
        self.latest: Calibration | None = None
        self.notes: tuple[str, ...] = ()
        self.changes = 0

    @property
    def status(self) -> Status:
        """Where the present segment stands."""
        return self._calibrator.status

    @property
    def watching(self) -> bool:
        """Whether all is known and only changes are looked for."""
        return self._known is not None

    @property
    def pause(self) -> int:
        """How many frames to pass over before the next look."""
        return max(self._looks // self._slowdown, WATCHING_PAUSE if self.watching else 0)

    def look(self, frame: Frame) -> bool:
        """Take the next frame, estimate if it is time to, and return whether the frame could be used."""
        used = self._calibrator.push(frame)
        self._looks += used
        if self._looks >= self._next_estimate:
            self._next_estimate = int(self._next_estimate * _GROWTH)
            self.estimate(frame)
        return used

    def estimate(self, frame: Frame | None = None) -> Calibration:
        """Return the calibration from all that was seen since the camera last changed.

        Parameters
        ----------
        frame
            The last frame looked at, to be named in a note.

        Raises
        ------
        OspcError
            If no frame could be used.
        """
        self._calibrator.earlier = self._known
        found = self._calibrator.calibration()
        when = "" if frame is None else f" at frame {frame.index}"
        changed = found.source.get("started_from", {}).get("changed", [])
        if changed:
            text = str(found.source["started_from"]["text"])
            self._note(f"the camera changed before it was looked at{when}: {text}")
            self.changes += 1
            # Some of the frames of this segment may be from before the change: all of them are given up.
            self._begin(None)
            self.latest = replace(found, converged=False)
        elif self._known is None and found.converged:
            self._note(f"response and vignette are known{when}")
            self.latest = found
            self._begin_watching([])
        else:
            self.latest = found
            if self._known is not None and self._looks >= SEGMENT:
                self._begin_watching([self._known])
        return self.latest

    def _begin_watching(self, known: list[PriorCalibration]) -> None:
        """Add this segment to what is known, and begin the next."""
        summary = self._calibrator.summary()
        if summary is not None:
            self._begin(PriorCalibration("what was seen before", Pool.of([*(k.summary for k in known), summary])))

    def _begin(self, known: PriorCalibration | None) -> None:
        self._known = known
        self._calibrator = OnlineCalibrator(self._settings)
        self._looks, self._next_estimate = 0, FIRST_ESTIMATE

    def _note(self, text: str) -> None:
        self.notes = (*self.notes, text)[-self.REMEMBERED :]
