"""A video file with a list of exposures next to it.

Videos are decoded frame by frame from the beginning. Reading the frames in order is as fast as playing the video;
going back restarts it.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from ospc.arrays import FloatArray, Image, ImageSize, read_only, size_of
from ospc.errors import FrameError, RecordingError, escaped, os_error_as
from ospc.formats.files import beginning
from ospc.recording.channel import DEFAULT_CHANNEL, Channel
from ospc.recording.exposure_lists import read_list
from ospc.recording.frame import Frame, check_decoded_size, check_size
from ospc.recording.frame_matching import match_frames
from ospc.recording.frame_table import FrameTable, table_or_placeholder
from ospc.recording.list_search import TEXT_SUFFIXES, lists_in, only_list
from ospc.recording.options import DEFAULT, ReadingOptions
from ospc.recording.recording import StoredRecording


class VideoStream(AbstractContextManager["VideoStream"]):
    """Frames of a video by number, as one channel (green if None); reading an earlier frame restarts the video.

    It is thread-safe; reads are serialised.

    Raises
    ------
    RecordingError
        If the video cannot be decoded or its frames are too large.
    """

    def __init__(self, path: Path, channel: Channel | None = None) -> None:
        self._path = path
        self._channel = channel or DEFAULT_CHANNEL
        self._lock = threading.Lock()
        self._next = 0
        self._capture = _capture(path)

    def __exit__(self, *_: object) -> None:
        self._capture.release()

    @property
    def stated_frames(self) -> int:
        """Number of frames in the header, which may be an estimate; 0 if it is missing."""
        stated = self._capture.get(cv2.CAP_PROP_FRAME_COUNT)
        return int(stated) if 0 < stated < 2**31 else 0

    @property
    def fps(self) -> float:
        """Frame rate in the header, in frames per second."""
        return float(self._capture.get(cv2.CAP_PROP_FPS))

    def size(self) -> ImageSize:
        """Return the size of the first frame that can be decoded; RecordingError if none of the first ones can."""
        for index in range(_FIRST_FRAMES):
            with suppress(FrameError):
                return size_of(self.read(index))
        raise RecordingError(f"{self._path}: no frame can be decoded; convert the video to MJPEG or H.264")

    def is_inter_coded(self) -> bool:
        """Return whether one of the first frames is coded as a change of others, with losses."""
        if int(self._capture.get(cv2.CAP_PROP_FOURCC)) == cv2.VideoWriter.fourcc(*"FFV1"):  # has no losses
            return False
        for index in range(1, _FIRST_FRAMES):  # the first frame has no other before it
            try:
                self.read(index)
            except FrameError:
                continue
            if int(self._capture.get(cv2.CAP_PROP_FRAME_TYPE)) in _INTER_CODED:
                return True
        return False

    def read(self, index: int) -> Image:
        """Return a frame, shape (height, width), uint8; FrameError if the video ends earlier or is damaged."""
        with self._lock:
            if index < self._next:
                self._capture.release()
                self._capture = _capture(self._path)
                self._next = 0
            grabbed = False
            while self._next <= index:
                grabbed = self._grab()
            done, image = self._capture.retrieve() if grabbed else (False, None)
        if not done or image is None:
            raise FrameError(
                f"{self._path}[{index}]: the frame is damaged or missing; copy the video or record it again"
            )
        grey: Image = image if image.ndim == 2 else self._channel.of(image)
        return grey

    def count(self) -> int:
        """Return the number of frames after playing the rest of the video."""
        with self._lock:
            found = self._next
            while self._next < found + _LONGEST_DAMAGE:
                if self._grab():
                    found = self._next
            return found

    def _grab(self) -> bool:
        """Advance by one frame; if it is damaged, return False, and the decoder continues with the frame after it."""
        self._next += 1
        return bool(self._capture.grab())


def count_frames(path: Path) -> int:
    """Count the frames of a video by playing it; RecordingError if it cannot be decoded."""
    with VideoStream(path) as stream:
        return stream.count()


def _capture(path: Path) -> cv2.VideoCapture:
    try:
        # A full path is never mistaken for a URL, and one decoder gives the same pixels on every system.
        capture = cv2.VideoCapture(str(path.resolve()), cv2.CAP_FFMPEG)
    except cv2.error:
        capture = cv2.VideoCapture()
    if not capture.isOpened():
        raise RecordingError(f"{path}: the video is damaged or its codec is unknown; convert it to MJPEG or H.264")
    width, height = capture.get(cv2.CAP_PROP_FRAME_WIDTH), capture.get(cv2.CAP_PROP_FRAME_HEIGHT)
    check_decoded_size((int(width), int(height)), 3, 8, str(path))
    # Response and vignette refer to the axes of the sensor.
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
    return capture


_INTER_CODED = (ord("P"), ord("B"))
"""Types of frames that are coded as changes of earlier frames, or of earlier and later ones."""

_FIRST_FRAMES = 10
"""Number of frames whose size and type are looked at: encoders code some on their own, for example where the scene
changes, and webcams often deliver a damaged one at the beginning."""

_LONGEST_DAMAGE = 100
"""Number of consecutive frames that cannot be decoded after which a video counts as ended."""

_SIGNATURES = ((4, b"ftyp"), (4, b"moov"), (0, b"\x1aE\xdf\xa3"), (8, b"AVI "))
"""Offsets and bytes that identify MP4 and MOV, MKV and WebM, and AVI files."""

_MAX_FPS = 100_000
"""Largest plausible frame rate; a higher one is a damaged header."""

_SAMPLE_BYTES = 65536
"""Bytes of the file per sampled frame that identify the recording."""


class _Video:
    name = "video"

    def recognises(self, path: Path) -> bool:
        head = beginning(path)
        return any(head[place : place + len(text)] == text for place, text in _SIGNATURES)

    def open(self, path: Path, options: ReadingOptions = DEFAULT) -> _VideoRecording:
        # Only the content identifies a video: a playlist could lead the decoder to other files.
        if not self.recognises(path):
            raise RecordingError(f"{path}: is not an MP4, MOV, MKV, WebM or AVI file; convert it to one of these")
        table = table_or_placeholder(
            lambda: read_list(_list_of(path), options, numbered=True),
            str(path),
            lambda: count_frames(path),
            allowed=options.unknown_exposures,
        )
        with VideoStream(path, options.channel) as stream:
            stated, fps = stream.stated_frames, stream.fps
            size, inter_coded = stream.size(), stream.is_inter_coded()
        # The number in the header is often an estimate; counting takes a pass over the video.
        frames = stated if stated == len(table) else count_frames(path)
        matching = match_frames(table, frames, str(path))
        stamps_s, notes = _stamps(table, fps, path, options.channel)
        return _VideoRecording(
            path=path,
            kind=self.name,
            size=size,
            max_grey=255,
            exposures_ms=table.exposures_ms,
            stamps_s=stamps_s,
            notes=(*notes, *matching),
            channel=options.channel,
            inter_coded=inter_coded,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class _VideoRecording(StoredRecording):
    inter_coded: bool

    def __iter__(self) -> Iterator[Frame]:
        stream = VideoStream(self.path, self.channel)  # the frames share one decoder
        for index in range(len(self)):
            name = f"{escaped(self.path.name)}[{index}]"
            yield self._frame(index, name, partial(self._load, stream, index), inter_coded=self.inter_coded)

    def stored_bytes(self, index: int) -> bytes:
        # A part of the file at the relative position of the frame in the video.
        with os_error_as(FrameError, f"{self.path}: cannot be read", "check the file"), self.path.open("rb") as file:
            file.seek(self.path.stat().st_size * index // len(self))
            return file.read(_SAMPLE_BYTES)

    def _load(self, stream: VideoStream, index: int) -> Image:
        image = stream.read(index)
        check_size(size_of(image), self.size, f"{self.path}[{index}]")
        return image


def _list_of(path: Path) -> Path:
    """Return the list of exposures: the one named like the video, the only one with a usual name, or the only one."""
    own = [path.with_name(name) for name in (f"{path.stem}.csv", f"{path.stem}.txt", f"{path.name}.csv")]
    usual = [path.with_name(name) for name in ("exposures.csv", "times.txt")]
    found = [place for place in own if place.is_file()] or [place for place in usual if place.is_file()]
    if not found:  # a list that is named like another file belongs to that one
        others = {
            name for p in path.parent.iterdir() if p.suffix.lower() not in TEXT_SUFFIXES for name in (p.name, p.stem)
        }
        found = [place for place in lists_in(path.parent) if place.stem not in others]
    advice = f"put {path.stem}.csv next to it, with a header 'timestamp_s,exposure_ms' and a line for each frame"
    return only_list(found, path, advice)


def _stamps(table: FrameTable, fps: float, path: Path, channel: Channel | None) -> tuple[FloatArray, tuple[str, ...]]:
    """Return the time stamps in the list, or from the frame rate if it has none, and the notes."""
    taken = (channel or DEFAULT_CHANNEL).value
    converted = () if channel is Channel.ALL else (f"{path}: the {taken} channel of its frames is used, in 8 bits",)
    notes = (*table.notes, *converted)
    if table.stamped or not 0 < fps < _MAX_FPS:
        return table.stamps_s, notes
    notes = (*notes, f"{path}: time stamps are computed from the frame rate of {fps:g} per second")
    return read_only(np.arange(len(table)) / fps), notes


KIND = _Video()
