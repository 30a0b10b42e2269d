"""What every camera that films offers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from types import TracebackType
from typing import Self

import numpy as np

from ospc.arrays import Image
from ospc.errors import ExposureError
from ospc.recording.channel import Channel
from ospc.recording.exposure_units import EXPOSURE_RANGE_MS, ExposureUnit, GainUnit
from ospc.recording.frame import Frame

MOST_SAID = 160
"""Characters kept of what a driver says."""


class Camera(ABC):
    """A camera that films; iterating gives frames for as long as it does.

    To be used in a ``with`` statement, so that the device is let go of.
    """

    @property
    @abstractmethod
    def name(self) -> str:
        """What to call it in messages."""

    @property
    @abstractmethod
    def notes(self) -> tuple[str, ...]:
        """What a user should know about its exposures."""

    @abstractmethod
    def __iter__(self) -> Iterator[Frame]:
        """Give the next frames as they come.

        Raises
        ------
        RecordingError
            If the camera fails.
        ExposureError
            If it gives no exposure with a frame.
        """

    @abstractmethod
    def close(self) -> None:
        """Let go of the device."""

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Let go of the device."""
        self.close()


class ExposureReader:
    """Turns what a driver says of a frame into an exposure in milliseconds times linear gain.

    Parameters
    ----------
    name
        The camera, for messages.
    unit
        Unit of the exposures.
    gain_unit
        Unit of the gains; None where only the maker of the camera knows it: they must not change then.
    """

    def __init__(self, name: str, unit: ExposureUnit, gain_unit: GainUnit | None) -> None:
        self._name = name
        self._unit = unit
        self._gain_unit = gain_unit
        self._first_gain: float | None = None

    def exposure_ms(self, exposure: float, gain: float) -> float:
        """Return the exposure of a frame.

        Raises
        ------
        ExposureError
            If it is none, or a gain of unknown unit changes.
        """
        if self._gain_unit is None:
            if self._first_gain is None:
                self._first_gain = gain
            if gain != self._first_gain:
                raise ExposureError(
                    f"{self._name}: the gain changed from {self._first_gain:g} to {gain:g} in the camera's own unit; "
                    f"fix the gain, or state its unit"
                )
        factor = (self._gain_unit or GainUnit.NONE).linear(np.array(gain, dtype=np.float64))
        exposure_ms = float(self._unit.to_ms(np.array(exposure, dtype=np.float64)) * factor)
        low, high = EXPOSURE_RANGE_MS
        if not low <= exposure_ms <= high:
            raise ExposureError(
                f"{self._name}: the driver gives no exposure with its frames (exposure {exposure:g}, gain {gain:g}); "
                f"set the exposure by hand and give frames with it as Frame.of_array(image, exposure_ms)"
            )
        return exposure_ms


def grey(image: Image, channel: Channel | None) -> Image:
    """Return the grey values of an image as OpenCV orders channels: blue, green, red."""
    if image.ndim == 3 and image.shape[2] == 3:
        return (channel or Channel.LUMINANCE).of(image)
    return np.array(image[:, :, 0] if image.ndim == 3 else image)
