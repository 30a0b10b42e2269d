"""A calibrator that never keeps a camera waiting."""

from __future__ import annotations

import threading
from collections.abc import AsyncIterable, Iterable
from concurrent.futures import Future
from dataclasses import dataclass, replace
from types import TracebackType

from ospc.errors import FrameError, OspcError
from ospc.live.watch import Watch
from ospc.methods.method import Progress
from ospc.photometry.calibration import Calibration
from ospc.recording import Frame
from ospc.recording.stream import Item, frames_of
from ospc.settings import Settings


@dataclass(frozen=True)
class LiveStatus:
    """Where a live calibration stands; taken without waiting.

    Attributes
    ----------
    frames
        Frames taken so far.
    looked
        Frames that the background has looked at.
    busy
        Frames that would have been worth a look, but the background was busy.
    unusable
        Frames that could not be used.
    reasons
        Why frames could not be used, the most recent last.
    converged
        Whether response and vignette are known.
    converged_after
        Frames taken when they first were; None before.
    notes
        When they were known, and whether and how the camera changed since.
    progress
        The method's own figures.
    """

    frames: int
    looked: int
    busy: int
    unusable: int
    reasons: tuple[str, ...]
    converged: bool
    converged_after: int | None
    notes: tuple[str, ...]
    progress: Progress


class LiveCalibrator:
    """Calibrates a camera while it runs: frames are taken at once, and looked at by one thread in the background.

    The background holds one frame at a time. While it is busy, or has no need of more, frames are counted and let go:
    they are skipped, not queued. :meth:`push` may be called by any thread, by a callback, or within a coroutine.
    Which frames are looked at depends on time; for repeatable results use
    :class:`~ospc.calibrator.OnlineCalibrator`.

    Parameters
    ----------
    settings
        Settings of the default method, or the name of a preset of it.

    Raises
    ------
    SettingError
        If the settings are those of preset "paper", which is too slow for it.

    Examples
    --------
    >>> with LiveCalibrator() as live:  # doctest: +SKIP
    ...     for image, exposure_ms in camera:
    ...         live.push(Frame.of_array(image, exposure_ms))
    ...     live.calibration().save("calibration.json")
    """

    def __init__(self, settings: Settings | str = "default") -> None:
        self._watch = Watch(settings)
        self._changed = threading.Condition()
        self._waiting: Frame | None = None
        self._asked: list[Future[Calibration]] = []
        self._working = False
        self._closed = False
        self._failure: BaseException | None = None
        self._pause = 0
        self._frames = self._looked = self._busy = self._unusable = 0
        self._status = self._watch.status
        self._converged_after: int | None = None
        self._worker = threading.Thread(target=self._work, name="ospc-live", daemon=True)
        self._worker.start()

    def push(self, frame: Frame) -> bool:
        """Take the next frame, without waiting for any work on it, and return whether it will be looked at.

        Images in memory are copied if they will be looked at: a driver may fill its buffer anew.

        Raises
        ------
        OspcError
            If it was closed, or the background failed.
        """
        with self._changed:
            self._check()
            self._frames += 1
            if self._pause > 0:
                self._pause -= 1
                return False
            if self._working:
                self._busy += 1
                return False
            self._working = True
        try:
            own = _own(frame, self._frames - 1)
        except FrameError:
            with self._changed:
                self._working = False
                self._unusable += 1
            return False
        with self._changed:
            self._waiting = own
            self._changed.notify_all()
        return True

    def follow(self, source: Iterable[Item]) -> None:
        """Push whatever an iterable gives, until it ends; see :func:`~ospc.recording.stream.frames_of`."""
        for frame in frames_of(source):
            self.push(frame)

    async def follow_async(self, source: AsyncIterable[Frame]) -> None:
        """Push the frames of an asynchronous source, until it ends."""
        async for frame in source:
            self.push(frame)

    @property
    def status(self) -> LiveStatus:
        """Where it stands."""
        with self._changed:
            latest = self._watch.latest
            return LiveStatus(
                self._frames,
                self._looked,
                self._busy,
                self._unusable,
                self._status.skipped,
                self._watch.watching,
                self._converged_after,
                self._watch.notes,
                replace(self._status.progress) if latest is None or not self._watch.watching else _spreads(latest),
            )

    @property
    def latest(self) -> Calibration | None:
        """The calibration last estimated, without waiting; None before the first."""
        return self._watch.latest

    def calibration(self) -> Calibration:
        """Return what is known now; waits until the background has estimated it.

        Raises
        ------
        OspcError
            If no frame could be used, it was closed, or the background failed.
        """
        with self._changed:
            self._check()
            answer: Future[Calibration] = Future()
            self._asked.append(answer)
            self._changed.notify_all()
        return answer.result()

    def close(self) -> None:
        """End the background once its present work is done; what is known stays in :attr:`latest`."""
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

    def _check(self) -> None:
        if self._failure is not None:
            raise OspcError(f"the background failed: {self._failure}") from self._failure
        if self._closed:
            raise OspcError("this live calibrator was closed; make a new one")

    # The background.

    def _work(self) -> None:
        try:
            while self._step():
                pass
        except BaseException as error:
            with self._changed:
                self._failure = error
        finally:
            with self._changed:
                for answer in self._asked:
                    answer.set_exception(OspcError("the background ended before it could answer"))
                self._asked.clear()

    def _step(self) -> bool:
        """Do one piece of work; return whether there may be more."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting is not None or self._asked or self._closed)
            frame, self._waiting = self._waiting, None
            asked, self._asked = self._asked, []
            if frame is None and not asked:
                return False
        if frame is not None:
            self._look(frame)
        for answer in asked:
            try:
                answer.set_result(self._watch.estimate())
            except OspcError as error:
                answer.set_exception(error)
        return True

    def _look(self, frame: Frame) -> None:
        used = self._watch.look(frame)
        with self._changed:
            self._looked += 1
            self._unusable += not used
            self._status = self._watch.status
            self._pause = self._watch.pause
            if self._watch.watching and self._converged_after is None:
                self._converged_after = self._frames
            self._working = False


def _own(frame: Frame, index: int) -> Frame:
    """Return a frame that nobody else can change, numbered by its place in the stream."""
    if frame.threads:
        return replace(frame, index=index)
    image = frame.image.copy()
    return replace(frame, index=index, load=lambda: image, verify=None, threads=True)


def _spreads(known: Calibration) -> Progress:
    sigma = None if known.response is None else known.response.inverse_sigma
    return Progress(
        known.counts.get("pairs", 0),
        known.counts.get("samples", 0),
        None if sigma is None else float(sigma.max()),
        None if known.vignette_sigma is None else float(known.vignette_sigma[-1]),
    )
