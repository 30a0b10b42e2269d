"""The storage format of grey values in a recording, inferred from a few images."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import chain

import numpy as np

from ospc.arrays import FloatArray, Image, ImageSize, size_of
from ospc.errors import FrameError, RecordingError, SettingError
from ospc.photometry.used_bits import UsedBits
from ospc.recording.channel import DEFAULT_CHANNEL, Channel, Mosaic, find_mosaic
from ospc.recording.frame import check_size
from ospc.recording.options import ReadingOptions

_SENSOR_BITS = (8, 10, 12, 14, 16)
"""Bit depths of sensors."""

_DEPTH_SAMPLES = 4
"""Number of frames that determine the bit depth: the first readable one, and some with the longest exposures, which
use all bits."""

_TAKEN = {
    Channel.GREEN: "the mean of the two green pixels",
    Channel.RED: "the red pixel",
    Channel.BLUE: "the blue pixel",
    Channel.LUMINANCE: "0.299 R + 0.587 G + 0.114 B",
    Channel.ALL: "the colour",
}
"""Pixels of a Bayer mosaic that are used for each channel."""


@dataclass(frozen=True)
class BitDepth:
    """Bits of a sensor, and their position in the stored word of 8 or 16 bits.

    ``shift`` is the number of unused low bits; 0 if the values are right-aligned. ``used`` are the bits it was
    inferred from; None if it is known, as that of 8 bits.
    """

    bits: int
    shift: int = 0
    stored_bits: int = 8
    used: UsedBits | None = field(default=None, compare=False)

    @property
    def max_grey(self) -> int:
        """Largest grey value, after the shift."""
        return (1 << self.bits) - 1

    @property
    def note(self) -> str | None:
        """A note for the user; None for 8 bits."""
        if self.stored_bits == 8:
            return None
        aligned = f"left-aligned, shifted right by {self.shift}" if self.shift else "right-aligned"
        used = "" if self.bits == 16 else f", {aligned}"
        return f"16-bit images are read as {self.bits}-bit grey values{used}: largest grey value {self.max_grey}"

    def of_sensor(self, max_grey: int) -> BitDepth:
        """Return the depth if the largest grey value of the sensor is known, because dark images do not show it.

        The depth itself is returned if it was not inferred, or if the images use more bits than the sensor.
        """
        shift = None if self.used is None else self.used.shift_for(max_grey)
        return self if shift is None else replace(self, bits=max_grey.bit_length(), shift=shift)


def detect_bit_depth(images: Iterable[Image]) -> BitDepth:
    """Infer the bit depth from sample images, which should be bright.

    Bits that are zero everywhere are unused: low ones in left-aligned data, high ones in right-aligned data. If the
    low bits that are zero are those that a sensor leaves, and the values do not fit into the others, the data are
    left-aligned and dark.
    """
    one_by_one = iter(images)
    first = next(one_by_one)
    if first.dtype == np.uint8:
        return BitDepth(8)
    used_bits = UsedBits.of(chain([first], one_by_one))
    union = used_bits.in_any
    if union == 0:
        return BitDepth(16, 0, 16, used_bits)
    highest, above_lowest = union.bit_length(), 17 - (union & -union).bit_length()
    left_aligned = highest == 16 or (above_lowest in _SENSOR_BITS and highest > above_lowest)
    used = above_lowest if left_aligned else highest
    bits = next(b for b in _SENSOR_BITS if b >= used)
    return BitDepth(bits, 16 - bits if left_aligned else 0, 16, used_bits)


@dataclass(frozen=True)
class StoredImage:
    """Pixels of a stored image, their channel if it is in colour, and mosaic and bit depth if the file has them."""

    pixels: Image
    channel: Channel | None = None
    mosaic: Mosaic | None = None
    depth: BitDepth | None = None

    @classmethod
    def of(cls, pixels: Image, channel: Channel | None, depth: BitDepth | None = None) -> StoredImage:
        """Return a channel, by default green, of an image in blue, green and red; a grey image is unchanged."""
        if pixels.ndim == 2:
            return cls(np.ascontiguousarray(pixels), depth=depth)
        taken = channel or DEFAULT_CHANNEL
        return cls(taken.of(np.ascontiguousarray(pixels)), taken, depth=depth)


@dataclass(frozen=True)
class PixelLayout:
    """The common layout of all images in a recording.

    ``stored_size`` has width and height of the stored images. ``mosaic`` is None if all pixels are used; otherwise
    only the pixels of ``channel`` are.
    """

    stored_size: ImageSize
    depth: BitDepth
    mosaic: Mosaic | None = None
    channel: Channel = Channel.GREEN

    @property
    def size(self) -> ImageSize:
        """Width and height of the grey images."""
        width, height = self.stored_size
        return (width, height) if self.mosaic is None else (width // 2, height // 2)

    def grey(self, stored: Image, label: str) -> Image:
        """Convert a stored image to grey; FrameError if its size, type or range differs from other images."""
        check_size(size_of(stored), self.stored_size, label)
        aligned = _aligned(stored, self.depth, label)
        return aligned if self.mosaic is None else self.mosaic.of(aligned, self.channel)


def _aligned(image: Image, depth: BitDepth, label: str) -> Image:
    """Shift out the unused low bits; FrameError if a value uses other bits."""
    if image.dtype != (np.uint8 if depth.stored_bits == 8 else np.uint16):
        raise FrameError(
            f"{label}: does not have {depth.stored_bits} bits like the others; convert all images to one type"
        )
    if depth.bits == depth.stored_bits:
        return image
    shifted: Image = image >> depth.shift
    if int(shifted.max()) > depth.max_grey or (depth.shift and np.any(image & (2**depth.shift - 1))):
        raise FrameError(
            f"{label}: has grey values outside the {depth.bits} bits that the others use; convert all images to "
            f"one bit depth"
        )
    return shifted


def find_layout(
    read: Callable[[int], StoredImage],
    exposures_ms: FloatArray,
    place: str,
    options: ReadingOptions,
    *,
    take_green: bool,
) -> tuple[PixelLayout, list[str]]:
    """Infer the layout from a few images and return it with notes for the user.

    ``read`` returns the image of a frame by index, and raises FrameError if that fails. ``place`` is the location of
    the images, for messages. With ``take_green``, the green pixels are used if images look like a Bayer mosaic;
    otherwise there is only a note.

    Raises
    ------
    RecordingError
        If no image is readable.
    SettingError
        If the images do not have the requested channel.
    """
    wanted = None if options.channel is Channel.ALL else options.channel
    first = _first(read, len(exposures_ms), place)
    depth = first.depth or detect_bit_depth(_samples(first.pixels, read, exposures_ms))
    layout = PixelLayout(size_of(first.pixels), depth)
    notes = [] if depth.note is None else [depth.note]
    if first.channel is not None:
        if options.bayer is not None:
            raise SettingError(f"{place}: its images are in colour, not a Bayer mosaic; leave out --bayer")
        if first.channel is not Channel.ALL:
            notes.append(f"the {first.channel.value} channel of colour images is used; --channel selects another")
        return layout, notes
    mosaic = options.bayer or first.mosaic or find_mosaic(first.pixels)
    if mosaic is None:
        if wanted not in (None, Channel.LUMINANCE):
            raise SettingError(
                f"{place}: its images are grey and have no {wanted.value} channel; leave out --channel, or give the "
                f"pattern of a Bayer mosaic with --bayer ({', '.join(Mosaic.PATTERNS)})"
            )
        return layout, notes
    if wanted is None and not mosaic.complete and not take_green:
        notes.append(
            "images look like a Bayer mosaic, whose colours have different responses; choose one with --channel"
        )
        return layout, notes
    in_colour = options.channel is Channel.ALL and mosaic.complete
    channel = Channel.ALL if in_colour else wanted or DEFAULT_CHANNEL
    if channel is not Channel.GREEN and not mosaic.complete:
        raise SettingError(
            f"{place}: the position of {channel.value} in the Bayer mosaic is unknown; give the pattern with "
            f"--bayer ({', '.join(Mosaic.PATTERNS)})"
        )
    notes.append(f"images are a Bayer mosaic; {_TAKEN[channel]} of each 2×2 block is used")
    return replace(layout, mosaic=mosaic, channel=channel), notes


def _first(read: Callable[[int], StoredImage], count: int, place: str) -> StoredImage:
    """Return the first readable image."""
    problem: FrameError | None = None
    for index in range(count):
        try:
            return read(index)
        except FrameError as error:
            problem = problem or error
    if count == 1:
        raise RecordingError(str(problem))
    raise RecordingError(f"{place}: none of its {count} images can be read; first problem: {problem}")


def _samples(first: Image, read: Callable[[int], StoredImage], exposures_ms: FloatArray) -> Iterator[Image]:
    """Yield the first image and, if it has 16 bits, some with the longest exposures."""
    yield first
    if first.dtype == np.uint8:
        return
    longest = np.argsort(-exposures_ms, kind="stable")
    equal = int(np.count_nonzero(exposures_ms == exposures_ms[longest[0]]))  # all, if exposures are unknown
    most = _DEPTH_SAMPLES - 1
    spread = np.linspace(0, equal - 1, most).astype(int) if equal > most else slice(most)
    for index in sorted(longest[spread]):
        try:
            image = read(int(index)).pixels
        except FrameError:
            continue
        if image.dtype == first.dtype:
            yield image
