"""A recording in memory, for notebooks and simulators."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ospc.arrays import FloatArray, Image
from ospc.errors import ExposureError, FrameError, RecordingError, listed
from ospc.recording.frame import Frame, check_image, check_size, checked_max_grey, size_of
from ospc.recording.frame_table import checked_exposures, checked_stamps
from ospc.recording.pixel_layout import detect_bit_depth
from ospc.recording.recording import StoredRecording


class ArrayRecording(StoredRecording):
    """Images in memory with their exposures.

    Parameters
    ----------
    images
        Grey images, uint8 or uint16: an array of shape (frames, height, width), or a sequence of arrays of shape
        (height, width). They are not copied.
    exposures_ms
        Exposure time in milliseconds times linear gain of every frame, shape (frames,).
    stamps_s
        Time stamps in seconds, strictly increasing, shape (frames,); by default one frame per second.
    name
        Name of the recording in messages.
    max_grey
        Largest grey value the sensor delivers; by default 255 for uint8, and inferred from the values for uint16.

    Raises
    ------
    ExposureError
        If exposures are not finite and positive, or their number is not that of the images.
    RecordingError
        If there are no images, the first is not a grey image, ``max_grey`` is no grey value, or stamps do not
        increase.

    Examples
    --------
    >>> import numpy as np
    >>> images = np.full((2, 4, 6), 100, dtype=np.uint8)
    >>> recording = ArrayRecording(images, [1.0, 2.0])
    >>> len(recording), recording.size, recording.max_grey
    (2, (6, 4), 255)
    """

    def __init__(
        self,
        images: npt.NDArray[np.generic] | Sequence[Image],
        exposures_ms: npt.ArrayLike,
        stamps_s: npt.ArrayLike | None = None,
        *,
        name: str = "array",
        max_grey: int | None = None,
    ) -> None:
        if len(images) == 0:
            raise RecordingError(f"{name}: holds no images; give at least one")
        try:
            first = check_image(np.asarray(images[0]), f"{name}[0]")
        except FrameError as error:
            raise RecordingError(f"{error}; convert the images to grey with shape (frames, height, width)") from None
        notes: tuple[str, ...] = ()
        if max_grey is None:
            # Arrays are used unchanged, so the empty bits of left-aligned data stay where they are.
            pixels = (np.asarray(image) for image in images)
            depth = detect_bit_depth(image for image in pixels if image.dtype == first.dtype)
            max_grey = depth.max_grey << depth.shift
            notes = () if depth.note is None else (f"{name}: largest grey value taken as {max_grey}",)
        stamps = np.arange(len(images)) if stamps_s is None else stamps_s

        def where(frames: Sequence[int]) -> str:
            return f"{name}[{listed(frames)}]"

        super().__init__(
            path=Path(name),
            kind="array",
            size=size_of(first),
            max_grey=checked_max_grey(max_grey, name),
            exposures_ms=checked_exposures(_column(exposures_ms, len(images), "exposures", name), where),
            stamps_s=checked_stamps(_column(stamps, len(images), "time stamps", name), where),
            notes=notes,
        )
        self._images = images
        self._name = name

    def __iter__(self) -> Iterator[Frame]:
        for index in range(len(self)):
            yield self._frame(index, f"{self._name}[{index}]", partial(self._load, index))

    def stored_bytes(self, index: int) -> bytes:
        """Return the pixels of a frame."""
        return np.ascontiguousarray(self._images[index]).tobytes()

    def _load(self, index: int) -> Image:
        name = f"{self._name}[{index}]"
        image = check_image(np.asarray(self._images[index]), name)
        check_size(size_of(image), self.size, name)
        return image


def _column(values: npt.ArrayLike, count: int, what: str, name: str) -> FloatArray:
    """Return one number per frame."""
    try:
        column = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ExposureError(f"{name}: {what} must be numbers, one per frame") from None
    if column.shape != (count,):
        raise ExposureError(f"{name}: {what} have shape {column.shape}; give one per frame, {count} in all")
    return column
