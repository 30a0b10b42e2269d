"""Decoding ahead: while one frame is processed, a thread decodes the next ones."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from itertools import islice

from ospc.arrays import Image
from ospc.recording.frame import Frame

_DECODED = 3
"""Images decoded ahead: enough to keep the thread busy, few enough for memory."""

_VERIFIED = 64
"""Frames taken and verified ahead; without their images they are small."""


def decoded_ahead(
    frames: Iterable[Frame],
    wanted: Callable[[int], bool],
    *,
    decoded: int = _DECODED,
    verified: int = _VERIFIED,
) -> Iterator[Frame]:
    """Yield the same frames in the same order, with images decoded ahead of time in a thread.

    Images and errors are the same as without; only the time of decoding differs. Frames that other threads cannot
    read (:attr:`Frame.threads`) are passed on unchanged.

    Parameters
    ----------
    frames
        The frames; only the calling thread iterates over them.
    wanted
        Called with how far a frame is ahead of the last one yielded, 1 for the next; returns whether its image will
        probably be read. A wrong answer only costs time.
    decoded
        Largest number of images decoded ahead.
    verified
        Largest number of frames taken ahead.
    """
    source = iter(frames)
    first = next(source, None)
    if first is None:
        return
    if not first.threads:
        yield first
        yield from source
        return
    with ThreadPoolExecutor(1, "ospc-decoding") as worker:
        queue: deque[_Prepared] = deque([_Prepared(first)])
        try:
            while queue:
                _fill(queue, source, wanted, worker, decoded=decoded, verified=verified)
                yield queue.popleft().frame
        finally:
            worker.shutdown(wait=True, cancel_futures=True)


class _Prepared:
    """A frame and the work in progress on it."""

    def __init__(self, frame: Frame) -> None:
        self.frame = frame
        self.decoding = False
        self._plain = frame

    def decode(self, worker: ThreadPoolExecutor) -> None:
        """Decode its image in the worker."""
        plain = self._plain
        # Not through the cached property, which in Python 3.11 holds a lock shared by all frames.
        job: Future[Image] = worker.submit(plain.load)
        # Decoding verifies the image too, so nothing is read twice.
        verify = None if plain.verify is None else lambda: _done(job)
        self.frame, self.decoding = replace(plain, load=job.result, verify=verify), True

    def check(self, worker: ThreadPoolExecutor) -> None:
        """Verify its image in the worker."""
        if self._plain.verify is not None and self._plain.threads:
            job: Future[None] = worker.submit(self._plain.verify)
            self.frame = replace(self._plain, verify=job.result)


def _done(job: Future[Image]) -> None:
    job.result()


def _fill(
    queue: deque[_Prepared],
    source: Iterator[Frame],
    wanted: Callable[[int], bool],
    worker: ThreadPoolExecutor,
    *,
    decoded: int,
    verified: int,
) -> None:
    """Take frames ahead until enough images are being decoded."""
    in_progress = sum(entry.decoding for entry in queue)
    while in_progress < decoded and len(queue) < verified:
        entry = next((_Prepared(frame) for frame in islice(source, 1)), None)
        if entry is None:
            return
        queue.append(entry)
        if entry.frame.threads and wanted(len(queue)):
            entry.decode(worker)
            in_progress += 1
        else:
            entry.check(worker)
