"""Frames from any iterable, and decoding ahead: a thread decodes the next ones while one is processed."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from ospc.arrays import Image
from ospc.errors import ExposureError, FrameError
from ospc.recording.frame import Frame

Item: TypeAlias = Frame | tuple[Image, float] | tuple[Image, float, float]
"""A frame, an image with its exposure in ms, or an image with its exposure in ms and time stamp in s."""


def frames_of(items: Iterable[Item], *, max_grey: int | None = None) -> Iterator[Frame]:
    """Yield frames from any iterable; none is kept.

    Parameters
    ----------
    items
        Frames, or tuples ``(image, exposure_ms)`` or ``(image, exposure_ms, stamp_s)`` with grey images of shape
        (height, width), uint8 or uint16.
    max_grey
        Largest grey value of the images; required if they have more than 8 bits.

    Raises
    ------
    FrameError
        If an item is none of these, or an image is not grey.
    ExposureError
        If an exposure is not finite and positive.

    Examples
    --------
    >>> import numpy as np
    >>> [frame.exposure_ms for frame in frames_of([(np.zeros((4, 6), np.uint8), 5.0)])]
    [5.0]
    """
    for index, item in enumerate(items):
        yield replace(item, index=index) if isinstance(item, Frame) else _frame(item, index, max_grey)


def _frame(item: Any, index: int, max_grey: int | None) -> Frame:
    if not isinstance(item, tuple | list) or len(item) not in (2, 3):
        raise FrameError(f"item {index}: must be a frame, (image, exposure_ms) or (image, exposure_ms, stamp_s)")
    image = np.asarray(item[0])
    try:
        exposure_ms, stamp_s = float(item[1]), float(item[2]) if len(item) == 3 else float(index)
    except (TypeError, ValueError):
        raise ExposureError(f"item {index}: exposure and time stamp must be numbers") from None
    if not 0 < exposure_ms < np.inf:
        raise ExposureError(f"item {index}: exposure {exposure_ms} ms is not a positive number")
    if image.dtype != np.uint8 and max_grey is None:
        raise FrameError(
            f"item {index}: has grey values of type {image.dtype}; state max_grey, the largest value of the sensor"
        )
    return Frame.of_array(image, exposure_ms, index=index, stamp_s=stamp_s, max_grey=max_grey)


_DECODED, _VERIFIED = 3, 64
"""Images decoded ahead: enough to keep the thread busy, few enough for memory; and frames taken and verified ahead,
which are small without their images."""


def decoded_ahead(
    frames: Iterable[Frame],
    wanted: Callable[[int], bool],
    prepare: Callable[[int], Callable[[Frame], object]] = lambda _places: lambda _frame: None,
    *,
    decoded: int = _DECODED,
    verified: int = _VERIFIED,
) -> Iterator[Frame]:
    """Yield the same frames in the same order, with images decoded ahead of time in a thread.

    Images and errors are the same as without; only the time of decoding differs. Frames that other threads cannot
    read (:attr:`Frame.threads`) are passed on unchanged.

    ``wanted`` is called with how far a frame is ahead of the last one yielded, 1 for the next, and returns whether
    its image will probably be read; a wrong answer only costs time. ``prepare`` is called with the same, and returns
    what the thread does with the frame once its image is decoded. At most ``decoded`` images are decoded ahead, and
    at most ``verified`` frames taken. Only the calling thread iterates over the frames.
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


def _decoding(frame: Frame, worker: ThreadPoolExecutor, prepare: Callable[[Frame], object]) -> Frame:
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
