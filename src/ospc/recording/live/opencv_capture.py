"""Webcams and whatever else OpenCV's capture opens.

Through it the exposure is often stale: the driver is asked after the image came, and answers what it will do next.
``ospc check`` finds out on what was recorded.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Protocol

import cv2

from ospc.arrays import Image
from ospc.errors import RecordingError, SettingError
from ospc.recording.channel import Channel
from ospc.recording.exposure_units import ExposureUnit, GainUnit
from ospc.recording.frame import Frame
from ospc.recording.live.source import Camera, ExposureReader, grey

_UNITS = {"V4L2": ExposureUnit.US100, "DSHOW": ExposureUnit.LOG2_S, "MSMF": ExposureUnit.LOG2_S}
"""What drivers count in: V4L2's ``exposure_time_absolute`` 100 µs, DirectShow and its successor log2 s."""


class Capture(Protocol):
    """What is used of ``cv2.VideoCapture``."""

    def isOpened(self) -> bool: ...  # noqa: D102, N802 (as OpenCV names it)

    def read(self) -> tuple[bool, Image | None]: ...  # noqa: D102

    def get(self, propId: int, /) -> float: ...  # noqa: D102

    def getBackendName(self) -> str: ...  # noqa: D102, N802

    def release(self) -> None: ...  # noqa: D102


class OpenCvCamera(Camera):
    """A camera that OpenCV opens.

    Parameters
    ----------
    device
        Number of the device.
    exposure_unit
        Unit of the exposures; that of the system's driver where not given.
    gain_unit
        Unit of the gains; where not given, the gain must not change.
    channel
        Channel taken of colour; luma where None.
    capture
        A capture that is open already, instead of that of the device.

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
        capture: Capture | None = None,
    ) -> None:
        self._name = f"camera {device}"
        self._capture: Capture = cv2.VideoCapture(device) if capture is None else capture
        if not self._capture.isOpened():
            raise RecordingError(f"{self._name}: cannot be opened; check its number, and that nothing else uses it")
        driver = self._capture.getBackendName()
        unit = exposure_unit or _UNITS.get(driver)
        if unit is None:
            self.close()
            raise SettingError(
                f"{self._name}: the driver {driver} does not say in which unit exposures are; state it "
                f"(s, ms, us, 100us, log2s)"
            )
        self._exposures = ExposureReader(self._name, unit, gain_unit)
        self._channel = channel
        self._notes = (
            f"{self._name}: exposures are taken as {unit.value}, those of the driver {driver}, which are often stale",
        )

    @property
    def name(self) -> str:
        """What to call it in messages."""
        return self._name

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know about its exposures."""
        return self._notes

    def __iter__(self) -> Iterator[Frame]:
        """Give the next frames as they come; they end where the driver gives no more.

        Raises
        ------
        ExposureError
            If the driver gives no exposure, or changes the gain in a unit of its own.
        """
        index = 0
        begun_s = time.monotonic()
        while True:
            done, image = self._capture.read()
            if not done or image is None:
                return
            stamp_s = time.monotonic() - begun_s
            exposure = self._capture.get(cv2.CAP_PROP_EXPOSURE)
            gain = self._capture.get(cv2.CAP_PROP_GAIN)
            exposure_ms = self._exposures.exposure_ms(exposure, gain)
            yield Frame.of_array(grey(image, self._channel), exposure_ms, index=index, stamp_s=stamp_s)
            index += 1

    def close(self) -> None:
        """Let go of the device."""
        self._capture.release()
