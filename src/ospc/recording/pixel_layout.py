"""How the grey values of a recording are stored in its images, found from a few of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ospc.arrays import FloatArray, Image, ImageSize
from ospc.errors import FrameError, RecordingError
from ospc.recording.bayer import GreenPixels, find_green
from ospc.recording.bit_depth import BitDepth, detect_bit_depth
from ospc.recording.decoding import decode_grey
from ospc.recording.image_header import read_header
from ospc.recording.image_source import ImageSource

_DEPTH_SAMPLES = 4
"""Frames looked at for the bit depth: the first readable and those with the longest exposures, which use all bits."""


@dataclass(frozen=True)
class PixelLayout:
    """What all images of a recording have in common.

    Attributes
    ----------
    stored_size
        Width and height of the stored images.
    depth
        Bits of the grey values.
    green
        Which pixels to take of a Bayer mosaic; None where all are taken.
    """

    stored_size: ImageSize
    depth: BitDepth
    green: GreenPixels | None = None

    @property
    def size(self) -> ImageSize:
        """Width and height of the grey images."""
        width, height = self.stored_size
        return (width, height) if self.green is None else (width // 2, height // 2)

    def grey(self, stored: Image, label: str) -> Image:
        """Return the grey image of a stored one.

        Raises
        ------
        FrameError
            If its size, type or grey values are not those of the others.
        """
        size = (stored.shape[1], stored.shape[0])
        if size != self.stored_size:
            raise FrameError(
                f"{label}: is {size[0]}x{size[1]} pixels where the recording has "
                f"{self.stored_size[0]}x{self.stored_size[1]}; remove it or bring all images to one size"
            )
        aligned = _aligned(stored, self.depth, label)
        return aligned if self.green is None else self.green.of(aligned)


def _aligned(image: Image, depth: BitDepth, label: str) -> Image:
    """Return the values with the empty bits below them taken away; values outside the depth are an error."""
    if image.dtype != (np.uint8 if depth.stored_bits == 8 else np.uint16):
        raise FrameError(f"{label}: is not of {depth.stored_bits} bit like the others; bring all images to one type")
    if depth.bits == depth.stored_bits:
        return image
    shifted: Image = image >> depth.shift
    if int(shifted.max()) > depth.max_grey or (depth.shift and np.any(image & (2**depth.shift - 1))):
        raise FrameError(
            f"{label}: has grey values beyond the {depth.bits} bits that others use; convert the recording to "
            f"images that all use the same bits"
        )
    return shifted


def find_layout(
    source: ImageSource, names: Sequence[str], exposures_ms: FloatArray, *, take_green: bool
) -> tuple[PixelLayout, list[str]]:
    """Find the layout from a few images, and what to tell about it.

    Parameters
    ----------
    source
        The image files.
    names
        Name of the image of every frame.
    exposures_ms
        Exposure of every frame, shape (frames,).
    take_green
        Whether to take the green pixels of a Bayer mosaic; otherwise it is only told of.

    Raises
    ------
    RecordingError
        If no image is readable.
    """
    problem: FrameError | None = None
    for name in names:
        try:
            data = source.read(name)
            first = decode_grey(data, source.label(name))
            break
        except FrameError as error:
            problem = problem or error
    else:
        raise RecordingError(f"{source.place}: none of its {len(names)} images can be read; the first: {problem}")
    depth = detect_bit_depth(_samples(first, source, names, exposures_ms))
    notes = [] if depth.note is None else [depth.note]
    green = None
    if read_header(data, name).channels > 2:
        notes.append("colour images are converted to luma, 0.299 R + 0.587 G + 0.114 B")
    else:
        green = find_green(first)
    if green is not None and take_green:
        notes.append("images are a Bayer mosaic; the mean of the two green pixels of each 2×2 block is taken")
    elif green is not None:
        notes.append("images look like a Bayer mosaic, whose colours answer differently; use its green pixels only")
        green = None
    return PixelLayout((first.shape[1], first.shape[0]), depth, green), notes


def _samples(first: Image, source: ImageSource, names: Sequence[str], exposures_ms: FloatArray) -> Iterator[Image]:
    """Give the first image and, where there is more than 8 bit to find out about, those of longest exposure."""
    yield first
    if first.dtype == np.uint8:
        return
    for index in np.argsort(-exposures_ms, kind="stable")[: _DEPTH_SAMPLES - 1]:
        try:
            image = decode_grey(source.read(names[index]), source.label(names[index]))
        except FrameError:
            continue
        if image.dtype == first.dtype:
            yield image
