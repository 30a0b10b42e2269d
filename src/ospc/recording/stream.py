"""Streams of frames: from any iterable, without unusable frames, decoded ahead, or processed in threads."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import Any, TypeAlias, TypeVar

import numpy as np

from ospc.arrays import Image
from ospc.errors import ExposureError, FrameError, RecordingError
from ospc.recording.frame import Frame, check_exposure, check_image

Item: TypeAlias = Frame | tuple[Image, float | None] | tuple[Image, float | None, float]
"""A frame, an image with its exposure in ms, or an image with its exposure in ms and time stamp in s."""

T = TypeVar("T")
Result = TypeVar("Result")


def frames_of(items: Iterable[Item]) -> Iterator[Frame]:
    """Yield frames from any iterable, without keeping them.

    Parameters
    ----------
    items
        Frames, or tuples ``(image, exposure_ms)`` or ``(image, exposure_ms, stamp_s)`` with grey images of shape
        (height, width), uint8; images of more bits must be frames. An unknown exposure is None or NaN.

    Raises
    ------
    RecordingError
        If ``items`` are not iterable.
    FrameError
        If an item has another type, or an image is not grey or has more than 8 bits.
    ExposureError
        If a known exposure is not finite and positive.

    Examples
    --------
    >>> import numpy as np
    >>> [frame.exposure_ms for frame in frames_of([(np.zeros((4, 6), np.uint8), 5.0)])]
    [5.0]
    """
    if not isinstance(items, Iterable):
        raise RecordingError(
            f"{type(items).__name__} is not a recording; give a recording, its path, or frames one by one"
        )
    for index, item in enumerate(items):
        yield replace(item, index=index) if isinstance(item, Frame) else _frame(item, index)


def _frame(item: Any, index: int) -> Frame:
    if not isinstance(item, tuple | list) or len(item) not in (2, 3):
        raise FrameError(f"item {index}: must be a frame, (image, exposure_ms) or (image, exposure_ms, stamp_s)")
    image, exposure_ms, stamp_s = check_image(item[0], f"item {index}"), *(*item[1:], index)[:2]
    if image.dtype != np.uint8:
        raise FrameError(
            f"item {index}: has more than 8 bits; give the largest grey value of the sensor, as in "
            "Frame.of_array(image, exposure_ms, max_grey=4095)"
        )
    frame = Frame.of_array(image, exposure_ms, index=index, stamp_s=stamp_s)
    if not np.isnan(frame.exposure_ms):
        check_exposure(frame.exposure_ms, f"item {index}")
    return frame


def usable_frames(frames: Iterable[Frame], unusable: Callable[[str], None] = lambda _why: None) -> Iterator[Frame]:
    """Yield frames with an exposure and a readable image; ``unusable`` is called with the reason for others."""
    for frame in frames:
        try:
            check_exposure(frame.exposure_ms, frame.name)
            _ = frame.image
        except (FrameError, ExposureError) as error:
            unusable(str(error))
        else:
            yield frame


_DECODED, _VERIFIED = 3, 64
"""Number of images decoded ahead, enough to keep the thread busy with little memory, and of frames taken and verified
ahead, which are small without their images."""


def decoded_ahead(frames: Iterable[Frame], wanted: Callable[[int], bool]) -> Iterator[Frame]:
    """Yield the same frames in the same order, with images decoded ahead of time in a thread.

    Images and errors do not change: an error of the iteration is raised after the frames before it. Frames that other
    threads cannot read (:attr:`Frame.threads`) are passed on unchanged.

    ``wanted`` is called with the distance of a frame from the last one yielded, 1 for the next, and returns whether
    its image will probably be read; a wrong answer only costs time. Only a few images are decoded ahead, and only the
    calling thread iterates over the frames.
    """
    source = iter(frames)
    first = next(source, None)
    if first is None:
        return
    if not first.threads:
        yield first
        yield from source
        return
    failures: list[Exception] = []
    source = _until_failure(source, failures)
    queue = deque([(first, False)])  # frames, and whether each is being decoded
    with ThreadPoolExecutor(1, "ospc-decoding") as worker:
        try:
            while queue:
                in_progress = sum(decoding for _, decoding in queue)
                while in_progress < _DECODED and len(queue) < _VERIFIED and (frame := next(source, None)) is not None:
                    places = len(queue) + 1
                    decode = frame.threads and wanted(places)
                    ahead = _decoding(frame, worker) if decode else _verifying(frame, worker)
                    queue.append((ahead, decode))
                    in_progress += decode
                yield queue.popleft()[0]
        finally:
            worker.shutdown(wait=True, cancel_futures=bool(queue))  # at the end, frames may be read later
    if failures:
        raise failures[0]


def _until_failure(frames: Iterator[Frame], failures: list[Exception]) -> Iterator[Frame]:
    """Yield frames; an error ends them, and is added to ``failures``."""
    try:
        yield from frames
    except Exception as error:
        failures.append(error)


def _decoding(frame: Frame, worker: ThreadPoolExecutor) -> Frame:
    """Return a frame whose image the worker decodes."""
    job = worker.submit(frame.load)

    def verify() -> None:
        # Decoding also verifies the image, so that nothing is read twice.
        job.result()

    return replace(frame, load=job.result, verify=None if frame.verify is None else verify)


def _verifying(frame: Frame, worker: ThreadPoolExecutor) -> Frame:
    """Return a frame whose image the worker verifies."""
    if frame.verify is None or not frame.threads:
        return frame
    return replace(frame, verify=worker.submit(frame.verify).result)


_WORKERS, _WAITING = min(os.cpu_count() or 1, 8), 2
"""Number of threads, one per processor, and of items that wait for one: more than eight threads only need memory,
because writing to disk is the bottleneck."""


def mapped(work: Callable[[T], Result], items: Iterable[T]) -> Iterator[Result]:
    """Yield the results of ``work``, called in other threads, in the order of the items.

    Only the calling thread takes items, and only a few before their results are yielded, which limits memory. An
    error in the work or the items is raised after the work in progress has finished; the rest is dropped.
    """
    pending: deque[Future[Result]] = deque()
    pool = ThreadPoolExecutor(_WORKERS)
    try:
        for item in items:
            pending.append(pool.submit(work, item))
            if len(pending) >= _WORKERS + _WAITING:
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
