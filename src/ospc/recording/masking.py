"""Parts of the image that are never used: a mask from a file, or all but a region of interest."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ospc.arrays import BoolArray, FloatArray, ImageSize
from ospc.errors import FrameError, RecordingError, SettingError
from ospc.recording.channel import Channel
from ospc.recording.decoding import MAX_FILE_BYTES, decode_grey
from ospc.recording.derived import DerivedRecording
from ospc.recording.frame import Frame
from ospc.recording.recording import Recording
from ospc.recording.wording import quoted

_LEAST_PIXELS = 64


@dataclass(frozen=True)
class Region:
    """A rectangle of pixels.

    Attributes
    ----------
    x, y
        Column and row of its first pixel.
    width, height
        In pixels.
    """

    x: int
    y: int
    width: int
    height: int

    @classmethod
    def parse(cls, text: str) -> Region:
        """Return the rectangle written as ``x,y,width,height``.

        Raises
        ------
        SettingError
            If it is not written like that.
        """
        match = re.fullmatch(r"\s*(\d{1,6})" + r"\s*,\s*(\d{1,6})" * 3 + r"\s*", text, re.ASCII)
        if match is None:
            raise SettingError(f"a region of interest is written x,y,width,height in pixels, not {quoted(text)}")
        return cls(*(int(group) for group in match.groups()))


def read_mask(path: Path, size: ImageSize) -> BoolArray:
    """Read a mask: an image whose black pixels are not used.

    Parameters
    ----------
    path
        The image file.
    size
        Width and height it must have.

    Raises
    ------
    SettingError
        If it cannot be read or is of another size.
    """
    try:
        with path.open("rb") as file:
            data = file.read(min(os.fstat(file.fileno()).st_size, MAX_FILE_BYTES) + 1)
    except OSError as error:
        raise SettingError(f"{path}: the mask cannot be read ({error.strerror}); check the path") from None
    if len(data) > MAX_FILE_BYTES:
        raise SettingError(f"{path}: the mask has more than the {MAX_FILE_BYTES} bytes allowed")
    try:
        image = decode_grey(data, str(path))
    except FrameError as error:
        raise SettingError(str(error)) from None
    if (image.shape[1], image.shape[0]) != size:
        raise SettingError(
            f"{path}: the mask is {image.shape[1]}x{image.shape[0]} pixels, but frames are {size[0]}x{size[1]}; "
            f"make it the same size"
        )
    return np.asarray(image > 0)


def masked(recording: Recording, mask: BoolArray | None = None, region: Region | None = None) -> Recording:
    """Return a recording whose frames say which of their pixels may be used.

    Images stay as they are, and with them their size and the centre of the vignette.

    Parameters
    ----------
    recording
        The recording.
    mask
        True where pixels may be used, shape (height, width).
    region
        Pixels outside of it are not used.

    Returns
    -------
    Recording
        The recording itself where nothing is masked.

    Raises
    ------
    SettingError
        If hardly anything is left.
    """
    if mask is None and region is None:
        return recording
    width, height = recording.size
    usable = np.ones((height, width), dtype=bool) if mask is None else mask.copy()
    if usable.shape != (height, width):
        raise SettingError(
            f"the mask has shape {usable.shape}, but frames of {recording.path} have "
            f"{(height, width)} (height, width)"
        )
    if region is not None:
        inside = np.zeros_like(usable)
        inside[region.y : region.y + region.height, region.x : region.x + region.width] = True
        usable &= inside
    if np.count_nonzero(usable) < _LEAST_PIXELS:
        raise SettingError(
            f"mask and region of interest leave {np.count_nonzero(usable)} of the {width}x{height} pixels; "
            f"pixels to be used must be inside the region and not black in the mask"
        )
    usable.setflags(write=False)
    return MaskedRecording(recording, usable)


@dataclass(frozen=True, eq=False)
class MaskedRecording(DerivedRecording):
    """A recording of whose images only some pixels may be used.

    Attributes
    ----------
    inner
        The recording.
    mask
        True where pixels may be used, shape (height, width).
    """

    inner: Recording
    mask: BoolArray

    @property
    def exposures_ms(self) -> FloatArray:
        """Exposure of every frame in milliseconds times linear gain, shape (frames,)."""
        return self.inner.exposures_ms

    @property
    def stamps_s(self) -> FloatArray:
        """Time stamp of every frame in seconds, shape (frames,)."""
        return self.inner.stamps_s

    @property
    def channel(self) -> Channel | None:
        """Channel that is taken of the inner recording, as far as it has any."""
        return getattr(self.inner, "channel", None)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes of the inner recording, and how much is masked."""
        return (*self.inner.notes, f"{1 - self.mask.mean():.0%} of every image is masked and not used")

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.inner)

    def __iter__(self) -> Iterator[Frame]:
        """Give the frames one by one."""
        for frame in self.inner:
            yield replace(frame, mask=self.mask)

    def stored_bytes(self, index: int) -> bytes:
        """Return what the inner recording stores of a frame, and the mask, without which it is another recording.

        Raises
        ------
        RecordingError
            If it stores nothing.
        """
        stored = getattr(self.inner, "stored_bytes", None)
        if stored is None:
            raise RecordingError(f"{self.path}: frames of this kind are not stored")
        data: bytes = stored(index)
        return data + np.packbits(self.mask).tobytes()
