"""Intel RealSense cameras, and recordings made with their viewer, through pyrealsense2.

Sources: the documentation of librealsense: ``actual_exposure`` is in µs, ``gain_level`` 16 is a gain of one in the
stereo sensors, time stamps are in ms.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ospc.errors import ExposureError, MissingExtraError, RecordingError
from ospc.recording.channel import Channel
from ospc.recording.exposure_units import REALSENSE_UNIT_GAIN, ExposureUnit, GainUnit
from ospc.recording.live.source import Camera, DriverFrame, quoted_driver

_WAITS, _WAIT_MS = 25, 200
"""Attempts to get a frame, and how long each waits: five seconds in all, as a camera needs to start."""


class RealSenseCamera(Camera):
    """One stream of a RealSense camera.

    Parameters
    ----------
    wait
        Returns the next frame of pyrealsense2 or None at the end of a recording, and raises ``RuntimeError`` if none
        arrives: ``queue.wait_for_frame``, for example.
    name, channel, stop
        As for every :class:`~ospc.recording.live.source.Camera`.
    """

    def __init__(
        self,
        wait: Callable[[], Any],
        name: str = "RealSense",
        *,
        channel: Channel | None = None,
        stop: Callable[[], object] = lambda: None,
    ) -> None:
        note = f"exposures are actual_exposure in µs times gain_level / {REALSENSE_UNIT_GAIN}"
        super().__init__(name, note, ExposureUnit.US, GainUnit.LINEAR, channel=channel, stop=stop)
        self._metadata = _module().frame_metadata_value
        self._wait = wait

    @classmethod
    def open(
        cls, serial: str = "", *, recording: Path | None = None, colour: bool = False, channel: Channel | None = None
    ) -> RealSenseCamera:
        """Open a camera or a recording of one.

        Parameters
        ----------
        serial
            Serial number; the first camera if empty.
        recording
            A file recorded with RealSense's viewer: ``.db3``, formerly ``.bag``.
        colour, channel
            Whether to take the colour stream instead of the first infrared stream, and its channel; luma if None.

        Raises
        ------
        MissingExtraError
            If pyrealsense2 is not installed.
        RecordingError
            If there is no such camera or recording.
        """
        rs = _module()
        config = rs.config()
        if recording is not None:
            # For a missing file the library may wait forever.
            if not recording.is_file():
                raise RecordingError(f"{recording}: there is no such file; check the path")
            config.enable_device_from_file(str(recording), False)
        elif serial:
            config.enable_device(serial)
        if colour:
            config.enable_stream(rs.stream.color, rs.format.bgr8, 0)
        else:
            config.enable_stream(rs.stream.infrared, 1, rs.format.y8, 0)
        name = str(recording) if recording is not None else f"RealSense {serial}".strip()
        pipeline = rs.pipeline()
        playback = None
        try:
            profile = pipeline.start(config)
            if recording is not None:
                playback = profile.get_device().as_playback()
                playback.set_real_time(False)
        except RuntimeError as error:
            raise RecordingError(f"{name}: cannot be opened ({quoted_driver(error)}); is it plugged in?") from None

        def wait() -> Any:
            for _ in range(_WAITS):
                arrived, frames = pipeline.try_wait_for_frames(_WAIT_MS)
                if arrived:
                    return frames.get_color_frame() if colour else frames.get_infrared_frame(1)
                if playback is not None and playback.current_status() == rs.playback_status.stopped:
                    return None
            raise RuntimeError(f"no frame within {_WAITS * _WAIT_MS / 1000:g} s")

        return cls(wait, name, channel=channel, stop=pipeline.stop)

    def _next(self) -> DriverFrame | None:
        try:
            frame = self._wait()
        except RuntimeError as error:
            raise RecordingError(f"{self.name}: stopped giving frames ({quoted_driver(error)})") from None
        if not frame:
            return None
        value = self._metadata
        if not frame.supports_frame_metadata(value.actual_exposure):
            raise ExposureError(
                f"{self.name}: gives no exposures with its frames; install the maker's kernel patches for metadata, "
                f"or use its RSUSB backend"
            )
        gain = 1.0
        if frame.supports_frame_metadata(value.gain_level):
            gain = frame.get_frame_metadata(value.gain_level) / REALSENSE_UNIT_GAIN
        exposure_us = float(frame.get_frame_metadata(value.actual_exposure))
        # The copy outlives the frame, whose memory the library reuses.
        return DriverFrame(np.array(frame.get_data()), exposure_us, gain, float(frame.get_timestamp()) / 1e3)


def _module() -> Any:
    try:
        import pyrealsense2
    except ModuleNotFoundError:
        raise MissingExtraError("reading from RealSense cameras", "realsense") from None
    except ImportError as error:
        raise RecordingError(
            f"pyrealsense2 is installed but cannot be loaded ({quoted_driver(error)}); install what it misses"
        ) from None
    return pyrealsense2
