"""A recording whose frames are image files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from ospc.arrays import Image
from ospc.errors import RecordingError, escaped, listed
from ospc.formats.image_header import read_header
from ospc.recording.frame import Frame, check_size
from ospc.recording.frame_matching import in_order_of_numbers, match_images
from ospc.recording.frame_table import NO_STAMPS, FrameTable, table_or_placeholder
from ospc.recording.image_formats import format_of
from ospc.recording.image_source import ImageSource, why_unread
from ospc.recording.options import DEFAULT, ReadingOptions
from ospc.recording.pixel_layout import PixelLayout, find_layout
from ospc.recording.recording import StoredRecording


@dataclass(frozen=True, eq=False, kw_only=True)
class ImageSequence(StoredRecording):
    """Frames from image files in a folder or an archive; ``names`` are the file names, one per frame.

    ``layout`` is the layout of the first readable image; frames with a different layout count as unreadable.
    """

    source: ImageSource = field(repr=False)
    names: tuple[str, ...] = field(repr=False)
    layout: PixelLayout

    def __iter__(self) -> Iterator[Frame]:
        for index, name in enumerate(self.names):
            # Files read by an optional library can only be verified by decoding them.
            verify = partial(self._verify, name) if format_of(name) is None else None
            load = partial(self._load, name)
            yield self._frame(index, escaped(name), load, verify=verify, threads=True)

    def stored_bytes(self, index: int) -> bytes:
        """Return the image file of a frame."""
        return self.source.read(self.names[index])

    def _verify(self, name: str) -> None:
        label = self.source.label(name)
        header = read_header(self.source.read(name), label)
        check_size((header.width, header.height), self.layout.stored_size, label)

    def _load(self, name: str) -> Image:
        return self.layout.grey(self.source.decoded(name, self.channel).pixels, self.source.label(name))


def open_sequence(
    path: Path,
    kind: str,
    source: ImageSource,
    read_table: Callable[[], FrameTable],
    notes: Sequence[str] = (),
    *,
    options: ReadingOptions = DEFAULT,
    take_green: bool = False,
) -> ImageSequence:
    """Combine image files with the list of their exposures.

    ``read_table`` reads the frames with their exposures, and raises ExposureError if there are none. With
    ``take_green``, the green pixels are used if the images are a Bayer mosaic. ``notes`` are earlier notes.

    Raises
    ------
    ExposureError
        If there are no usable exposures and ``options`` do not allow that.
    RecordingError
        If there are no images, none is readable, or frames and images do not correspond.
    """
    place = str(source.place)
    if not source.names:
        why = why_unread(source.place) or "has no images; put PNG, JPEG, TIFF, BMP, PGM or PPM files there"
        raise RecordingError(f"{place}: {why}")
    table = table_or_placeholder(read_table, place, lambda: len(source.names), allowed=options.unknown_exposures)
    names, matching = match_images(table, source.names, place)
    table, names, ordering = in_order_of_numbers(table, names)
    layout, pixels = find_layout(
        lambda index: source.decoded(names[index], options.channel),
        table.exposures_ms,
        place,
        options,
        take_green=take_green,
    )
    if table.source == place:
        matching = ()  # without a list, there is nothing to match
    if source.left_out:
        rest = listed(source.left_out)
        pixels.append(f"{place}: {rest} left out, because there are also images in another format")
    numbered = () if table.stamped else (f"{table.source}: {NO_STAMPS}",)
    return ImageSequence(
        path=path,
        kind=kind,
        size=layout.size,
        max_grey=layout.depth.max_grey,
        exposures_ms=table.exposures_ms,
        stamps_s=table.stamps_s,
        notes=(*notes, *table.notes, *numbered, *matching, *ordering, *pixels),
        channel=options.channel,
        source=source,
        names=names,
        layout=layout,
    )
