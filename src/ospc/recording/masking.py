"""Parts of the image that are never used: a mask from a file, or everything outside a region of interest."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ospc.arrays import BoolArray, ImageSize
from ospc.errors import FrameError, SettingError, quoted
from ospc.formats.files import read_bytes
from ospc.recording.decoding import decode_grey
from ospc.recording.derived import DerivedRecording
from ospc.recording.frame import size_of
from ospc.recording.image_source import MAX_FILE_BYTES
from ospc.recording.recording import Recording

_LEAST_PIXELS = 64
"""Fewer usable pixels are refused: such a mask or region is a mistake."""


@dataclass(frozen=True)
class Region:
    """A rectangle of pixels: column and row of its first pixel, and its size."""

    x: int
    y: int
    width: int
    height: int

    @classmethod
    def parse(cls, text: str) -> Region:
        """Return the rectangle written as ``x,y,width,height``; SettingError if the text has another form."""
        match = re.fullmatch(r"\s*(\d{1,6})" + r"\s*,\s*(\d{1,6})" * 3 + r"\s*", text, re.ASCII)
        if match is None:
            raise SettingError(f"a region of interest is written x,y,width,height in pixels, not {quoted(text)}")
        return cls(*(int(group) for group in match.groups()))


def read_mask(path: Path, size: ImageSize) -> BoolArray:
    """Read a mask, True where pixels may be used, from an image of the given size whose black pixels are not used.

    Raises
    ------
    SettingError
        If it cannot be read or has another size.
    """
    try:
        image = decode_grey(read_bytes(path, MAX_FILE_BYTES, FrameError), str(path))
    except FrameError as error:
        raise SettingError(str(error)) from None
    found = size_of(image)
    if found != size:
        raise SettingError(
            f"{path}: the mask is {found[0]}x{found[1]} pixels, but frames are {size[0]}x{size[1]}; make them equal"
        )
    return np.asarray(image > 0)


def masked(recording: Recording, mask: BoolArray | None = None, region: Region | None = None) -> Recording:
    """Return a recording whose frames say which of their pixels may be used.

    The images are unchanged, so their size and the centre of the vignette stay the same.

    Parameters
    ----------
    recording
        The recording; it is returned itself if nothing is masked.
    mask, region
        True where pixels may be used, shape (height, width); pixels outside the region are not used either.

    Raises
    ------
    SettingError
        If the mask has the wrong shape or hardly any pixels are left.
    """
    if mask is None and region is None:
        return recording
    width, height = recording.size
    usable = np.ones((height, width), dtype=bool) if mask is None else mask.copy()
    if usable.shape != (height, width):
        raise SettingError(
            f"the mask has shape {usable.shape}, but frames of {recording.path} have shape {(height, width)} "
            f"(height, width); make it the same"
        )
    if region is not None:
        inside = np.zeros_like(usable)
        inside[region.y : region.y + region.height, region.x : region.x + region.width] = True
        usable &= inside
    if np.count_nonzero(usable) < _LEAST_PIXELS:
        raise SettingError(
            f"mask and region of interest leave {np.count_nonzero(usable)} of the {width}x{height} pixels; "
            f"usable pixels lie inside the region and are not black in the mask"
        )
    usable.setflags(write=False)
    note = f"{1 - usable.mean():.0%} of every image is masked and not used"
    return DerivedRecording.of(recording, np.arange(len(recording)), recording.exposures_ms, mask=usable, note=note)
