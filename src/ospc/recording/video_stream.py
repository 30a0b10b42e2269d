"""Sequential decoding of a video in bounded memory."""

from __future__ import annotations

import threading
from pathlib import Path

import cv2

from ospc.arrays import Image
from ospc.errors import FrameError, RecordingError
from ospc.recording.channel import Channel
from ospc.recording.frame import MAX_DECODED_BYTES


class VideoStream:
    """Frames of a video by their number, as one channel (luma if None); an earlier frame restarts the video.

    Threads may share it; their reads are serialised.

    Raises
    ------
    RecordingError
        If it cannot be decoded or its frames are too large.
    """

    def __init__(self, path: Path, channel: Channel | None = None) -> None:
        self._path = path
        self._channel = channel or Channel.LUMINANCE
        self._lock = threading.Lock()
        self._next = 0
        self._capture = _capture(path)

    def __enter__(self) -> VideoStream:
        return self

    def __exit__(self, *_: object) -> None:
        self._capture.release()

    @property
    def stated_frames(self) -> int:
        """Number of frames that the container states, possibly an estimate; 0 if it states none."""
        stated = self._capture.get(cv2.CAP_PROP_FRAME_COUNT)
        return int(stated) if 0 < stated < 2**31 else 0

    @property
    def fps(self) -> float:
        """Frame rate that the container states, in frames per second."""
        return float(self._capture.get(cv2.CAP_PROP_FPS))

    def read(self, index: int) -> Image:
        """Return a frame, shape (height, width), uint8; FrameError if the video ends earlier or is damaged."""
        with self._lock:
            if index < self._next:
                self._capture.release()
                self._capture = _capture(self._path)
                self._next = 0
            while self._next <= index:
                if not self._capture.grab():
                    raise FrameError(f"{self._path}[{index}]: the video is damaged before this frame; cut it there")
                self._next += 1
            done, image = self._capture.retrieve()
        if not done or image is None:
            raise FrameError(f"{self._path}[{index}]: the frame cannot be decoded; leave it out")
        grey: Image = image if image.ndim == 2 else self._channel.of(image)
        return grey

    def skip(self) -> bool:
        """Advance by one frame; return False at the end."""
        with self._lock:
            self._next += 1
            return bool(self._capture.grab())


def count_frames(path: Path) -> int:
    """Count the frames of a video by playing it; RecordingError if it cannot be decoded."""
    frames = 0
    with VideoStream(path) as stream:
        while stream.skip():
            frames += 1
    return frames


def _capture(path: Path) -> cv2.VideoCapture:
    try:
        # A full path is never taken for a URL, and the same decoder gives the same pixels on every system.
        capture = cv2.VideoCapture(str(path.resolve()), cv2.CAP_FFMPEG)
    except cv2.error:
        capture = cv2.VideoCapture()
    if not capture.isOpened():
        raise RecordingError(f"{path}: the video is damaged or its codec is unknown; convert it to MJPEG or H.264")
    width, height = capture.get(cv2.CAP_PROP_FRAME_WIDTH), capture.get(cv2.CAP_PROP_FRAME_HEIGHT)
    if width * height * 3 > MAX_DECODED_BYTES:
        capture.release()
        raise RecordingError(
            f"{path}: frames of {width:.0f}x{height:.0f} pixels need more than the {MAX_DECODED_BYTES} bytes "
            f"allowed; scale the video down"
        )
    # Response and vignette belong to the axes of the sensor.
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
    return capture
