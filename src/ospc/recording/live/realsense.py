"""Intel RealSense cameras, and recordings made with their viewer, through pyrealsense2.

Sources: the documentation of librealsense: ``actual_exposure`` is in µs, ``gain_level`` 16 is a gain of one in the
stereo sensors, time stamps are in ms.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Self

import numpy as np

from ospc.errors import ExposureError, MissingExtraError, RecordingError
from ospc.recording.exposure_units import REALSENSE_UNIT_GAIN, ExposureUnit, GainUnit
from ospc.recording.live.source import Camera, DriverFrame, cannot_be_opened, said_by_driver
from ospc.recording.options import ReadingOptions

_WAITS, _WAIT_MS = 25, 200
"""Attempts to get a frame, and how long each waits: five seconds in all, as a camera needs to start."""


class RealSenseCamera(Camera):
    """One stream of a RealSense camera; ``wait`` is, for example, ``queue.wait_for_frame`` of pyrealsense2."""

    _note = f"exposures are actual_exposure in µs times gain_level / {REALSENSE_UNIT_GAIN}"
    _exposure_unit, _gain_unit = ExposureUnit.US, GainUnit.LINEAR

    @classmethod
    def open(cls, which: str, options: ReadingOptions) -> Self:
        """Open a camera by its serial number, the first one without it, or a recording made with RealSense's viewer.

        The first infrared stream is taken, or the colour stream if a channel is stated.
        """
        recording = Path(which) if which.endswith((".bag", ".db3")) else None
        colour = options.channel is not None
        rs = _module()
        config = rs.config()
        if recording is not None:
            # For a missing file the library may wait forever.
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
            profile = pipeline.start(config)
            if recording is not None:
                playback = profile.get_device().as_playback()
                playback.set_real_time(False)
        except RuntimeError as error:
            raise cannot_be_opened(name, error) from None

        def wait() -> Any:
            for _ in range(_WAITS):
                arrived, frames = pipeline.try_wait_for_frames(_WAIT_MS)
                if arrived:
                    return (frames.get_color_frame() if colour else frames.get_infrared_frame(1)) or None
                if playback is not None and playback.current_status() == rs.playback_status.stopped:
                    return None
            raise RuntimeError(f"no frame within {_WAITS * _WAIT_MS / 1000:g} s")

        return cls(wait, name, options, stop=pipeline.stop)

    def _read(self, frame: Any) -> DriverFrame:
        value = _module().frame_metadata_value
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
            f"pyrealsense2 is installed but cannot be loaded ({said_by_driver(error)}); install what it misses"
        ) from None
    return pyrealsense2
