"""Luxonis OAK cameras through DepthAI, version 3.

Sources: DepthAI's documentation: ``ImgFrame.getExposureTime`` is a duration, ``getSensitivity`` the ISO value,
``getTimestampDevice`` a duration since the device was switched on.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ospc.errors import RecordingError, needs_extra, quoted
from ospc.recording.channel import Channel
from ospc.recording.exposure_units import ExposureUnit, GainUnit
from ospc.recording.live.source import Camera, DriverFrame, quoted_driver

SOCKETS = {"colour": "CAM_A", "left": "CAM_B", "right": "CAM_C"}
"""Sockets of the sensors, as DepthAI names them."""


class DepthAiCamera(Camera):
    """One sensor of an OAK camera.

    Parameters
    ----------
    wait
        Returns the next ``ImgFrame``: ``queue.get``.
    name, channel, stop
        As for every :class:`~ospc.recording.live.source.Camera`.
    running
        Tells whether more frames will arrive.
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
        note = "exposures are exposure time times ISO / 100, as the device reports them with each frame"
        super().__init__(name, note, ExposureUnit.S, GainUnit.ISO, channel=channel, stop=stop)
        self._wait = wait
        self._running = running

    @classmethod
    def open(
        cls, sensor: str = "left", size: tuple[int, int] = (640, 480), *, channel: Channel | None = None
    ) -> DepthAiCamera:
        """Open one of the sensors :data:`SOCKETS`, with frames of the given width and height.

        Raises
        ------
        MissingExtraError
            If DepthAI is not installed.
        RecordingError
            If there is no such camera.
        """
        if sensor not in SOCKETS:
            raise RecordingError(f"no sensor is called {quoted(sensor)}; known: {', '.join(SOCKETS)}")
        with needs_extra("reading from OAK cameras", "depthai"):
            import depthai
        name = f"DepthAI {sensor}"
        kind = depthai.ImgFrame.Type.BGR888i if sensor == "colour" else depthai.ImgFrame.Type.GRAY8
        try:
            pipeline = depthai.Pipeline()
            socket = getattr(depthai.CameraBoardSocket, SOCKETS[sensor])
            camera = pipeline.create(depthai.node.Camera).build(socket)
            queue = camera.requestOutput(size, kind).createOutputQueue()
            pipeline.start()
        except RuntimeError as error:
            raise RecordingError(f"{name}: cannot be opened ({quoted_driver(error)}); is it plugged in?") from None
        return cls(queue.get, name, channel=channel, running=pipeline.isRunning, stop=pipeline.stop)

    def _next(self) -> DriverFrame | None:
        if not self._running():
            return None
        try:
            frame = self._wait()
        except RuntimeError as error:
            raise RecordingError(f"{self.name}: stopped giving frames ({quoted_driver(error)})") from None
        return DriverFrame(
            np.asarray(frame.getCvFrame()),
            frame.getExposureTime().total_seconds(),
            float(frame.getSensitivity()),
            float(frame.getTimestampDevice().total_seconds()),
        )
