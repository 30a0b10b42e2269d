"""A recording whose frames are image files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import TracebackType

from ospc.arrays import FloatArray, Image, ImageSize
from ospc.errors import OspcError
from ospc.recording.channel import Channel
from ospc.recording.decoding import decode_stored
from ospc.recording.frame import Frame
from ospc.recording.frame_table import FrameTable, match_images
from ospc.recording.image_header import read_header
from ospc.recording.image_source import ImageSource
from ospc.recording.options import DEFAULT, ReadingOptions
from ospc.recording.pixel_layout import PixelLayout, StoredImage, find_layout
from ospc.recording.wording import escaped


@dataclass(frozen=True, eq=False)
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
    layout
        Size and bit depth of the first readable image; a frame of another size is an unreadable one.
    notes
        What a user should know about how it was read.
    channel
        Channel taken of colour images; luma where None.
    """

    path: Path
    kind: str
    source: ImageSource = field(repr=False)
    names: tuple[str, ...] = field(repr=False)
    exposures_ms: FloatArray = field(repr=False)
    stamps_s: FloatArray = field(repr=False)
    layout: PixelLayout
    notes: tuple[str, ...] = ()
    channel: Channel | None = None

    @property
    def max_grey(self) -> int:
        """Largest grey value the sensor delivers."""
        return self.layout.depth.max_grey

    @property
    def size(self) -> ImageSize:
        """Width and height of its frames in pixels."""
        return self.layout.size

    def __len__(self) -> int:
        """Return the number of frames, unreadable ones included."""
        return len(self.names)

    def __iter__(self) -> Iterator[Frame]:
        """Give the frames one by one, none decoded."""
        for index, name in enumerate(self.names):
            stamp_s, exposure_ms = float(self.stamps_s[index]), float(self.exposures_ms[index])
            yield Frame(
                index,
                stamp_s,
                exposure_ms,
                escaped(name),
                partial(self._load, name),
                self.max_grey,
                partial(self._verify, name),
                threads=True,
            )

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

    def _verify(self, name: str) -> None:
        label = self.source.label(name)
        header = read_header(self.source.read(name), label)
        self.layout.check_size((header.width, header.height), label)

    def _load(self, name: str) -> Image:
        label = self.source.label(name)
        return self.layout.grey(decode_stored(self.source.read(name), label, self.channel).pixels, label)


def open_sequence(
    path: Path,
    kind: str,
    source: ImageSource,
    table: FrameTable,
    notes: Sequence[str] = (),
    *,
    options: ReadingOptions = DEFAULT,
    take_green: bool = False,
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
    options
        What the user says about it.
    take_green
        Whether to take the green pixels where the images are a Bayer mosaic.

    Raises
    ------
    RecordingError
        If frames and images do not correspond or no image is readable.
    """
    try:
        names, matching = match_images(table, source.names, str(source.place))

        def read(index: int) -> StoredImage:
            name = names[index]
            return decode_stored(source.read(name), source.label(name), options.channel)

        place = str(source.place)
        layout, pixels = find_layout(read, table.exposures_ms, place, options, take_green=take_green)
    except OspcError:
        source.close()
        raise
    numbered = () if table.stamped else (f"{table.source}: has no time stamps; frames are numbered, one a second",)
    said = (*notes, *table.notes, *numbered, *matching, *pixels)
    return ImageSequence(path, kind, source, names, table.exposures_ms, table.stamps_s, layout, said, options.channel)
