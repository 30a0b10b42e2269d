"""A recording made from another one: fewer frames, other exposures, or a mask."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Self

import numpy as np

from ospc.arrays import BoolArray, FloatArray, ImageSize, IntArray
from ospc.errors import FrameError, SettingError, counted, quoted
from ospc.formats.files import read_bytes
from ospc.recording.frame import Frame, checked_mask, size_of
from ospc.recording.image_source import MAX_FILE_BYTES, decode_grey
from ospc.recording.recording import Recording, StoredRecording, stored_bytes


@dataclass(frozen=True, eq=False, kw_only=True)
class DerivedRecording(StoredRecording):
    """Some frames of another recording, with exposures and a mask of its own; the images are unchanged.

    ``frames`` are the indices of those that are kept, increasing, shape (frames,). ``mask`` is True where pixels may
    be used, shape (height, width); None to keep the masks of the inner recording.
    """

    inner: Recording
    frames: IntArray = field(repr=False)
    mask: BoolArray | None = field(default=None, repr=False)

    @classmethod
    def of(
        cls, inner: Recording, frames: IntArray, exposures_ms: FloatArray, *, mask: BoolArray | None = None, note: str
    ) -> Self:
        """Return some frames of a recording, with other exposures or a mask, and a note that says so."""
        return cls(
            path=inner.path,
            kind=inner.kind,
            size=inner.size,
            max_grey=inner.max_grey,
            exposures_ms=exposures_ms,
            stamps_s=inner.stamps_s[frames],
            notes=(*inner.notes, note),
            channel=getattr(inner, "channel", None),
            inner=inner,
            frames=frames,
            mask=mask,
        )

    def __iter__(self) -> Iterator[Frame]:
        kept = {int(frame): index for index, frame in enumerate(self.frames)}
        for frame in self.inner if kept else ():
            index = kept.pop(frame.index, None)
            if index is not None:
                mask = frame.mask if self.mask is None else self.mask
                yield replace(frame, index=index, exposure_ms=float(self.exposures_ms[index]), mask=mask)
            if not kept:
                return  # the rest of a video need not be decoded

    def stored_bytes(self, index: int) -> bytes:
        """Return the stored form of a frame's image and the mask: with another mask it is another recording."""
        data = stored_bytes(self.inner, int(self.frames[index]))
        return data if self.mask is None else data + np.packbits(self.mask).tobytes()


def with_exposure_lag(recording: Recording, lag: int) -> Recording:
    """Return a recording with every exposure moved to the frame it was taken with.

    It is shorter by abs(lag) frames, those whose exposure is not listed; the recording itself if the lag is 0.
    ``lag`` is the number of frames by which the metadata come late: the exposure listed for frame i belongs to frame
    i − lag. SettingError if no frames are left.
    """
    if lag == 0:
        return recording
    count, missing = len(recording), abs(lag)
    if missing >= count:
        raise SettingError(
            f"{recording.path}: a lag of {counted(lag, 'frame')} leaves none of its {counted(count, 'frame')}; "
            f"give a smaller lag"
        )
    frames = np.arange(max(0, -lag), count - max(0, lag))
    end = "end" if lag > 0 else "beginning"
    note = f"exposures are corrected for a lag of {counted(lag, 'frame')}, leaving out {missing} at the {end}"
    return DerivedRecording.of(recording, frames, recording.exposures_ms[frames + lag], note=note)


def innermost(recording: Recording, index: int) -> tuple[Recording, int]:
    """Return the recording that a derived one is made from in the end, and the index of a frame in it."""
    if isinstance(recording, DerivedRecording):
        return innermost(recording.inner, int(recording.frames[index]))
    return recording, index


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

    SettingError if it cannot be read or has another size.
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

    The images are unchanged, so their size and the centre of the vignette stay the same; without mask and region, the
    recording itself is returned. ``mask`` is True where pixels may be used, shape (height, width), or the image of a
    mask; pixels outside the region are not used either.

    FrameError if the mask is neither of bool nor of uint8, or has not two dimensions; SettingError if it has the
    wrong shape, the region is not inside the images, or hardly any pixels are left.
    """
    if mask is None and region is None:
        return recording
    width, height = recording.size
    usable = np.ones((height, width), dtype=bool) if mask is None else checked_mask(mask, str(recording.path)).copy()
    if usable.shape != (height, width):
        raise SettingError(
            f"the mask has shape {usable.shape}, but frames of {recording.path} have shape {(height, width)} "
            f"(height, width); make it the same"
        )
    if region is not None:
        if region.x + region.width > width or region.y + region.height > height:
            raise SettingError(
                f"{region.width}x{region.height} pixels from ({region.x}, {region.y}) are not inside the "
                f"{width}x{height} of {recording.path}; give a region of interest that is"
            )
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
