"""A video file with a list of exposures beside it.

Videos are decoded one after the other and cannot be entered anywhere: reading frames in their order costs what
playing the video costs, going back starts it anew.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from ospc.arrays import FloatArray, Image, ImageSize
from ospc.errors import ExposureError, FrameError, RecordingError
from ospc.recording.channel import Channel
from ospc.recording.exposure_table import read_exposure_table
from ospc.recording.frame import Frame
from ospc.recording.frame_table import FrameTable, table_or_unlisted
from ospc.recording.options import DEFAULT, ReadingOptions
from ospc.recording.video_stream import VideoStream, count_frames
from ospc.recording.wording import escaped, listed

_BEGINNINGS = ((4, b"ftyp"), (4, b"moov"), (0, b"\x1aE\xdf\xa3"), (8, b"AVI "))
"""Where MP4 and MOV, MKV and WebM, and AVI files say what they are."""

_MAX_FPS = 100_000
_SAMPLE_BYTES = 65536


@dataclass(frozen=True)
class Video:
    """The kind of recording that is a video file with a list of exposures beside it."""

    name: str = "video"

    def recognises(self, path: Path) -> bool:
        """Tell whether the path is a file that begins like an MP4, MOV, MKV, WebM or AVI file."""
        if not path.is_file():
            return False
        with path.open("rb") as file:
            head = file.read(16)
        return any(head[place : place + len(text)] == text for place, text in _BEGINNINGS)

    def open(self, path: Path, options: ReadingOptions = DEFAULT) -> VideoRecording:
        """Open the file.

        Raises
        ------
        RecordingError
            If it cannot be decoded, or does not have as many frames as its list has lines.
        ExposureError
            If there is no list of exposures, more than one, or one with exposures missing or invalid.
        """
        # Only the content is trusted to tell a video: a playlist could lead the decoder to other files.
        if not self.recognises(path):
            raise RecordingError(f"{path}: is no MP4, MOV, MKV, WebM or AVI file; convert it to one of these")
        table = table_or_unlisted(
            lambda: read_exposure_table(_list_of(path), options),
            str(path),
            count_frames(path) if options.unknown_exposures else 0,
            allowed=options.unknown_exposures,
        )
        with VideoStream(path, options.channel) as stream:
            stated, fps = stream.stated_frames, stream.fps
            size = _size(stream, path)
        # What a container states is often an estimate; counting costs a pass over the video.
        frames = stated if stated == len(table) else count_frames(path)
        if frames != len(table):
            raise RecordingError(
                f"{table.source}: lists {len(table)} frames but {path} has {frames}; there must be one line for each"
            )
        stamps_s, notes = _stamps(table, fps, path, options.channel)
        return VideoRecording(path, size, table.exposures_ms, stamps_s, notes, options.channel)


@dataclass(frozen=True, eq=False)
class VideoRecording:
    """Frames of a video, each decoded when its image is asked for; colour becomes luma.

    Attributes
    ----------
    path
        The video file.
    size
        Width and height of its frames in pixels.
    exposures_ms
        Exposure of every frame in milliseconds, shape (frames,).
    stamps_s
        Time stamp of every frame in seconds, shape (frames,).
    notes
        What a user should know about how it was read.
    channel
        Channel taken of its colours; luma where None.
    """

    path: Path
    size: ImageSize
    exposures_ms: FloatArray = field(repr=False)
    stamps_s: FloatArray = field(repr=False)
    notes: tuple[str, ...] = ()
    channel: Channel | None = None
    kind: str = "video"
    max_grey: int = 255

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.exposures_ms)

    def __iter__(self) -> Iterator[Frame]:
        """Give the frames one by one, none decoded; they share one decoder, which ends with them."""
        stream = VideoStream(self.path, self.channel)
        for index in range(len(self)):
            stamp_s, exposure_ms = float(self.stamps_s[index]), float(self.exposures_ms[index])
            name = f"{escaped(self.path.name)}[{index}]"
            yield Frame(index, stamp_s, exposure_ms, name, partial(self._load, stream, index), self.max_grey)

    def stored_bytes(self, index: int) -> bytes:
        """Return a piece of the file, as far into it as the frame is into the video, to recognise it by.

        Raises
        ------
        FrameError
            If the file cannot be read.
        """
        try:
            with self.path.open("rb") as file:
                file.seek(self.path.stat().st_size * index // len(self))
                return file.read(_SAMPLE_BYTES)
        except OSError as error:
            raise FrameError(f"{self.path}: cannot be read ({error.strerror}); check the file") from None

    def _load(self, stream: VideoStream, index: int) -> Image:
        image = stream.read(index)
        width, height = self.size
        if image.shape != (height, width):
            raise FrameError(
                f"{self.path}[{index}]: is {image.shape[1]}x{image.shape[0]} pixels where the video has "
                f"{width}x{height}; cut the video there"
            )
        return image


def _list_of(path: Path) -> Path:
    """Return the list of exposures: named like the video, or the only one by its usual name."""
    names = (f"{path.stem}.csv", f"{path.stem}.txt", f"{path.name}.csv")
    found = [path.with_name(name) for name in names if path.with_name(name).is_file()]
    if not found:
        found = [path.with_name(n) for n in ("exposures.csv", "times.txt") if path.with_name(n).is_file()]
    if len(found) > 1:
        raise ExposureError(f"{path}: several lists of exposures ({listed([p.name for p in found])}); keep one")
    if not found:
        raise ExposureError(
            f"{path}: a video holds no exposures; put {path.stem}.csv beside it, with a header "
            f"'timestamp_s,exposure_ms' and a line for each frame"
        )
    return found[0]


def _size(stream: VideoStream, path: Path) -> ImageSize:
    try:
        first = stream.read(0)
    except FrameError as error:
        raise RecordingError(f"{path}: not one frame can be decoded; convert the video to MJPEG or H.264") from error
    return first.shape[1], first.shape[0]


def _stamps(table: FrameTable, fps: float, path: Path, channel: Channel | None) -> tuple[FloatArray, tuple[str, ...]]:
    """Return the time stamps of the list; where it has none, those of the frame rate."""
    taken = "luma" if channel in (None, Channel.LUMINANCE) else channel.value
    notes = (*table.notes, f"{path}: frames are converted to {taken} of 8 bit")
    if table.stamped or not 0 < fps < _MAX_FPS:
        return table.stamps_s, notes
    stamps_s = np.arange(len(table)) / fps
    stamps_s.setflags(write=False)
    return stamps_s, (*notes, f"{path}: time stamps are those of {fps:g} frames a second")


KIND = Video()
