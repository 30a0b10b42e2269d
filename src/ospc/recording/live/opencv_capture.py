"""Webcams and other devices that OpenCV's capture opens.

The exposures it reports are often stale: the driver is asked after the image arrived and answers with its current
setting. ``ospc check`` detects this in what was recorded.
"""

from __future__ import annotations

import time
from typing import Any

import cv2

from ospc.errors import RecordingError, SettingError
from ospc.recording.channel import Channel
from ospc.recording.exposure_units import ExposureUnit, GainUnit
from ospc.recording.live.source import Camera, DriverFrame

_UNITS = {"V4L2": ExposureUnit.US100, "DSHOW": ExposureUnit.LOG2_S, "MSMF": ExposureUnit.LOG2_S}
"""Units of drivers: V4L2's ``exposure_time_absolute`` counts 100 µs, DirectShow and its successor use log2 s."""


class OpenCvCamera(Camera):
    """A camera that OpenCV opens.

    Parameters
    ----------
    device
        Number of the device.
    exposure_unit, gain_unit, channel
        As for every :class:`~ospc.recording.live.source.Camera`; exposures are by default in the driver's unit.
    capture
        A ``cv2.VideoCapture`` that is already open, instead of one for the device.

    Raises
    ------
    RecordingError
        If there is no such camera.
    SettingError
        If the unit of the exposures has to be stated.
    """

    def __init__(
        self,
        device: int = 0,
        *,
        exposure_unit: ExposureUnit | None = None,
        gain_unit: GainUnit | None = None,
        channel: Channel | None = None,
        capture: Any = None,
    ) -> None:
        name = f"camera {device}"
        self._capture = cv2.VideoCapture(device) if capture is None else capture
        if not self._capture.isOpened():
            raise RecordingError(f"{name}: cannot be opened; check its number, and that no other program uses it")
        driver = self._capture.getBackendName()
        unit = exposure_unit or _UNITS.get(driver)
        if unit is None:
            self._capture.release()
            raise SettingError(
                f"{name}: the driver {driver} does not say in which unit exposures are; state it "
                f"(s, ms, us, 100us, log2s)"
            )
        note = f"exposures are taken as {unit.value}, the unit of the driver {driver}; they are often stale"
        super().__init__(name, note, unit, gain_unit, channel=channel, stop=self._capture.release)
        self._begun_s = time.monotonic()

    def _next(self) -> DriverFrame | None:
        done, image = self._capture.read()
        if not done or image is None:
            return None
        stamp_s = time.monotonic() - self._begun_s
        exposure, gain = (self._capture.get(key) for key in (cv2.CAP_PROP_EXPOSURE, cv2.CAP_PROP_GAIN))
        return DriverFrame(image, exposure, gain, stamp_s)
