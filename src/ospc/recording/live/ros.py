"""Frames from a running ROS driver, whose images and exposures are messages on two topics.

ROS need not be installed: messages are any objects with the fields of their types.
"""

from __future__ import annotations

from typing import Any

from ospc.arrays import Image
from ospc.errors import ExposureError, FrameError, RecordingError
from ospc.photometry.correction import checked_exposure
from ospc.recording.bags.carriers import carrier_of
from ospc.recording.bags.container import Topic
from ospc.recording.bags.image_messages import image_of
from ospc.recording.bags.messages import NS_PER_S, DamagedMessageError, stamp_ns_of
from ospc.recording.channel import DEFAULT_CHANNEL
from ospc.recording.frame import Frame
from ospc.recording.options import DEFAULT, ReadingOptions

_WAITING = 30
"""Messages of each topic that wait for their counterpart, which is at most a few frames late."""

_CLOCK_STEP_NS = 2 * NS_PER_S
"""A stamp this much earlier than that of the latest frame shows that the clock was set, or a bag begins again."""


class RosFrames:
    """Pairs images with exposures by the time stamps in their headers.

    Parameters
    ----------
    exposure_type
        Type of the messages with exposures, such as ``flir_camera_msgs/msg/ImageMetaData``.
    options
        Field and unit of the exposure in messages of other types, and the channel to use.
    max_grey
        Largest grey value of the camera; None for the maximum of the data type.

    Raises
    ------
    ExposureError
        If the field with the exposure, or a unit, is unknown.
    """

    def __init__(self, exposure_type: str, options: ReadingOptions = DEFAULT, *, max_grey: int | None = None) -> None:
        carrier = carrier_of(Topic("", exposure_type, None, "cdr"), options, "the topic of the exposures")
        if carrier.unit is None or carrier.gain_unit is None:
            what = (
                "exposures (s, ms, us, …)" if carrier.unit is None else "gains (linear, db, iso; none ignores them)"
            )
            raise ExposureError(f"{exposure_type}: give the unit of its {what}")
        self._carrier, self._unit, self._gain_unit = carrier, carrier.unit, carrier.gain_unit
        self._channel = options.channel
        self._max_grey = max_grey
        self._images: dict[int, Image] = {}
        self._exposures_ms: dict[int, float] = {}
        self._frames = 0
        self._last_ns = -1

    def image(self, message: Any) -> Frame | None:
        """Add a ``sensor_msgs/msg/Image``, and return its frame if its exposure has already arrived.

        Raises
        ------
        FrameError
            If the image cannot be read, or the message has no time stamp.
        """
        stored = image_of(message, "image", self._channel)
        mosaic = stored.mosaic
        grey = stored.pixels if mosaic is None else mosaic.of(stored.pixels, self._channel or DEFAULT_CHANNEL)
        return self._paired(message, self._images, grey, FrameError)

    def exposure(self, message: Any) -> Frame | None:
        """Add a message with an exposure, and return the frame if its image has already arrived.

        Raises
        ------
        ExposureError
            If the message has no exposure, an impossible one, unexpected fields, or no time stamp.
        """
        try:
            exposure, gain, _ = self._carrier.read(message) or (0.0, 1.0, 0)
        except DamagedMessageError as error:
            raise ExposureError(str(error)) from None
        exposure_ms = float(self._unit.to_ms(exposure) * self._gain_unit.linear(gain))
        checked_exposure(exposure_ms, "a message's exposure", "enable the metadata of each frame in the driver")
        return self._paired(message, self._exposures_ms, exposure_ms, ExposureError)

    def _paired(
        self, message: Any, waiting: dict[int, Any], value: Image | float, error: type[RecordingError]
    ) -> Frame | None:
        """Store a value, and return the frame if its counterpart has already arrived."""
        stamp_ns = stamp_ns_of(message)
        stamped = hasattr(message, "header") or hasattr(message, "camera_info")
        # A simulated clock begins at 0, which is also the stamp of drivers that set none.
        if not stamped or stamp_ns <= 0 <= self._last_ns:
            raise error("a message has no time stamp in its header, by which images and exposures are matched")
        if stamp_ns < self._last_ns - _CLOCK_STEP_NS:
            self._images.clear()
            self._exposures_ms.clear()
            self._last_ns = -1
        waiting[stamp_ns] = value
        while len(waiting) > _WAITING:
            del waiting[next(iter(waiting))]
        if stamp_ns not in self._images or stamp_ns not in self._exposures_ms or stamp_ns <= self._last_ns:
            return None
        image, exposure_ms = self._images.pop(stamp_ns), self._exposures_ms.pop(stamp_ns)
        self._last_ns = stamp_ns
        index, self._frames = self._frames, self._frames + 1
        stamp_s = stamp_ns / NS_PER_S
        return Frame.of_array(image, exposure_ms, index=index, stamp_s=stamp_s, max_grey=self._max_grey)
