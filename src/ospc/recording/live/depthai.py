"""Luxonis OAK cameras through DepthAI, version 3.

Sources: DepthAI's documentation: ``ImgFrame.getExposureTime`` is a duration, ``getSensitivity`` the ISO value,
``getTimestampDevice`` a duration since the device was switched on.
"""

from __future__ import annotations

from typing import Any, Self

import numpy as np

from ospc.errors import RecordingError, needs_extra, quoted
from ospc.recording.exposure_units import ExposureUnit, GainUnit
from ospc.recording.live.source import Camera, DriverFrame, cannot_be_opened
from ospc.recording.options import ReadingOptions

_SOCKETS = {"colour": "CAM_A", "left": "CAM_B", "right": "CAM_C"}
"""Sockets of the sensors, as DepthAI names them."""

_SIZE = (640, 480)
"""Width and height of the frames."""


class DepthAiCamera(Camera):
    """One sensor of an OAK camera; ``wait`` returns the next ``ImgFrame``."""

    _note = "exposures are exposure time times ISO / 100, as the device reports them with each frame"
    _exposure_unit, _gain_unit = ExposureUnit.S, GainUnit.ISO

    @classmethod
    def open(cls, which: str, options: ReadingOptions) -> Self:
        """Open the sensor ``left``, ``right`` or ``colour``; by default the last if a channel is stated."""
        sensor = which or ("left" if options.channel is None else "colour")
        if sensor not in _SOCKETS:
            raise RecordingError(f"no sensor is called {quoted(sensor)}; known: {', '.join(_SOCKETS)}")
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
            raise cannot_be_opened(name, error) from None
        return cls(lambda: queue.get() if pipeline.isRunning() else None, name, options, stop=pipeline.stop)

    def _read(self, frame: Any) -> DriverFrame:
        return DriverFrame(
            np.asarray(frame.getCvFrame()),
            frame.getExposureTime().total_seconds(),
            float(frame.getSensitivity()),
            float(frame.getTimestampDevice().total_seconds()),
        )
