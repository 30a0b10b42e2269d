"""Luxonis OAK cameras through DepthAI, version 3.

Sources: DepthAI's documentation: ``ImgFrame.getExposureTime`` is a duration, ``getSensitivity`` the ISO value,
``getTimestampDevice`` a duration since the device was switched on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ospc.errors import MissingExtraError, RecordingError, said_by
from ospc.recording.channel import Channel
from ospc.recording.exposure_units import ExposureUnit, GainUnit
from ospc.recording.frame import Frame
from ospc.recording.live.source import MOST_SAID, Camera, ExposureReader, grey

SOCKETS = {"colour": "CAM_A", "left": "CAM_B", "right": "CAM_C"}


class DepthAiCamera(Camera):
    """Frames of one sensor of an OAK camera.

    Parameters
    ----------
    wait
        Gives the next ``ImgFrame``: ``queue.get``.
    name
        What to call the camera in messages.
    channel
        Channel taken of colour; luma where None.
    running
        Tells whether more frames will come.
    stop
        Lets go of the device.
    """

    def __init__(
        self,
        wait: Callable[[], Any],
        name: str = "DepthAI",
        *,
        channel: Channel | None = None,
        running: Callable[[], bool] = lambda: True,
        stop: Callable[[], object] = lambda: None,
    ) -> None:
        self._wait = wait
        self._name = name
        self._channel = channel
        self._running = running
        self._stop = stop

    @classmethod
    def open(
        cls, sensor: str = "left", size: tuple[int, int] = (640, 480), *, channel: Channel | None = None
    ) -> DepthAiCamera:
        """Open a camera.

        Parameters
        ----------
        sensor
            One of :data:`SOCKETS`.
        size
            Width and height of the frames in pixels.
        channel
            Channel taken of the colour sensor; luma where None.

        Raises
        ------
        MissingExtraError
            If DepthAI is not installed.
        RecordingError
            If there is no such camera.
        """
        if sensor not in SOCKETS:
            raise RecordingError(f"no sensor is called '{sensor[:20]}'; known: {', '.join(SOCKETS)}")
        try:
            import depthai
        except ImportError:
            raise MissingExtraError("reading from OAK cameras", "depthai") from None
        name = f"DepthAI {sensor}"
        colour = sensor == "colour"
        kind = depthai.ImgFrame.Type.BGR888i if colour else depthai.ImgFrame.Type.GRAY8
        try:
            pipeline = depthai.Pipeline()
            socket = getattr(depthai.CameraBoardSocket, SOCKETS[sensor])
            camera = pipeline.create(depthai.node.Camera).build(socket)
            queue = camera.requestOutput(size, kind).createOutputQueue()
            pipeline.start()
        except RuntimeError as error:
            said = said_by(error, MOST_SAID)
            raise RecordingError(f"{name}: cannot be opened ({said}); is it plugged in?") from None
        return cls(queue.get, name, channel=channel, running=pipeline.isRunning, stop=pipeline.stop)

    @property
    def name(self) -> str:
        """What to call it in messages."""
        return self._name

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know about its exposures."""
        return (f"{self._name}: exposures are exposure time times ISO / 100, as the device notes them in each frame",)

    def __iter__(self) -> Iterator[Frame]:
        """Give the next frames as they come.

        Raises
        ------
        RecordingError
            If the camera fails.
        ExposureError
            If the camera gives no exposure with a frame.
        """
        exposures = ExposureReader(self._name, ExposureUnit.S, GainUnit.ISO)
        index = 0
        while self._running():
            try:
                frame = self._wait()
            except RuntimeError as error:
                said = said_by(error, MOST_SAID)
                raise RecordingError(f"{self._name}: stopped giving frames ({said})") from None
            exposure_s, iso = frame.getExposureTime().total_seconds(), float(frame.getSensitivity())
            exposure_ms = exposures.exposure_ms(exposure_s, iso)
            image = grey(np.asarray(frame.getCvFrame()), self._channel)
            stamp_s = float(frame.getTimestampDevice().total_seconds())
            yield Frame.of_array(image, exposure_ms, index=index, stamp_s=stamp_s)
            index += 1

    def close(self) -> None:
        """Let go of the device."""
        self._stop()
