"""Decoding ahead: while one frame is processed, a thread decodes and prepares the next ones."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

from ospc.arrays import Image
from ospc.recording.frame import Frame

_DECODED = 3
"""Images decoded ahead: enough to keep the thread busy, few enough for memory."""

_VERIFIED = 64
"""Frames taken and verified ahead; without their images they are small."""


def _nothing(_frame: Frame) -> None:
    """Prepare nothing."""


def decoded_ahead(
    frames: Iterable[Frame],
    wanted: Callable[[int], bool],
    prepare: Callable[[int], Callable[[Frame], None]] = lambda _places: _nothing,
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
    prepare
        Called with the same; returns what the thread does with the frame once its image is decoded.
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
    queue = deque([(first, False)])  # frames, and whether each is being decoded
    with ThreadPoolExecutor(1, "ospc-decoding") as worker:
        try:
            while queue:
                in_progress = sum(decoding for _, decoding in queue)
                while in_progress < decoded and len(queue) < verified and (frame := next(source, None)) is not None:
                    places = len(queue) + 1
                    decode = frame.threads and wanted(places)
                    ahead = _decoding(frame, worker, prepare(places)) if decode else _verifying(frame, worker)
                    queue.append((ahead, decode))
                    in_progress += decode
                yield queue.popleft()[0]
        finally:
            worker.shutdown(wait=True, cancel_futures=True)


def _decoding(frame: Frame, worker: ThreadPoolExecutor, prepare: Callable[[Frame], None]) -> Frame:
    """Return a frame whose image the worker decodes."""

    def load() -> Image:
        image = frame.load()
        prepare(replace(frame, load=lambda: image))
        return image

    job = worker.submit(load)

    def verify() -> None:
        # Decoding verifies the image too, so nothing is read twice.
        job.result()

    return replace(frame, load=job.result, verify=None if frame.verify is None else verify)


def _verifying(frame: Frame, worker: ThreadPoolExecutor) -> Frame:
    """Return a frame whose image the worker verifies."""
    if frame.verify is None or not frame.threads:
        return frame
    return replace(frame, verify=worker.submit(frame.verify).result)
