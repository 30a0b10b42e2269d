"""Recordings derived from another one: with fewer frames, other exposures, a mask, or more bits."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Self

import numpy as np

from ospc.arrays import BoolArray, FloatArray, ImageSize, IntArray, read_only, size_of
from ospc.errors import FrameError, SettingError, counted, quoted
from ospc.formats.files import read_bytes
from ospc.recording.frame import Frame, checked_mask
from ospc.recording.image_source import MAX_FILE_BYTES, decode_grey
from ospc.recording.recording import Recording, StoredRecording, stored_bytes
from ospc.recording.stream import usable_frames


@dataclass(frozen=True, eq=False, kw_only=True)
class DerivedRecording(StoredRecording):
    """Frames of another recording with other exposures, a mask, or another largest grey value; images are unchanged.

    ``frames`` are the increasing indices of the frames that are kept, shape (frames,). ``mask`` is True where pixels
    may be used, shape (height, width), in addition to the masks of the inner recording; None for all pixels.
    """

    inner: Recording
    frames: IntArray = field(repr=False)
    mask: BoolArray | None = field(default=None, repr=False)

    @classmethod
    def of(
        cls,
        inner: Recording,
        frames: IntArray,
        exposures_ms: FloatArray,
        *,
        mask: BoolArray | None = None,
        max_grey: int | None = None,
        note: str,
        exposures_estimated: bool = False,
    ) -> Self:
        """Return some frames of a recording with something else changed, and a note about the change."""
        return cls(
            path=inner.path,
            kind=inner.kind,
            size=inner.size,
            max_grey=max_grey or inner.max_grey,
            exposures_ms=exposures_ms,
            stamps_s=inner.stamps_s[frames],
            notes=(*inner.notes, note),
            channel=getattr(inner, "channel", None),
            exposures_estimated=exposures_estimated or getattr(inner, "exposures_estimated", False),
            inner=inner,
            frames=frames,
            mask=mask,
        )

    def __iter__(self) -> Iterator[Frame]:
        kept = {int(frame): index for index, frame in enumerate(self.frames)}
        for frame in self.inner if kept else ():
            index = kept.pop(frame.index, None)
            if index is not None:
                mask = self.mask if frame.mask is None else frame.mask
                if self.mask is not None and frame.mask is not None:
                    mask = frame.mask & self.mask
                exposure_ms = float(self.exposures_ms[index])
                yield replace(frame, index=index, exposure_ms=exposure_ms, mask=mask, max_grey=self.max_grey)
            if not kept:
                return  # so that the rest of a video is not decoded

    @property
    def unmasked(self) -> Recording:
        """The recording without masks; itself if it has none."""
        inner = getattr(self.inner, "unmasked", self.inner)
        return self if self.mask is None and inner is self.inner else replace(self, inner=inner, mask=None)

    def stored_bytes(self, index: int) -> bytes:
        """Return the stored image of a frame and the mask; with another mask, a run cannot be resumed."""
        data = stored_bytes(self.inner, int(self.frames[index]))
        return data if self.mask is None else data + np.packbits(self.mask).tobytes()


def with_exposure_lag(recording: Recording, lag: int) -> Recording:
    """Return a recording with every exposure moved to the frame it belongs to.

    ``lag`` is the number of frames by which the metadata is late: the exposure recorded with frame i belongs to frame
    i − lag. The result is shorter by abs(lag) frames, whose exposures are not recorded.

    Raises
    ------
    SettingError
        If no frames are left.
    """
    if lag == 0:
        return recording
    count, missing = len(recording), abs(lag)
    if missing >= count:
        raise SettingError(
            f"{recording.path}: a lag of {counted(lag, 'frame')} leaves none of the {counted(count, 'frame')}; "
            f"give a smaller lag"
        )
    frames = np.arange(max(0, -lag), count - max(0, lag))
    end = "end" if lag > 0 else "beginning"
    note = (
        f"exposures are corrected for a lag of {counted(lag, 'frame')}; {counted(missing, 'frame')} at the {end} "
        "left out"
    )
    return DerivedRecording.of(recording, frames, recording.exposures_ms[frames + lag], note=note)


def with_sensor_depth(recording: Recording, max_grey: int | None) -> Recording:
    """Return a recording whose 16-bit images are read as those of a sensor with this largest grey value, and a note.

    Their depth is inferred from the images, and dark ones do not show all bits of the sensor. If it is inferred as
    this one, if images have 8 bits or more bits than the sensor, or if ``max_grey`` is None, for unknown, the
    recording itself is returned.
    """
    if max_grey is None:
        return recording
    if isinstance(recording, DerivedRecording) and recording.max_grey != recording.inner.max_grey:
        recording = recording.inner  # before it was made deeper
    if isinstance(recording, DerivedRecording):
        inner = with_sensor_depth(recording.inner, max_grey)
        notes = (*inner.notes, *recording.notes[len(recording.inner.notes) :])
        return replace(recording, inner=inner, max_grey=inner.max_grey, notes=notes)
    assumed = f"the sensor's largest grey value is assumed to be that of the calibration, {max_grey}"
    if not isinstance(recording, StoredRecording) or recording.layout is None:
        return _with_more_bits(recording, max_grey, assumed)
    inferred = recording.layout.depth
    depth = inferred.of_sensor(max_grey)
    if depth is inferred or (depth, max_grey) == (inferred, recording.max_grey):
        return recording
    notes = (*(note for note in recording.notes if note != inferred.note), *filter(None, (depth.note, assumed)))
    return replace(recording, layout=replace(recording.layout, depth=depth), max_grey=max_grey, notes=notes)


def _with_more_bits(recording: Recording, max_grey: int, note: str) -> Recording:
    """Return a recording of uint16 images that are used unchanged, with a larger largest grey value."""
    first = next(usable_frames(recording), None) if max_grey > recording.max_grey else None
    if first is None or first.image.dtype != np.uint16:
        return recording
    every = np.arange(len(recording))
    return DerivedRecording.of(recording, every, recording.exposures_ms, max_grey=max_grey, note=note)


def innermost(recording: Recording, index: int) -> tuple[Recording, int]:
    """Return the original recording behind a derived one, and the index of a frame in it."""
    if isinstance(recording, DerivedRecording):
        return innermost(recording.inner, int(recording.frames[index]))
    return recording, index


_LEAST_PIXELS = 64
"""Minimum number of usable pixels: a mask or region that leaves fewer is a mistake."""


@dataclass(frozen=True)
class Region:
    """A rectangle of pixels: column and row of its first pixel, and its size."""

    x: int
    y: int
    width: int
    height: int

    @classmethod
    def parse(cls, text: str) -> Region:
        """Return the rectangle in the text ``x,y,width,height``; SettingError if the text has another form."""
        match = re.fullmatch(r"\s*(\d{1,6})" + r"\s*,\s*(\d{1,6})" * 3 + r"\s*", text, re.ASCII)
        if match is None:
            raise SettingError(f"a part of the image must be x,y,width,height in pixels, not {quoted(text)}")
        return cls(*(int(group) for group in match.groups()))


_JPEG = (".jpg", ".jpeg")


def read_mask(path: Path, size: ImageSize) -> BoolArray:
    """Read a mask from an image of this size: black pixels are False and must not be used, all others are True.

    JPEG blurs the edges of black parts, so in a JPEG, all pixels count as black that are not half as bright as the
    brightest.

    Raises
    ------
    SettingError
        If the image cannot be read or has another size.
    """
    try:
        image = decode_grey(read_bytes(path, MAX_FILE_BYTES, FrameError), str(path))
    except FrameError as error:
        raise SettingError(str(error)) from None
    found = size_of(image)
    if found != size:
        raise SettingError(
            f"{path}: the mask is {found[0]}×{found[1]} pixels, but frames are {size[0]}×{size[1]}; use a mask of "
            "this size"
        )
    black = image.max() / 2 if path.suffix.lower() in _JPEG else 0
    return np.asarray(image > black)


def masked(recording: Recording, mask: BoolArray | None = None, region: Region | None = None) -> Recording:
    """Return a recording whose frames have a mask of the pixels that may be used.

    The images are unchanged, so that their size and the centre of the vignette stay the same. Without mask and
    region, the recording itself is returned. ``mask`` is True where pixels may be used, shape (height, width), or the
    image of a mask; pixels outside the region are not used either.

    Raises
    ------
    FrameError
        If the mask is neither bool nor uint8, or does not have two dimensions.
    SettingError
        If the mask has the wrong shape, the region is not inside the images, or hardly any pixels are left.
    """
    if mask is None and region is None:
        return recording
    width, height = recording.size
    usable = np.ones((height, width), dtype=bool) if mask is None else checked_mask(mask, str(recording.path)).copy()
    if usable.shape != (height, width):
        raise SettingError(
            f"the mask has shape {usable.shape}, but frames of {recording.path} have shape {(height, width)} "
            f"(height, width); use a mask of the same size"
        )
    if region is not None:
        ends = region.x + region.width, region.y + region.height
        if min(region.x, region.y) < 0 or ends[0] > width or ends[1] > height:
            raise SettingError(
                f"{region.width}×{region.height} pixels from ({region.x}, {region.y}) are not inside the "
                f"{width}×{height} of {recording.path}; give a region of interest inside the images"
            )
        inside = np.zeros_like(usable)
        inside[region.y : ends[1], region.x : ends[0]] = True
        usable &= inside
    if np.count_nonzero(usable) < _LEAST_PIXELS:
        raise SettingError(
            f"mask and region of interest leave {np.count_nonzero(usable)} of the {width}×{height} pixels; "
            f"usable pixels are inside the region and not black in the mask"
        )
    note = f"{1 - usable.mean():.0%} of every image is masked and not used"
    every = np.arange(len(recording))
    return DerivedRecording.of(recording, every, recording.exposures_ms, mask=read_only(usable), note=note)
