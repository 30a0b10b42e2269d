"""A calibrator that never blocks the camera."""

from __future__ import annotations

import atexit
import os
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from ospc.arrays import Image, number_of
from ospc.calibrator import OnlineCalibrator
from ospc.engine.frame_checks import check_is_frame
from ospc.errors import FrameError, OspcError, SettingError, message_of
from ospc.exposures.lag_choice import LagChoice
from ospc.live.status import LiveFindings, LiveStatus
from ospc.methods.preview import Preview
from ospc.photometry.calibration import Calibration
from ospc.pooling.prior_calibration import PriorCalibration
from ospc.recording import Frame
from ospc.recording.frame import UNNAMED
from ospc.settings import Settings
from ospc.settings.live import GOAL
from ospc.system.throttle import Throttle

QUEUE_BYTES = 64 * 2**20
"""Size of the queue of images in bytes, enough for the duration of a fit; frames are dropped when it is full."""

ADVICE_S, ADVICE_SHARE = 0.8, 0.05
"""Shortest interval between two updates of the advice in seconds, and the largest share of the time they may take."""


class LiveCalibrator(AbstractContextManager["LiveCalibrator"]):
    """Calibrates a camera while it runs: frames are accepted at once and processed by a background thread.

    It drives the same engine as :class:`~ospc.calibrator.OnlineCalibrator`. If no frame is dropped, the result is
    identical to the last bit, except that unreadable images are not counted if they are not needed. Images wait in a
    bounded queue while the thread is busy. If the queue is full, they are dropped, and only their exposures are
    kept. :meth:`push` may be called from any thread, a callback, or a coroutine.

    Parameters
    ----------
    settings
        Settings of the default method, or the name of a preset of it.
    correct_lag
        What to do about a lag of the exposures, as for :func:`~ospc.calibrator.calibrate`.
    prior
        An earlier calibration of the camera, such as that of a robot before its restart. It is used as long as the
        frames agree with it.
    goal
        Standard deviation of the inverse response and of the vignette, as a root mean square over grey levels and
        radii, at which the advice says that the capture is done.
    source
        Identification of the recording that is replayed; empty for a camera.

    Raises
    ------
    SettingError
        If the settings are those of preset "paper", which is too slow, or the goal is not positive.
    OspcError
        By :meth:`push`, :meth:`wait`, :meth:`calibration`, :meth:`save_state` and :attr:`status` in a forked process;
        by the first three also if the calibrator was closed or the background thread failed.

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
        prior: PriorCalibration | None = None,
        goal: float = GOAL,
        source: dict[str, Any] | None = None,
    ) -> None:
        self._engine = OnlineCalibrator(settings, correct_lag=correct_lag, prior=prior)
        self._engine.source = source or {}
        if not self._engine.settings.real_time:
            raise SettingError(f"preset {self._engine.settings.name} cannot keep up with a camera; use the default")
        if not (number_of(goal) or 0) > 0:
            raise SettingError(f"goal {goal!r} is not a standard deviation; give a positive number")
        self.goal = goal
        self._process = os.getpid()
        self._changed = threading.Condition()
        self._queue: deque[tuple[Callable[[], bool], int]] = deque()  # work, and the bytes of the image it holds
        self._waiting_bytes = 0
        self._asked: list[Future[Calibration]] = []
        self._closed = False
        self._failure: BaseException | None = None
        self._frames = self._dropped = self._unusable = 0
        self._found = LiveFindings(self._engine, goal)
        self._throttle = Throttle(ADVICE_S, ADVICE_SHARE)
        self._outdated = False  # whether frames were processed since the last advice
        self._worker = threading.Thread(target=self._work, name="ospc-live", daemon=True)
        self._worker.start()
        # At the end of the program, Python kills the thread, which aborts the process if OpenCV is at work in it.
        atexit.register(self.close)

    def push(self, frame: Frame) -> bool:
        """Accept the next frame without waiting for its processing, and return whether its image was kept.

        Images in memory are copied if they may be processed, because a driver may reuse its buffer.

        Raises
        ------
        FrameError
            If ``frame`` is not a :class:`~ospc.recording.frame.Frame`.
        """
        with self._running():
            check_is_frame(frame, self._frames)
            if frame.name == UNNAMED:
                frame = replace(frame, name=f"frame {self._frames}")
            needed, full = self._engine.may_need_image(self._frames), self._waiting_bytes >= QUEUE_BYTES
            work, size, kept = partial(self._engine.push_without_image, frame.exposure_ms, frame.name), 0, False
            # Queued frames may change which frames are needed, so the prediction counts only if the queue is empty.
            if not full and (needed or self._queue):
                try:
                    safe = with_safe_load(frame)
                    own = safe if frame.threads else in_memory(safe)
                    work, size, kept = partial(self._engine.push, own), 0 if own is safe else own.image.nbytes, True
                except FrameError as error:
                    work = partial(work, str(error))
            self._frames += 1
            self._dropped += needed and full
            self._enqueue(work, size)
            return kept

    def wait(self, most: int = 0) -> None:
        """Wait until at most ``most`` frames are queued, for example so that no frame of a recording is dropped.

        With ``most`` 0, :attr:`preview` and :attr:`status` are then up to date as well.

        Raises
        ------
        SettingError
            If it is no number or negative.
        """
        if number_of(most) is None or not most >= 0:
            raise SettingError(f"most is {most!r}; give a number of frames, 0 to wait for all")
        with self._running():
            self._changed.wait_for(
                lambda: (
                    self._failure or self._closed or (len(self._queue) <= most and not (self._outdated and most == 0))
                )
            )
            self._check()

    def calibration(self) -> Calibration:
        """Wait for and return the calibration from all frames pushed before this call.

        Raises
        ------
        OspcError
            If no frame could be used.
        """
        answer: Future[Calibration] = Future()
        with self._running():
            self._asked.append(answer)
            self._enqueue(partial(self._answer, answer))
        return answer.result()

    @property
    def status(self) -> LiveStatus:
        """The current status."""
        self._check_process()
        with self._changed:
            return self._found.status(self._frames, self._dropped, self._unusable)

    @property
    def preview(self) -> Preview | None:
        """Quick estimates and the observations behind them, a few tenths of a second old; None before the first."""
        return self._found.preview

    @property
    def latest(self) -> Calibration | None:
        """The latest estimated calibration, without waiting; None before the first."""
        return self._found.latest

    @property
    def first_reasons(self) -> tuple[str, ...]:
        """Reasons why the first unusable frames were skipped, at most three."""
        return self._engine.first_reasons

    def save_state(self, path: str | Path) -> Path:
        """Write the state, including the summary that ``ospc merge`` needs, to a file, and return its path.

        It has the frames processed so far; call :meth:`wait` first to include those that are queued.

        Raises
        ------
        FormatError
            If the file cannot be written.
        """
        self._check_process()
        return self._engine.save_state(path, complete=True)

    def close(self) -> None:
        """Stop the background thread once its current work is done; :attr:`latest` remains available.

        In a forked process this does nothing: the thread continues in the process that created it.
        """
        if self._process != os.getpid():
            return
        atexit.unregister(self.close)
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        if threading.current_thread() is not self._worker:
            self._worker.join()
            self._engine.end_threads()

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextmanager
    def _running(self) -> Iterator[None]:
        """Hold the lock while the background thread is known to be running."""
        self._check_process()
        with self._changed:
            self._check()
            yield

    def _check_process(self) -> None:
        """Refuse to work in a forked process, where a lock may be held by a thread that does not exist."""
        if self._process != os.getpid():
            raise OspcError("this live calibrator belongs to another process; create a new one after a fork")

    def _check(self) -> None:
        if self._failure is not None:
            raise _failed(self._failure)
        if self._closed:
            raise OspcError("this live calibrator was closed; get its calibration first, or create a new one")

    def _enqueue(self, work: Callable[[], bool], size: int = 0) -> None:
        self._queue.append((work, size))
        self._waiting_bytes += size
        self._changed.notify_all()

    # The background thread.

    def _work(self) -> None:
        try:
            while self._wait_for_work():
                if self._queue:
                    self._process_next()
                if self._outdated and self._throttle.due:
                    self._advise()
        except BaseException as error:
            with self._changed:
                self._failure = error
                # Pass the error on to all waiting callers.
                for answer in self._asked:
                    answer.set_exception(_failed(error))
                self._changed.notify_all()

    def _wait_for_work(self) -> bool:
        """Wait for something to do; return False once the calibrator is closed and all answers are given."""
        with self._changed:
            until_advice_s = self._throttle.remaining_s if self._outdated else None
            self._changed.wait_for(lambda: self._queue or self._closed, until_advice_s)
            return not self._closed or bool(self._asked)

    def _process_next(self) -> None:
        work, size = self._queue[0]
        used = work()
        with self._changed:
            self._unusable += not used
            self._outdated = True
            self._queue.popleft()
            self._waiting_bytes -= size
            self._changed.notify_all()
        self._found.follow(self._frames, used=used)

    def _advise(self) -> None:
        with self._throttle.timed():
            self._found.advise(self._frames)
            with self._changed:
                self._outdated = False
                self._changed.notify_all()

    def _answer(self, answer: Future[Calibration]) -> bool:
        """Complete a request for the calibration with an estimate, or with the error that prevented it."""
        try:
            answer.set_result(self._found.estimate(self._frames))
        except OspcError as error:
            answer.set_exception(error)
        with self._changed:
            self._asked.remove(answer)
        return True


def in_memory(frame: Frame) -> Frame:
    """Return a frame with its own copies of image and mask, for any thread; FrameError if it cannot be read."""
    image, mask = frame.image.copy(), None if frame.mask is None else frame.mask.copy()
    return replace(frame, load=lambda: image, mask=mask, verify=None, threads=True)


def with_safe_load(frame: Frame) -> Frame:
    """Return a frame whose image cannot be read if its loader fails in any way: one bad frame must not end a run."""

    def load() -> Image:
        try:
            return frame.image
        except OspcError:
            raise
        except Exception as error:
            raise FrameError(f"{frame.name}: its image cannot be read ({message_of(error)})") from error

    return replace(frame, load=load)


def _failed(failure: BaseException) -> OspcError:
    """Return the error for callers that need the background thread, chained to its failure."""
    error = OspcError(f"the background thread failed: {message_of(failure)}")
    error.__cause__ = failure
    return error
