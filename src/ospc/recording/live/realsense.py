"""Intel RealSense cameras, and recordings that their viewer made, through pyrealsense2.

Sources: the documentation of librealsense: ``actual_exposure`` is in µs, ``gain_level`` 16 is a gain of one in the
stereo sensors, time stamps are in ms.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ospc.arrays import Image
from ospc.errors import ExposureError, MissingExtraError, RecordingError, said_by
from ospc.recording.channel import Channel
from ospc.recording.exposure_units import ExposureUnit, GainUnit
from ospc.recording.frame import Frame
from ospc.recording.live.source import MOST_SAID, Camera, ExposureReader, grey

_GAIN_OF_ONE = 16
_WAITS, _WAIT_MS = 25, 200


class RealSenseCamera(Camera):
    """Frames of one stream of a RealSense camera.

    Parameters
    ----------
    wait
        Gives the next frame of pyrealsense2, None at the end of a recording, and raises ``RuntimeError`` where none
        comes: ``queue.wait_for_frame``, for example.
    name
        What to call the camera in messages.
    channel
        Channel taken of colour; luma where None.
    stop
        Lets go of the device.
    """

    def __init__(
        self,
        wait: Callable[[], Any],
        name: str = "RealSense",
        *,
        channel: Channel | None = None,
        stop: Callable[[], object] = lambda: None,
    ) -> None:
        self._module = _module()
        self._wait = wait
        self._name = name
        self._channel = channel
        self._stop = stop

    @classmethod
    def open(
        cls, serial: str = "", *, recording: Path | None = None, colour: bool = False, channel: Channel | None = None
    ) -> RealSenseCamera:
        """Open a camera or a recording of one.

        Parameters
        ----------
        serial
            Serial number; the first camera where empty.
        recording
            A file that the viewer of the cameras recorded: ``.db3``, formerly ``.bag``.
        colour
            Whether to take the colour stream instead of the first infrared one.
        channel
            Channel taken of colour; luma where None.

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
            # The library waits for ever, or worse, for what is not there.
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
            raise RecordingError(
                f"{name}: cannot be opened ({said_by(error, MOST_SAID)}); is it plugged in?"
            ) from None

        def wait() -> Any:
            for _ in range(_WAITS):
                arrived, frames = pipeline.try_wait_for_frames(_WAIT_MS)
                if arrived:
                    return frames.get_color_frame() if colour else frames.get_infrared_frame(1)
                if playback is not None and playback.current_status() == rs.playback_status.stopped:
                    return None
            raise RuntimeError(f"no frame within {_WAITS * _WAIT_MS / 1000:g} s")

        return cls(wait, name, channel=channel, stop=pipeline.stop)

    @property
    def name(self) -> str:
        """What to call it in messages."""
        return self._name

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know about its exposures."""
        return (f"{self._name}: exposures are actual_exposure in µs times gain_level / {_GAIN_OF_ONE}",)

    def __iter__(self) -> Iterator[Frame]:
        """Give the next frames as they come.

        Raises
        ------
        RecordingError
            If the camera fails.
        ExposureError
            If the camera gives no exposure with a frame.
        """
        value = self._module.frame_metadata_value
        exposures = ExposureReader(self._name, ExposureUnit.US, GainUnit.LINEAR)
        index = 0
        while True:
            try:
                frame = self._wait()
            except RuntimeError as error:
                raise RecordingError(f"{self._name}: stopped giving frames ({said_by(error, MOST_SAID)})") from None
            if not frame:
                return
            if not frame.supports_frame_metadata(value.actual_exposure):
                raise ExposureError(
                    f"{self._name}: gives no exposures with its frames; install the kernel patches for metadata of "
                    f"its maker, or use its RSUSB backend"
                )
            gain = 1.0
            if frame.supports_frame_metadata(value.gain_level):
                gain = frame.get_frame_metadata(value.gain_level) / _GAIN_OF_ONE
            exposure_ms = exposures.exposure_ms(float(frame.get_frame_metadata(value.actual_exposure)), gain)
            # The library takes the memory of a frame back.
            image: Image = np.array(frame.get_data())
            stamp_s = float(frame.get_timestamp()) / 1e3
            yield Frame.of_array(grey(image, self._channel), exposure_ms, index=index, stamp_s=stamp_s)
            index += 1

    def close(self) -> None:
        """Let go of the device."""
        self._stop()


def _module() -> Any:
    try:
        import pyrealsense2
    except ModuleNotFoundError:
        raise MissingExtraError("reading from RealSense cameras", "realsense") from None
    except ImportError as error:
        raise RecordingError(
            f"pyrealsense2 is installed but cannot be loaded ({said_by(error, MOST_SAID)}); install what it misses"
        ) from None
    return pyrealsense2
