"""Decoding ahead: while one frame is worked on, a thread decodes those that will be wanted next."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from itertools import islice

from ospc.arrays import Image
from ospc.recording.frame import Frame

_DECODED = 3
"""Most images decoded and not yet taken."""

_VERIFIED = 64
"""Most frames looked at ahead; what is known of them without decoding is small."""


def decoded_ahead(
    frames: Iterable[Frame],
    wanted: Callable[[int], bool],
    *,
    decoded: int = _DECODED,
    verified: int = _VERIFIED,
) -> Iterator[Frame]:
    """Give the same frames in the same order, with images decoded ahead of time in a thread.

    What a frame gives, and the error it raises, is the same as without: only when the work is done differs. Frames
    whose recording cannot be read by another thread (:attr:`Frame.threads`) are passed on as they are.

    Parameters
    ----------
    frames
        The frames; they are taken from it by the calling thread only.
    wanted
        Whether the image of the frame that many places after the one last given (1 for the next) will most likely be
        read; being wrong costs time and nothing else.
    decoded
        Most images decoded ahead.
    verified
        Most frames taken from ``frames`` ahead.
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
    """A frame and what is being done about it."""

    def __init__(self, frame: Frame) -> None:
        self.frame = frame
        self.decoding = False
        self._plain = frame

    def decode(self, worker: ThreadPoolExecutor) -> None:
        """Have its image decoded."""
        plain = self._plain
        # Not by its property: in Python 3.11 that holds a lock shared by all frames while it waits.
        job: Future[Image] = worker.submit(plain.load)
        # An image that decodes is there and whole; so nothing is read twice.
        verify = None if plain.verify is None else lambda: _done(job)
        self.frame, self.decoding = replace(plain, load=job.result, verify=verify), True

    def check(self, worker: ThreadPoolExecutor) -> None:
        """Have it looked at whether its image is there and whole."""
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
    """Take frames ahead until enough images are under way."""
    under_way = sum(entry.decoding for entry in queue)
    while under_way < decoded and len(queue) < verified:
        entry = next((_Prepared(frame) for frame in islice(source, 1)), None)
        if entry is None:
            return
        queue.append(entry)
        if entry.frame.threads and wanted(len(queue)):
            entry.decode(worker)
            under_way += 1
        else:
            entry.check(worker)
