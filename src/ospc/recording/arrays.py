"""A recording in memory: what a notebook or a simulator has at hand."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ospc.arrays import FloatArray, Image, ImageSize
from ospc.errors import ExposureError, FrameError, RecordingError
from ospc.recording.bit_depth import detect_bit_depth
from ospc.recording.frame import Frame, check_image
from ospc.recording.frame_table import EXPOSURE_RANGE_MS


class ArrayRecording:
    """Images in memory with their exposures.

    Parameters
    ----------
    images
        Grey images, uint8 or uint16: an array of shape (frames, height, width), or a sequence of arrays of shape
        (height, width). They are not copied.
    exposures_ms
        Exposure of every frame in milliseconds times linear gain, shape (frames,).
    stamps_s
        Time stamps in seconds, strictly increasing, shape (frames,); one frame a second where not given.
    name
        What to call the recording in messages.
    max_grey
        Largest grey value the sensor delivers; where not given, 255 for uint8, and found from the values for uint16.

    Raises
    ------
    ExposureError
        If exposures are not finite and positive, or not as many as images.
    RecordingError
        If there are no images, the first is not a grey image, or stamps do not increase.

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
        self._images = images
        self._name = name
        first = _first(images, name)
        self._size = (first.shape[1], first.shape[0])
        self._exposures_ms = _exposures(exposures_ms, len(images), name)
        self._stamps_s = _stamps(np.arange(len(images)) if stamps_s is None else stamps_s, len(images), name)
        self._notes: tuple[str, ...] = ()
        if max_grey is None:
            # An array is used as it is, so the empty bits of left-aligned data stay where they are.
            pixels = (np.asarray(image) for image in images)
            depth = detect_bit_depth(image for image in pixels if image.dtype == first.dtype)
            max_grey = depth.max_grey << depth.shift
            self._notes = () if depth.note is None else (f"{name}: largest grey value taken as {max_grey}",)
        self._max_grey = max_grey

    @property
    def path(self) -> Path:
        """Its name."""
        return Path(self._name)

    @property
    def kind(self) -> str:
        """``array``."""
        return "array"

    @property
    def size(self) -> ImageSize:
        """Width and height of its frames in pixels."""
        return self._size

    @property
    def max_grey(self) -> int:
        """Largest grey value the sensor delivers."""
        return self._max_grey

    @property
    def exposures_ms(self) -> FloatArray:
        """Exposure of every frame in milliseconds times linear gain, shape (frames,)."""
        return self._exposures_ms

    @property
    def stamps_s(self) -> FloatArray:
        """Time stamp of every frame in seconds, shape (frames,)."""
        return self._stamps_s

    @property
    def notes(self) -> tuple[str, ...]:
        """What was inferred."""
        return self._notes

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self._images)

    def __iter__(self) -> Iterator[Frame]:
        """Give the frames one by one."""
        for index in range(len(self)):
            stamp_s, exposure_ms = float(self._stamps_s[index]), float(self._exposures_ms[index])
            load = partial(self._load, index)
            yield Frame(index, stamp_s, exposure_ms, f"{self._name}[{index}]", load, self._max_grey)

    def stored_bytes(self, index: int) -> bytes:
        """Return the pixels of a frame as bytes, to recognise the recording by."""
        return np.ascontiguousarray(self._images[index]).tobytes()

    def _load(self, index: int) -> Image:
        name = f"{self._name}[{index}]"
        image = check_image(np.asarray(self._images[index]), name)
        if (image.shape[1], image.shape[0]) != self._size:
            raise FrameError(
                f"{name}: is {image.shape[1]}x{image.shape[0]} pixels where the recording has "
                f"{self._size[0]}x{self._size[1]}; bring all images to one size"
            )
        return image


def _first(images: npt.NDArray[np.generic] | Sequence[Image], name: str) -> Image:
    first: Image = np.asarray(images[0])
    try:
        return check_image(first, f"{name}[0]")
    except FrameError as error:
        raise RecordingError(f"{error}; convert the images to grey with shape (frames, height, width)") from None


def _column(values: npt.ArrayLike, count: int, what: str, name: str) -> FloatArray:
    """Return one number a frame, frozen."""
    try:
        column = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ExposureError(f"{name}: {what} must be numbers, one a frame") from None
    if column.shape != (count,):
        raise ExposureError(f"{name}: {what} must be one a frame, {count} of them, not of shape {column.shape}")
    column.setflags(write=False)
    return column


def _exposures(values: npt.ArrayLike, count: int, name: str) -> FloatArray:
    column = _column(values, count, "exposures", name)
    low, high = EXPOSURE_RANGE_MS
    bad = np.flatnonzero(~((column >= low) & (column <= high)))
    if bad.size:
        raise ExposureError(
            f"{name}[{bad[0]}]: the exposure must be a positive number of milliseconds, not {column[bad[0]]:g}; "
            f"leave the frame out or give its exposure"
        )
    return column


def _stamps(values: npt.ArrayLike, count: int, name: str) -> FloatArray:
    column = _column(values, count, "time stamps", name)
    bad = np.flatnonzero(~np.isfinite(column))
    if bad.size:
        raise RecordingError(f"{name}[{bad[0]}]: {column[bad[0]]:g} is no time stamp; correct it")
    wrong = np.flatnonzero(np.diff(column) <= 0)
    if wrong.size:
        raise RecordingError(
            f"{name}[{wrong[0] + 1}]: its time stamp is not after that of the frame before; "
            f"frames must be in the order they were taken"
        )
    return column
