"""Webcams and other devices that OpenCV's capture opens.

The exposures it reports are often stale: the driver is asked after the image arrived and answers with its current
setting. ``ospc check`` detects this in what was recorded.
"""

from __future__ import annotations

import time
from typing import Any, Self

import cv2

from ospc.arrays import Image
from ospc.errors import RecordingError, SettingError
from ospc.recording.exposure_units import ExposureUnit
from ospc.recording.live.source import Camera, DriverFrame
from ospc.recording.options import DEFAULT, ReadingOptions

_UNITS = {"V4L2": ExposureUnit.US100, "DSHOW": ExposureUnit.LOG2_S, "MSMF": ExposureUnit.LOG2_S}
"""Units of drivers: V4L2's ``exposure_time_absolute`` counts 100 µs, DirectShow and its successor use log2 s."""


class OpenCvCamera(Camera):
    """A camera that OpenCV opened as ``capture``; the options may state the units and the channel."""

    def __init__(self, capture: Any, name: str, options: ReadingOptions = DEFAULT) -> None:
        if not capture.isOpened():
            raise RecordingError(f"{name}: cannot be opened; check its number, and that no other program uses it")
        driver = capture.getBackendName()
        unit = options.exposure_unit or _UNITS.get(driver)
        if unit is None:
            capture.release()
            raise SettingError(
                f"{name}: the driver {driver} does not say in which unit exposures are; state it "
                f"(s, ms, us, 100us, log2s)"
            )
        self._note = f"exposures are taken as {unit.value}, the unit of the driver {driver}; they are often stale"
        self._exposure_unit, self._gain_unit = unit, options.gain_unit
        self._capture = capture
        self._begun_s = time.monotonic()
        super().__init__(self._image, name, options, stop=capture.release)

    @classmethod
    def open(cls, which: str, options: ReadingOptions) -> Self:
        """Open the device with a number, by default the first one."""
        device = int(which or 0)
        return cls(cv2.VideoCapture(device), f"camera {device}", options)

    def _image(self) -> Image | None:
        done, image = self._capture.read()
        return image if done else None

    def _read(self, frame: Image) -> DriverFrame:
        stamp_s = time.monotonic() - self._begun_s
        exposure, gain = (self._capture.get(key) for key in (cv2.CAP_PROP_EXPOSURE, cv2.CAP_PROP_GAIN))
        return DriverFrame(frame, exposure, gain, stamp_s)
