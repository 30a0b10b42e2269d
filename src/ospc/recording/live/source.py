"""The base class of live cameras."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from itertools import count
from typing import Any, Self

import numpy as np

from ospc.arrays import Image
from ospc.errors import ExposureError, RecordingError, message_of
from ospc.photometry.correction import checked_exposure
from ospc.recording.channel import DEFAULT_CHANNEL
from ospc.recording.exposure_units import ExposureUnit, GainUnit
from ospc.recording.frame import Frame
from ospc.recording.options import DEFAULT, ReadingOptions

_QUOTED_CHARACTERS = 160
"""Maximum length of a driver message that an error quotes."""


class Camera(AbstractContextManager["Camera"]):
    """A live camera. Iterating yields frames until it stops. Use it in a ``with`` statement to release the device.

    Parameters
    ----------
    wait
        Returns the next frame of the driver, in its own type, or None at the end; raises RuntimeError if it fails.
    name
        Name of the camera in messages.
    options
        The channel of colour images to use; green if None.
    stop
        Releases the device.
    """

    _note: str
    _exposure_unit: ExposureUnit
    _gain_unit: GainUnit | None
    """None if only the manufacturer knows the unit of the gain, which must then stay constant."""

    def __init__(
        self,
        wait: Callable[[], Any],
        name: str,
        options: ReadingOptions = DEFAULT,
        *,
        stop: Callable[[], object] = lambda: None,
    ) -> None:
        self.name = name
        self.notes = (f"{name}: {self._note}",)
        self._wait = wait
        self._channel = options.channel or DEFAULT_CHANNEL
        self._stop = stop
        self._first_gain: float | None = None

    @classmethod
    @abstractmethod
    def open(cls, which: str, options: ReadingOptions) -> Self:
        """Open a camera; ``which`` follows the colon in :func:`~ospc.recording.live.drivers.open_camera`."""

    @abstractmethod
    def _read(self, frame: Any) -> tuple[Image, float, float, float]:
        """Return the image, exposure and gain in units of the driver, and the time stamp in s.

        Colour images have the channels blue, green, red.
        """

    def __iter__(self) -> Iterator[Frame]:
        """Yield frames as they arrive, numbered from 0.

        Raises
        ------
        RecordingError
            If the camera fails.
        ExposureError
            If a frame has no exposure, or a gain of unknown unit changes.
        """
        for index in count():
            try:
                waited = self._wait()
            except RuntimeError as error:
                raise RecordingError(f"{self.name}: stopped delivering frames ({driver_message(error)})") from None
            if waited is None:
                return
            image, exposure, gain, stamp_s = self._read(waited)
            exposure_ms = self._exposure_ms(exposure, gain)
            yield Frame.of_array(self._grey(image), exposure_ms, index=index, stamp_s=stamp_s)

    def close(self) -> None:
        """Release the device."""
        self._stop()

    def __exit__(self, *_: object) -> None:
        self.close()

    def _grey(self, image: Image) -> Image:
        if image.ndim == 3 and image.shape[2] == 3:
            return self._channel.of(image)
        return np.array(image[:, :, 0] if image.ndim == 3 else image)

    def _exposure_ms(self, exposure: float, gain: float) -> float:
        if self._first_gain is None:
            self._first_gain = gain
        if self._gain_unit is None and gain != self._first_gain:
            raise ExposureError(
                f"{self.name}: the gain changed from {self._first_gain:g} to {gain:g} in the camera's own unit; "
                f"lock the gain, or give its unit"
            )
        factor = (self._gain_unit or GainUnit.NONE).linear(gain)
        exposure_ms = float(self._exposure_unit.to_ms(exposure) * factor)
        remedy = "set it manually and pass it as Frame.of_array(image, exposure_ms)"
        return checked_exposure(exposure_ms, f"{self.name}: the driver's exposure", remedy)


def driver_message(error: BaseException) -> str:
    """Return the shortened message of a driver, for quoting."""
    return message_of(error, _QUOTED_CHARACTERS)
