"""A recording whose frames are image files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import TracebackType

import numpy as np

from ospc.arrays import FloatArray, Image, ImageSize
from ospc.errors import FrameError, RecordingError
from ospc.recording.bit_depth import BitDepth, detect_bit_depth
from ospc.recording.decoding import decode_grey
from ospc.recording.frame import Frame
from ospc.recording.frame_table import FrameTable, match_images
from ospc.recording.image_header import read_header
from ospc.recording.image_source import ImageSource
from ospc.recording.wording import escaped

_DEPTH_SAMPLES = 4
"""Frames looked at for the bit depth: the first readable and those with the longest exposures, which use all bits."""


@dataclass(frozen=True)
class ImageSequence:
    """Frames in temporal order, each decoded when its image is asked for.

    Attributes
    ----------
    path
        Where it was opened from.
    kind
        Name of the kind of recording.
    source
        Where the image files are.
    names
        Name of the image file of every frame.
    exposures_ms
        Exposures in milliseconds, shape (frames,).
    stamps_s
        Time stamps in seconds, shape (frames,).
    size
        Width and height of the first readable image; a frame of another size is an unreadable one.
    depth
        Bit depth of the grey values.
    notes
        What a user should know about how it was read.
    """

    path: Path
    kind: str
    source: ImageSource = field(repr=False)
    names: tuple[str, ...] = field(repr=False)
    exposures_ms: FloatArray = field(repr=False)
    stamps_s: FloatArray = field(repr=False)
    size: ImageSize
    depth: BitDepth
    notes: tuple[str, ...] = ()

    @property
    def max_grey(self) -> int:
        """Largest grey value the sensor delivers."""
        return self.depth.max_grey

    def __len__(self) -> int:
        """Return the number of frames, unreadable ones included."""
        return len(self.names)

    def __iter__(self) -> Iterator[Frame]:
        """Give the frames one by one, none decoded."""
        for index, name in enumerate(self.names):
            stamp_s, exposure_ms = float(self.stamps_s[index]), float(self.exposures_ms[index])
            yield Frame(index, stamp_s, exposure_ms, escaped(name), partial(self._load, name), self.max_grey)

    def __enter__(self) -> ImageSequence:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        self.close()

    def close(self) -> None:
        """Let go of open files; images cannot be read afterwards."""
        self.source.close()

    def stored_bytes(self, index: int) -> bytes:
        """Return the file of a frame's image, to recognise the recording by.

        Raises
        ------
        FrameError
            If it cannot be read.
        """
        return self.source.read(self.names[index])

    def _load(self, name: str) -> Image:
        label = self.source.label(name)
        image = decode_grey(self.source.read(name), label)
        size = (image.shape[1], image.shape[0])
        if size != self.size:
            raise FrameError(
                f"{label}: is {size[0]}x{size[1]} pixels where the recording has {self.size[0]}x{self.size[1]}; "
                f"remove it or bring all images to one size"
            )
        return _aligned(image, self.depth, label)


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


def open_sequence(
    path: Path, kind: str, source: ImageSource, table: FrameTable, notes: Sequence[str] = ()
) -> ImageSequence:
    """Put a list of frames and their image files together; closes the source where that fails.

    Parameters
    ----------
    path
        Where the recording is opened from.
    kind
        Name of the kind of recording.
    source
        The image files.
    table
        The frames with their exposures.
    notes
        What is known about it so far.

    Raises
    ------
    RecordingError
        If frames and images do not correspond or no image is readable.
    """
    try:
        names, matching = match_images(table, source.names, str(source.place))
        size, depth, pixels = _probe(source, names, table.exposures_ms)
    except RecordingError:
        source.close()
        raise
    said = (*notes, *table.notes, *matching, *pixels)
    return ImageSequence(path, kind, source, names, table.exposures_ms, table.stamps_s, size, depth, said)


def _probe(
    source: ImageSource, names: Sequence[str], exposures_ms: FloatArray
) -> tuple[ImageSize, BitDepth, list[str]]:
    """Find size, bit depth and colour from a few images."""
    order = iter(range(len(names)))
    problem: FrameError | None = None
    for index in order:
        try:
            data = source.read(names[index])
            first = decode_grey(data, source.label(names[index]))
            break
        except FrameError as error:
            problem = problem or error
    else:
        raise RecordingError(f"{source.place}: none of its {len(names)} images can be read; the first: {problem}")
    notes = []
    if read_header(data, names[index]).channels > 2:
        notes.append("colour images are converted to luma, 0.299 R + 0.587 G + 0.114 B")
    depth = detect_bit_depth(_samples(first, source, names, exposures_ms))
    if depth.note:
        notes.append(depth.note)
    return (first.shape[1], first.shape[0]), depth, notes


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
