"""Frames of a running ROS driver: its images and exposures come as messages of two topics.

Nothing of ROS is needed: messages are any objects with the fields of their types.
"""

from __future__ import annotations

from typing import Any

from ospc.arrays import Image
from ospc.errors import ExposureError
from ospc.photometry.correction import EXPOSURE_RANGE_MS
from ospc.recording.bags.carriers import carrier_of
from ospc.recording.bags.container import Topic
from ospc.recording.bags.image_messages import image_of
from ospc.recording.bags.messages import NS_PER_S, stamp_ns_of
from ospc.recording.channel import Channel
from ospc.recording.frame import Frame
from ospc.recording.options import DEFAULT, ReadingOptions

_WAITING = 30
"""Messages of each topic that wait for their counterpart; one is late by a few frames at most."""


class RosFrames:
    """Pairs images with exposures by the time stamps in their headers.

    Parameters
    ----------
    exposure_type
        Type of the messages with exposures, such as ``flir_camera_msgs/msg/ImageMetaData``. ExposureError if it is
        not known where they hold the exposure, or its unit.
    options
        Where in messages of other types the exposure is, and in which unit; the channel.
    max_grey
        Largest grey value of the camera; None for that of the data type.
    """

    def __init__(self, exposure_type: str, options: ReadingOptions = DEFAULT, *, max_grey: int | None = None) -> None:
        carrier = carrier_of(Topic("the topic of the exposures", exposure_type, None, "cdr"), options)
        if carrier.unit is None or carrier.gain_unit is None:
            what = (
                "exposures (s, ms, us, …)" if carrier.unit is None else "gains (linear, db, iso; none ignores them)"
            )
            raise ExposureError(f"{exposure_type}: state the unit of its {what}")
        self._extract, self._unit, self._gain_unit = carrier.extract, carrier.unit, carrier.gain_unit
        self._channel = options.channel
        self._max_grey = max_grey
        self._images: dict[int, Image] = {}
        self._exposures_ms: dict[int, float] = {}
        self._frames = 0
        self._last_ns = -1

    def image(self, message: Any) -> Frame | None:
        """Take a ``sensor_msgs/msg/Image``, and return its frame if its exposure came before it.

        FrameError if it cannot be read.
        """
        stored = image_of(message, "image", self._channel)
        channel = self._channel or Channel.GREEN
        grey = stored.pixels if stored.mosaic is None else stored.mosaic.of(stored.pixels, channel)
        return self._paired(message, self._images, grey)

    def exposure(self, message: Any) -> Frame | None:
        """Take a message with an exposure, and return the frame of its image if that came before it.

        ExposureError if it holds none, or one that is impossible, or has no header with a time stamp.
        """
        if not (hasattr(message, "header") or hasattr(message, "camera_info")):
            raise ExposureError("a message with an exposure has no header, whose time stamp would name its image")
        exposure, gain = self._extract(message) or (0.0, 1.0)
        exposure_ms = float(self._unit.to_ms(exposure) * self._gain_unit.linear(gain))
        if not EXPOSURE_RANGE_MS[0] <= exposure_ms <= EXPOSURE_RANGE_MS[1]:
            raise ExposureError(
                f"a message states an exposure of {exposure_ms:g} ms; switch on the driver's metadata of each frame"
            )
        return self._paired(message, self._exposures_ms, exposure_ms)

    def _paired(self, message: Any, waiting: dict[int, Any], value: Image | float) -> Frame | None:
        """Let a value wait for its counterpart; return the frame if that waits already."""
        stamp_ns = stamp_ns_of(message)
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
