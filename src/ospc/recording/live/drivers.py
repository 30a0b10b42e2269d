"""Drivers of live cameras with their units.

Exposures from OpenCV are often stale: the driver is queried after the image has arrived and returns its current
setting. ``ospc check`` detects this in a recording.

Sources: in the documentation of librealsense, ``actual_exposure`` is in µs, a ``gain_level`` of 16 is a gain of one
for stereo sensors, and time stamps are in ms. In the documentation of DepthAI 3, ``ImgFrame.getExposureTime`` is a
duration, ``getSensitivity`` the ISO value, and ``getTimestampDevice`` the time since the device was switched on.
"""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np

from ospc.arrays import Image
from ospc.errors import ExposureError, RecordingError, SettingError, needs_extra, quoted
from ospc.recording.exposure_units import REALSENSE_UNIT_GAIN, ExposureUnit, GainUnit
from ospc.recording.live.source import Camera, driver_message
from ospc.recording.options import DEFAULT, ReadingOptions

_UNITS = {"V4L2": ExposureUnit.US100, "DSHOW": ExposureUnit.LOG2_S, "MSMF": ExposureUnit.LOG2_S}
"""Units of drivers: ``exposure_time_absolute`` of V4L2 counts 100 µs; DirectShow and its successor use log2 s."""


class OpenCvCamera(Camera):
    """A camera opened by OpenCV as ``capture``; the options may state the units and the channel."""

    def __init__(self, capture: Any, name: str, options: ReadingOptions = DEFAULT) -> None:
        if not capture.isOpened():
            raise RecordingError(f"{name}: cannot be opened; check its number and that no other program is using it")
        driver = capture.getBackendName()
        unit = options.exposure_unit or _UNITS.get(driver)
        if unit is None:
            capture.release()
            raise SettingError(
                f"{name}: the unit of exposures is unknown for the driver {driver}; give it (s, ms, us, 100us, log2s)"
            )
        self._note = f"exposures are in {unit.value}, the unit of the driver {driver}; they are often stale"
        self._exposure_unit, self._gain_unit = unit, options.gain_unit
        self._capture = capture
        self._begun_s = time.monotonic()
        super().__init__(self._image, name, options, stop=capture.release)

    @classmethod
    def open(cls, which: str, options: ReadingOptions) -> Self:
        """Open the device with this number, by default the first one."""
        device = int(which or 0)
        return cls(cv2.VideoCapture(device), f"camera {device}", options)

    def _image(self) -> Image | None:
        done, image = self._capture.read()
        return image if done else None

    def _read(self, frame: Image) -> tuple[Image, float, float, float]:
        stamp_s = time.monotonic() - self._begun_s
        exposure, gain = (self._capture.get(key) for key in (cv2.CAP_PROP_EXPOSURE, cv2.CAP_PROP_GAIN))
        return frame, exposure, gain, stamp_s


_WAITS, _WAIT_MS = 25, 200
"""Number of attempts to get a frame, and timeout of each: five seconds in total, because cameras take time to
start."""


class RealSenseCamera(Camera):
    """A stream of a RealSense camera; ``wait`` is, for example, ``queue.wait_for_frame`` of pyrealsense2."""

    _note = f"exposures are actual_exposure in µs times gain_level / {REALSENSE_UNIT_GAIN}"
    _exposure_unit, _gain_unit = ExposureUnit.US, GainUnit.LINEAR

    @classmethod
    def open(cls, which: str, options: ReadingOptions) -> Self:
        """Open a camera by serial number, the first camera if empty, or a recording of the RealSense viewer.

        The first infrared stream is used, or the colour stream if a channel is stated.
        """
        recording = Path(which) if which.endswith((".bag", ".db3")) else None
        colour = options.channel is not None
        rs = _module()
        config = rs.config()
        if recording is not None:
            # The library may wait forever for a missing file.
            if not recording.is_file():
                raise RecordingError(f"{recording}: there is no such file; check the path")
            config.enable_device_from_file(str(recording), False)
        elif which:
            config.enable_device(which)
        if colour:
            config.enable_stream(rs.stream.color, rs.format.bgr8, 0)
        else:
            config.enable_stream(rs.stream.infrared, 1, rs.format.y8, 0)
        name = which if recording is not None else f"RealSense {which}".strip()
        pipeline = rs.pipeline()
        playback = None
        try:
            if recording is not None:
                # Before the start, because playback in real time may lose the first frames.
                playback = config.resolve(rs.pipeline_wrapper(pipeline)).get_device().as_playback()
                playback.set_real_time(False)
            pipeline.start(config)
        except RuntimeError as error:
            raise RecordingError(f"{name}: cannot be opened ({driver_message(error)}); is it plugged in?") from None

        def wait() -> Any:
            for _ in range(_WAITS):
                arrived, frames = pipeline.try_wait_for_frames(_WAIT_MS)
                if arrived:
                    return (frames.get_color_frame() if colour else frames.get_infrared_frame(1)) or None
                if playback is not None and playback.current_status() == rs.playback_status.stopped:
                    return None
            raise RuntimeError(f"no frame within {_WAITS * _WAIT_MS / 1000:g} s")

        return cls(wait, name, options, stop=pipeline.stop)

    def _read(self, frame: Any) -> tuple[Image, float, float, float]:
        value = _module().frame_metadata_value
        if not frame.supports_frame_metadata(value.actual_exposure):
            raise ExposureError(
                f"{self.name}: delivers no exposures with its frames; install the kernel patches of librealsense for "
                f"metadata, or use its RSUSB backend"
            )
        gain = 1.0
        if frame.supports_frame_metadata(value.gain_level):
            gain = frame.get_frame_metadata(value.gain_level) / REALSENSE_UNIT_GAIN
        exposure_us = float(frame.get_frame_metadata(value.actual_exposure))
        # A copy, because the library reuses the memory of the frame.
        return np.array(frame.get_data()), exposure_us, gain, float(frame.get_timestamp()) / 1e3


