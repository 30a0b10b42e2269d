"""A calibrator that never keeps a camera waiting."""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import AsyncIterable, Iterable
from concurrent.futures import Future
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any

from ospc.calibrator import OnlineCalibrator
from ospc.errors import FrameError, OspcError, SettingError, counted, said_by
from ospc.exposures.findings import LagChoice
from ospc.live.advice import Adviser
from ospc.live.knowledge import GOAL
from ospc.live.status import LiveStatus
from ospc.methods.preview import Preview
from ospc.pace import Pace
from ospc.photometry.calibration import Calibration
from ospc.recording import Frame
from ospc.recording.stream import Item, frames_of
from ospc.settings import DefaultSettings, Settings

QUEUE_BYTES = 64 * 2**20
"""Images that wait for the background, in bytes: they cover the time of a fit. Beyond, frames are dropped."""

FIRST_ESTIMATE, ESTIMATE_GROWTH = 48, 2
"""Frames processed before the first estimate that nobody asked for, and how many times as many before each next."""

CONFIRMING = 12
"""Frames processed before the next estimate where the information so far says that the goal may be reached."""

LOOK_S, LOOK_SHARE = 0.4, 0.1
"""Shortest time in seconds between two looks for advice, and the largest share of the time that they may take."""


class LiveCalibrator:
    """Calibrates a camera while it runs: frames are taken at once, and processed by one thread in the background.

    It drives the same engine as :class:`~ospc.calibrator.OnlineCalibrator`: where no frame is dropped, the result is
    the same to the last bit. Only unreadable images that are not needed are not counted: nobody looks at them. Images
    wait in a bounded queue while the background is busy; beyond it they are dropped, and only their exposures are
    kept. :meth:`push` may be called by any thread, by a callback, or within a coroutine.

    Parameters
    ----------
    settings
        Settings of the default method, or the name of a preset of it.
    correct_lag
        What to do where exposures are written beside other frames than their own, as for
        :func:`~ospc.calibrator.calibrate`.
    goal
        Standard deviation of g and of V, as root mean squares, at which the advice is that it is done.
    source
        Identification of the recording that is replayed; empty for a camera.

    Raises
    ------
    SettingError
        If the settings are those of preset "paper", which is too slow for it, or the goal is not positive.

    Examples
    --------
    >>> with LiveCalibrator() as live:  # doctest: +SKIP
    ...     for image, exposure_ms in camera:
    ...         live.push(Frame.of_array(image, exposure_ms))
    ...     live.calibration().save("calibration.json")
    """

    def __init__(
        self,
        settings: Settings | str = "default",
        *,
        correct_lag: LagChoice = "auto",
        goal: float = GOAL,
        source: dict[str, Any] | None = None,
    ) -> None:
        self._engine = OnlineCalibrator(settings, correct_lag=correct_lag)
        self._engine.source = source or {}
        if not goal > 0:
            raise SettingError(f"goal {goal} is no standard deviation; give a positive number")
        self._adviser = Adviser(goal)
        self._pace = Pace(LOOK_S, LOOK_SHARE)
        self._preview: Preview | None = None
        self._confirmed: Calibration | None = None
        self._estimated_after = 0
        if not isinstance(self._engine.settings, DefaultSettings):
            raise SettingError(f"preset {self._engine.settings.name} cannot keep up with a camera; use the default")
        self._process = os.getpid()
        self._changed = threading.Condition()
        self._queue: deque[_Entry] = deque()
        self._waiting_bytes = 0
        self._asked: list[tuple[int, Future[Calibration]]] = []
        self._closed = False
        self._failure: BaseException | None = None
        self._frames = self._taken = self._dropped = self._unusable = 0
        self._next_estimate = FIRST_ESTIMATE
        self._known_epochs = 1
        self._latest: Calibration | None = None
        self._converged_after: int | None = None
        self._notes: list[str] = []
        self._unseen = False
        self._worker = threading.Thread(target=self._work, name="ospc-live", daemon=True)
        self._worker.start()

    def push(self, frame: Frame) -> bool:
        """Take the next frame, without waiting for any work on it, and return whether its image was kept.

        Images in memory are copied if they may be processed: a driver may fill its buffer anew.

        Raises
        ------
        OspcError
            If it was closed, the background failed, or the process was forked.
        """
        self._check_process()
        with self._changed:
            self._check()
            entry = self._entry(frame, self._engine.may_need(self._frames))
            self._frames += 1
            self._queue.append(entry)
            self._waiting_bytes += entry.bytes
            self._changed.notify_all()
            return entry.frame is not None

    def follow(self, source: Iterable[Item]) -> None:
        """Push whatever an iterable gives, until it ends; see :func:`~ospc.recording.stream.frames_of`."""
        for frame in frames_of(source):
            self.push(frame)

    async def follow_async(self, source: AsyncIterable[Frame]) -> None:
        """Push the frames of an asynchronous source, until it ends."""
        async for frame in source:
            self.push(frame)

    def wait(self, most: int = 0) -> None:
        """Wait until at most so many frames are waiting for the background; of a recording, none is dropped then.

        With none left, :attr:`preview` and :attr:`status` are up to date as well.

        Raises
        ------
        OspcError
            As :meth:`push`.
        """
        self._check_process()
        with self._changed:
            self._changed.wait_for(
                lambda: (
                    (len(self._queue) <= most and not (self._unseen and most == 0))
                    or self._failure is not None
                    or self._closed
                )
            )
            self._check()

    @property
    def status(self) -> LiveStatus:
        """Where it stands.

        Raises
        ------
        OspcError
            If the process was forked.
        """
        self._check_process()
        with self._changed:
            status, latest = self._engine.status, self._latest
            return LiveStatus(
                self._frames,
                self._engine.processed,
                self._dropped,
                self._unusable,
                status.skipped,
                latest is not None and latest.converged,
                self._converged_after,
                tuple(self._notes),
                self._engine.epochs,
                status.progress,
                self._adviser.instruction,
            )

    @property
    def preview(self) -> Preview | None:
        """Quick estimates and what they rest on, some tenths of a second old; None before there are any."""
        return self._preview

    @property
    def first_reasons(self) -> tuple[str, ...]:
        """Why the first frames that could not be used were skipped, at most three."""
        return self._engine.first_reasons

    @property
    def latest(self) -> Calibration | None:
        """The calibration last estimated, without waiting; None before the first."""
        return self._latest

    def calibration(self) -> Calibration:
        """Return what is known from all frames pushed so far; waits until the background has estimated it.

        Frames that are pushed meanwhile are not waited for.

        Raises
        ------
        OspcError
            If no frame could be used, it was closed, the background failed, or the process was forked.
        """
        self._check_process()
        with self._changed:
            self._check()
            answer: Future[Calibration] = Future()
            self._asked.append((self._frames, answer))
            self._changed.notify_all()
        return answer.result()

    def save_state(self, path: str | Path) -> Path:
        """Write all that is known to a file, as ``OnlineCalibrator.save_state`` does with its summary.

        Raises
        ------
        OspcError
            If the file cannot be written, a frame was processed in part only, or the process was forked.
        """
        self._check_process()
        return self._engine.save_state(path, complete=True)

    def close(self) -> None:
        """End the background once its present work is done; what is known stays in :attr:`latest`.

        In a fork this does nothing: the background goes on in the process that made it.
        """
        if self._process != os.getpid():
            return
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        if threading.current_thread() is not self._worker:
            self._worker.join()

    def __enter__(self) -> LiveCalibrator:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        self.close()

    def _check_process(self) -> None:
        """Refuse a fork, where no lock may be taken: a thread that is not there may hold it."""
        if self._process != os.getpid():
            raise OspcError("this live calibrator belongs to the process that made it; make a new one after a fork")

    def _check(self) -> None:
        if self._failure is not None:
            raise _failed(self._failure)
        if self._closed:
            raise OspcError("this live calibrator was closed; make a new one")

    def _entry(self, frame: Frame, wanted: bool) -> _Entry:
        """Return what is kept of a frame until the background takes it."""
        told = _Entry(frame.exposure_ms, frame.name)
        # What waits in the queue may change which frames are wanted: they are foreseen only while none waits.
        if not wanted and not self._queue:
            return told
        if self._waiting_bytes >= QUEUE_BYTES:
            self._dropped += wanted
            return told
        if frame.threads:
            return replace(told, frame=frame)
        try:
            image = frame.image.copy()
        except FrameError as error:
            return replace(told, unusable=str(error))
        own = replace(frame, load=lambda: image, verify=None, threads=True)
        return replace(told, frame=own, bytes=image.nbytes)

    # The background.

    def _work(self) -> None:
        try:
            while self._step():
                pass
        except BaseException as error:
            with self._changed:
                self._failure = error
                # Whoever waits has to learn of it.
                for _, answer in self._asked:
                    answer.set_exception(_failed(error))
                self._changed.notify_all()

    def _step(self) -> bool:
        """Do one piece of work; return whether there may be more."""
        with self._changed:
            until_look_s = self._pace.remaining_s if self._unseen else None
            self._changed.wait_for(lambda: self._queue or self._asked or self._closed, until_look_s)
            if self._closed and not self._asked:
                return False
            entry = self._queue[0] if self._queue else None
        if entry is not None:
            self._take(entry)
        if self._unseen and self._pace.due:
            with self._pace.look():
                self._advise()
        with self._changed:
            asked = [answer for frames, answer in self._asked if frames <= self._taken]
        if asked:
            self._answer(asked)
        return True

    def _answer(self, asked: list[Future[Calibration]]) -> None:
        """Give one estimate to all that have asked so far, or the reason why there is none."""
        try:
            found = self._estimate()
        except OspcError as error:
            for answer in asked:
                answer.set_exception(error)
        else:
            for answer in asked:
                answer.set_result(found)
        with self._changed:
            del self._asked[: len(asked)]

    def _take(self, entry: _Entry) -> None:
        if entry.frame is None:
            used = self._engine.note(entry.exposure_ms, entry.name, entry.unusable)
        else:
            used = self._engine.push(entry.frame)
        with self._changed:
            self._unusable += not used
            self._unseen = True
            self._taken += 1
            self._queue.popleft()
            self._waiting_bytes -= entry.bytes
            self._changed.notify_all()
        self._note_changes()
        if self._engine.processed >= self._next_estimate:
            self._next_estimate = ESTIMATE_GROWTH * self._engine.processed
            self._estimate()

    def _advise(self) -> None:
        self._preview = self._engine.preview()
        now = self._adviser.look(self._preview, time.monotonic(), self._confirmed)
        due = self._engine.processed >= self._estimated_after + CONFIRMING
        if due and now.kind != "done" and self._adviser.expects_end:
            self._estimate()  # quick figures leave out what only a complete estimate finds
        with self._changed:
            self._unseen = False
            self._changed.notify_all()

    def _note_changes(self) -> None:
        epochs = self._engine.epochs
        if len(epochs) > self._known_epochs:
            self._known_epochs = len(epochs)
            change = epochs[-2].change
            if change is not None:
                self._note(change.text)
            self._next_estimate = self._engine.processed + FIRST_ESTIMATE
            self._confirmed = None
            if self._latest is not None:
                self._latest = replace(self._latest, converged=False)

    def _estimate(self) -> Calibration:
        found = self._engine.calibration()
        if found.converged and (self._latest is None or not self._latest.converged):
            self._note(f"response and vignette are known after {counted(self._frames, 'frame')}")
            self._converged_after = self._converged_after or self._frames
        self._latest = self._confirmed = found
        self._estimated_after = self._engine.processed
        return found

    def _note(self, text: str) -> None:
        with self._changed:
            self._notes = [*self._notes, text][-MOST_NOTES:]


def _failed(failure: BaseException) -> OspcError:
    """Return what to say to whoever needs the background, caused by what ended it."""
    error = OspcError(f"the background failed: {said_by(failure)}")
    error.__cause__ = failure
    return error


MOST_NOTES = 20
"""Latest notes that are kept."""


@dataclass(frozen=True)
class _Entry:
    """A frame that waits for the background: without its image where that is not needed, unusable, or was dropped."""

    exposure_ms: float
    name: str
    frame: Frame | None = None
    unusable: str = ""
    bytes: int = 0
