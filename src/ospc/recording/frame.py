"""One frame of a recording."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ospc.arrays import BoolArray, Image, ImageSize, number_of
from ospc.errors import ExposureError, FrameError, message_of
from ospc.photometry.correction import EXPOSURE_RANGE_MS
from ospc.photometry.grey_range import checked_max_grey

MAX_DECODED_BYTES = 512 * 2**20
"""Images that need more, including all stored channels, are rejected before decoding."""

UNNAMED = "frame"
"""Name of a frame in memory without an index; calibrators add its number in the run."""


@dataclass(frozen=True)
class Frame:
    """An image and its exposure. The image is decoded when :attr:`image` is first read.

    Because the exposure is known before decoding, a calibrator can select the frames to decode by their exposures.

    Attributes
    ----------
    index
        Position in the recording, from 0, including unreadable frames.
    stamp_s
        Time stamp in seconds.
    exposure_ms
        Exposure time in milliseconds times linear gain; finite and positive. NaN or None if unknown; a calibrator
        then skips the frame.
    name
        Name of the frame in messages, usually its file name.
    load
        Reads the image; raises :class:`~ospc.errors.FrameError` or ``OSError`` if that fails.
    max_grey
        Largest grey value the sensor delivers: 255 for 8 bits, 4095 for 12 bits; at most 65535.
    verify
        Checks that the image file is present and complete, without decoding it, and raises
        :class:`~ospc.errors.FrameError` if it is not. None if this requires decoding.
    mask
        True where pixels may be used, shape (height, width); None for all pixels. In a uint8 mask, black pixels are
        not used.
    threads
        Whether :attr:`load` and :attr:`verify` may be called from any thread.
    colour
        Whether the image may have the channels blue, green and red; otherwise it is grey.
    inter_coded
        Whether the image comes from a video that codes frames as changes of other frames, as H.264 and H.265 do.

    Raises
    ------
    FrameError
        If ``load`` is not callable, ``max_grey`` is not a 16-bit grey value, or ``mask`` is not a mask.
    ExposureError
        If the exposure or the time stamp is not a number.
    """

    index: int
    stamp_s: float
    exposure_ms: float
    name: str
    load: Callable[[], Image] = field(repr=False, compare=False)
    max_grey: int = 255
    verify: Callable[[], None] | None = field(default=None, repr=False, compare=False)
    mask: BoolArray | None = field(default=None, repr=False, compare=False)
    threads: bool = field(default=False, repr=False, compare=False)
    colour: bool = field(default=False, repr=False, compare=False)
    inter_coded: bool = field(default=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check and convert the fields."""
        if not callable(self.load):
            raise FrameError(f"{self.name}: load must be a function; for an image in memory use Frame.of_array")
        unknown = self.exposure_ms is None
        exposure_ms = math.nan if unknown else checked_number(self.exposure_ms, "exposure_ms", self.name)
        object.__setattr__(self, "exposure_ms", exposure_ms)
        object.__setattr__(self, "stamp_s", checked_number(self.stamp_s, "stamp_s", self.name))
        object.__setattr__(self, "max_grey", checked_max_grey(self.max_grey, self.name))
        if self.mask is not None:
            object.__setattr__(self, "mask", checked_mask(self.mask, self.name))

    @classmethod
    def of_array(
        cls,
        image: npt.ArrayLike,
        exposure_ms: float | None,
        *,
        index: int | None = None,
        stamp_s: float = 0.0,
        max_grey: int | None = None,
        mask: BoolArray | None = None,
    ) -> Frame:
        """Return a frame with an image in memory.

        Parameters
        ----------
        image
            Grey image, shape (height, width), uint8 or uint16.
        exposure_ms
            Exposure time in milliseconds times linear gain; None if unknown.
        index
            Position in the recording; None if a calibrator shall name the frame by its number in the run.
        stamp_s
            Time stamp in seconds.
        max_grey
            Largest grey value of the sensor, such as 4095 for 12 bits; None for the maximum of the data type. 16-bit
            values up to twice as large count as saturated.
        mask
            True where pixels may be used, shape (height, width); None for all pixels.

        Raises
        ------
        FrameError
            If the array is not a grey image with 8 or 16 bits, ``max_grey`` does not match it, or ``mask`` is not a
            mask.
        ExposureError
            If the exposure or the time stamp is not a number.
        """
        name = UNNAMED if index is None else f"frame {index}"
        checked = check_image(image, name)
        limit = int(np.iinfo(checked.dtype).max) if max_grey is None else checked_max_grey(max_grey, name)
        known_ms = math.nan if exposure_ms is None else exposure_ms
        frame = cls(index or 0, stamp_s, known_ms, name, lambda: checked, limit, mask=mask)
        _ = frame.image  # so that its grey values are checked now
        return frame

    @property
    def image(self) -> Image:
        """Grey image, shape (height, width), uint8 or uint16, or with :attr:`colour` also (height, width, 3).

        Raises
        ------
        FrameError
            If the image cannot be read, or :attr:`max_grey` does not match it.
        """
        # Not functools.cached_property: in Python 3.11, all frames share its lock, so that threads would deadlock.
        if "_decoded" not in self.__dict__:
            try:
                pixels = self.load()
            except OSError as error:
                raise FrameError(f"{self.name}: its image cannot be read ({message_of(error)})") from None
            checked = check_image(pixels, self.name, colour=self.colour)
            _check_greys(checked, self.max_grey, self.name)
            self.__dict__["_decoded"] = checked
        decoded: Image = self.__dict__["_decoded"]
        return decoded

    @property
    def image_8_bit(self) -> Image:
        """The image scaled to 8 bits, shape (height, width), uint8."""
        if self.max_grey == 255 and self.image.dtype == np.uint8:
            return self.image
        return np.asarray(cv2.convertScaleAbs(self.image, alpha=255 / self.max_grey))