def _module() -> Any:
    with needs_extra("reading from RealSense cameras", "realsense"):
        try:
            import pyrealsense2
        except ModuleNotFoundError:
            raise
        except ImportError as error:
            raise RecordingError(
                f"pyrealsense2 is installed but cannot be loaded ({driver_message(error)}); install what is missing"
            ) from None
    return pyrealsense2


_SOCKETS, _SIZE = {"colour": "CAM_A", "left": "CAM_B", "right": "CAM_C"}, (640, 480)
"""DepthAI names of the sockets, and width and height of the frames."""


class DepthAiCamera(Camera):
    """A sensor of an OAK camera; ``wait`` returns the next ``ImgFrame``."""

    _note = "exposures are exposure time times ISO / 100, as reported by the device with each frame"
    _exposure_unit, _gain_unit = ExposureUnit.S, GainUnit.ISO

    @classmethod
    def open(cls, which: str, options: ReadingOptions) -> Self:
        """Open the sensor ``left``, ``right`` or ``colour``; by default ``left``, or with a channel ``colour``."""
        sensor = which or ("left" if options.channel is None else "colour")
        if sensor not in _SOCKETS:
            raise RecordingError(f"{quoted(sensor)} is not a sensor; known: {', '.join(_SOCKETS)}")
        with needs_extra("reading from OAK cameras", "depthai"):
            import depthai
        name = f"DepthAI {sensor}"
        kind = depthai.ImgFrame.Type.BGR888i if sensor == "colour" else depthai.ImgFrame.Type.GRAY8
        try:
            pipeline = depthai.Pipeline()
            socket = getattr(depthai.CameraBoardSocket, _SOCKETS[sensor])
            camera = pipeline.create(depthai.node.Camera).build(socket)
            queue = camera.requestOutput(_SIZE, kind).createOutputQueue()
            pipeline.start()
        except RuntimeError as error:
            raise RecordingError(f"{name}: cannot be opened ({driver_message(error)}); is it plugged in?") from None
        return cls(lambda: queue.get() if pipeline.isRunning() else None, name, options, stop=pipeline.stop)

    def _read(self, frame: Any) -> tuple[Image, float, float, float]:
        return (
            np.asarray(frame.getCvFrame()),
            frame.getExposureTime().total_seconds(),
            float(frame.getSensitivity()),
            float(frame.getTimestampDevice().total_seconds()),
        )


_NUMBER = re.compile(r"\d{1,4}", re.ASCII)
"""Number of a device; more digits are a mistake."""

_KINDS: dict[str, type[Camera]] = {"opencv": OpenCvCamera, "realsense": RealSenseCamera, "depthai": DepthAiCamera}
_EXPECTED = (
    "check the path, or name a camera: opencv:NUMBER, realsense, realsense:SERIAL, realsense:FILE (.db3 or .bag), or "
    "depthai:SENSOR"
)


def names_camera(text: str) -> bool:
    """Return whether a text is that of a live camera, see :func:`open_camera`."""
    return text.partition(":")[0] in _KINDS


def open_camera(text: str, options: ReadingOptions = DEFAULT) -> Camera:
    """Open a live camera.

    Parameters
    ----------
    text
        ``opencv:0`` for the first webcam; ``realsense``, ``realsense:SERIAL``, or a recording of its viewer,
        ``realsense:FILE.db3`` or ``realsense:FILE.bag``; ``depthai:left``, ``depthai:right`` or ``depthai:colour``.
    options
        Units of exposure and gain for ``opencv``, and the channel of colour images to use.

    Raises
    ------
    SettingError
        If the text is not a camera, or a unit must be stated.
    MissingExtraError
        If the optional dependency for the camera is not installed.
    RecordingError
        If there is no such camera.
    """
    kind, _, which = text.partition(":")
    chosen = _KINDS.get(kind)
    if chosen is None or (chosen is OpenCvCamera and not _NUMBER.fullmatch(which or "0")):
        raise SettingError(f"{quoted(text)} is neither a camera nor an existing recording; {_EXPECTED}")
    return chosen.open(which, options)
