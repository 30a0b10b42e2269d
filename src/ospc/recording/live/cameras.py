"""Opening live cameras by a short text."""

from __future__ import annotations

import re
from pathlib import Path

from ospc.errors import SettingError, quoted
from ospc.recording.live.source import Camera
from ospc.recording.options import DEFAULT, ReadingOptions

_NUMBER = re.compile(r"\d{1,4}", re.ASCII)
"""The number of a device; more digits are a mistake."""

_EXPECTED = "expected opencv:NUMBER, realsense, realsense:SERIAL, realsense:FILE (.db3 or .bag), or depthai:SENSOR"


def open_camera(text: str, options: ReadingOptions = DEFAULT) -> Camera:
    """Open a live camera.

    Parameters
    ----------
    text
        ``opencv:0`` for the first webcam; ``realsense``, ``realsense:SERIAL``, or a recording of its viewer,
        ``realsense:FILE.db3`` or ``realsense:FILE.bag``; ``depthai:left``, ``depthai:right`` or ``depthai:colour``.
    options
        Units of exposure and gain for ``opencv``, and the channel taken from colour.

    Raises
    ------
    SettingError
        If the text names no kind of camera, or a unit has to be stated.
    MissingExtraError
        If the optional dependency for the camera is not installed.
    RecordingError
        If there is no such camera.

    Examples
    --------
    >>> from ospc import OnlineCalibrator
    >>> calibrator = OnlineCalibrator()
    >>> with open_camera("realsense") as camera:  # doctest: +SKIP
    ...     for frame in camera:
    ...         calibrator.push(frame)
    """
    kind, _, which = text.partition(":")
    channel = options.channel
    colour = channel is not None
    if kind == "opencv" and _NUMBER.fullmatch(which or "0"):
        from ospc.recording.live.opencv_capture import OpenCvCamera

        return OpenCvCamera(
            int(which or 0), exposure_unit=options.exposure_unit, gain_unit=options.gain_unit, channel=channel
        )
    if kind == "realsense":
        from ospc.recording.live.realsense import RealSenseCamera

        if which.endswith((".bag", ".db3")):
            return RealSenseCamera.open(recording=Path(which), colour=colour, channel=channel)
        return RealSenseCamera.open(which, colour=colour, channel=channel)
    if kind == "depthai":
        from ospc.recording.live.depthai import DepthAiCamera

        return DepthAiCamera.open(which or ("colour" if colour else "left"), channel=channel)
    raise SettingError(f"{quoted(text)} is not a camera; {_EXPECTED}")