def check_image(pixels: npt.ArrayLike, name: str, *, colour: bool = False) -> Image:
    """Return the image if it is grey, or in colour if allowed, with 8 or 16 bits; otherwise raise a FrameError."""
    if isinstance(pixels, np.ma.MaskedArray):
        raise FrameError(f"{name}: its image is a masked array; pass its data, and ~image.mask as the mask")
    image = np.asarray(pixels)
    if image.ndim == 0:
        raise FrameError(f"{name}: its image is {image}; give an array of shape (height, width)")
    three = colour and image.ndim == 3 and image.shape[2] == 3
    if not (image.ndim == 2 or three) or image.size == 0:
        channel = "; pass one channel, such as image[:, :, 1]" if image.ndim == 3 and image.shape[2] > 1 else ""
        raise FrameError(
            f"{name}: a grey image must have two dimensions, but this array has shape {image.shape}{channel}"
        )
    if image.dtype.newbyteorder("=") not in (np.uint8, np.uint16):
        raise FrameError(
            f"{name}: grey values must be uint8 or uint16, not {image.dtype}; pass them as the camera delivers them"
        )
    return image.astype(image.dtype.newbyteorder("="), copy=False)


def _check_greys(image: Image, max_grey: int, name: str) -> None:
    bits = 8 * image.itemsize
    # The white of a sensor may be below the largest value of its converter, but not by a whole bit.
    most = max_grey if bits == 8 else 2 * max_grey
    possible = int(np.iinfo(image.dtype).max)
    if max_grey > possible or (most < possible and image.max() > most):
        raise FrameError(
            f"{name}: max_grey is {max_grey}, which does not match {bits}-bit grey values up to {image.max()}; give "
            "the largest grey value of the sensor"
        )


def checked_number(value: Any, what: str, name: str) -> float:
    """Return a number as float; ExposureError if it is not a number."""
    number = number_of(value)
    if number is None:
        raise ExposureError(f"{name}: {what} is {value!r}; give a number")
    return number


def check_exposure(exposure_ms: float, name: str) -> None:
    """Raise an ExposureError unless the exposure of a frame is possible, see :data:`EXPOSURE_RANGE_MS`."""
    if math.isnan(exposure_ms):
        raise ExposureError(f"{name}: its exposure is unknown")
    if not 0 < exposure_ms < math.inf:
        raise ExposureError(f"{name}: exposure {exposure_ms} ms is not a positive number")
    low, high = EXPOSURE_RANGE_MS
    if not low <= exposure_ms <= high:
        raise ExposureError(f"{name}: exposure {exposure_ms:g} ms is not between {low:g} and {high:g} ms")


def checked_mask(mask: BoolArray, name: str) -> BoolArray:
    """Return a mask as bool, with black pixels of uint8 masks as False; FrameError if it is not a mask."""
    values = np.asarray(mask)
    if values.ndim != 2 or values.dtype not in (np.bool_, np.uint8):
        raise FrameError(
            f"{name}: a mask must be a two-dimensional array of bool or uint8, not of {values.dtype} with shape "
            f"{values.shape}"
        )
    return values.astype(bool, copy=False)


def check_size(size: ImageSize, wanted: ImageSize, name: str) -> None:
    """Raise a FrameError unless an image has the size of its recording."""
    if size != wanted:
        raise FrameError(
            f"{name}: {size[0]}×{size[1]} pixels, but the first frame has {wanted[0]}×{wanted[1]}; use only frames "
            f"of one size"
        )


def check_decoded_size(size: ImageSize, channels: int, bits: int, name: str) -> None:
    """Raise a FrameError if decoding a file would take too much memory."""
    if size[0] * size[1] * channels * max(bits, 8) > 8 * MAX_DECODED_BYTES:
        raise FrameError(
            f"{name}: its header states {size[0]}×{size[1]} pixels, which need more than the {MAX_DECODED_BYTES} "
            f"bytes allowed; repair the file or scale the images down"
        )
