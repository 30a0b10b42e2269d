"""Messages that carry exposures: which they are, and where in them the exposure and its gain are.

Sources: the definitions of these messages and the documentation of the drivers that send them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ospc.errors import ExposureError
from ospc.recording.bags.container import Topic
from ospc.recording.bags.messages import MessageType, is_field, value_at
from ospc.recording.bags.wire import DamagedMessageError
from ospc.recording.exposure_units import ExposureUnit, GainUnit
from ospc.recording.options import ReadingOptions
from ospc.recording.wording import escaped, quoted

_HEADER = "std_msgs/Header header\n"
_HEADER_TYPE = f"{'=' * 80}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
_MAX_JSON_CHARACTERS = 100_000


@dataclass(frozen=True)
class Reading:
    """What a message says about an exposure.

    Attributes
    ----------
    exposure
        In the unit of the carrier.
    gain
        In its unit; 1 where there is none.
    stamp_ns
        Time stamp in the message; None where it has none.
    """

    exposure: float
    gain: float
    stamp_ns: int | None


@dataclass(frozen=True)
class Carrier:
    """How exposures are found in messages of one topic.

    Attributes
    ----------
    read
        Gives exposure and gain, each in its unit, of the fields of a message; None where it holds none.
    unit
        Unit of the exposures; None where it has to be found from the numbers.
    gain_unit
        Unit of the gains; None where only the maker of the camera knows it.
    says
        What it is, for the user.
    description
        What the type of the messages is made of, for bags that do not say.
    """

    read: Callable[[Mapping[str, Any]], tuple[float, float] | None]
    unit: ExposureUnit | None
    gain_unit: GainUnit | None
    says: str
    description: str = ""

    def readings(self, topic: Topic) -> Callable[[bytes], Reading | None]:
        """Return what reads the messages of a topic.

        Raises
        ------
        ExposureError
            If the bag does not describe their type.
        """
        description = topic.description or self.description
        if not description:
            raise ExposureError(
                f"the bag does not say what messages of type {escaped(topic.type)} are made of; record it as .mcap, "
                f"or convert it with 'ros2 bag convert'"
            )
        kind = MessageType(topic.type, description, topic.encoding, idl=topic.idl)

        def read(data: bytes) -> Reading | None:
            message = kind.decode(data)
            found = self.read(message)
            return None if found is None else Reading(*found, _stamp_ns(message))

        return read


def _stamp_ns(message: Mapping[str, Any]) -> int | None:
    header = message.get("header")
    if header is None and isinstance(message.get("camera_info"), dict):
        header = message["camera_info"].get("header")
    if not isinstance(header, dict) or not isinstance(header.get("stamp"), dict):
        return None
    stamp = header["stamp"]
    total = int(stamp.get("sec", 0)) * 10**9 + int(stamp.get("nanosec", 0))
    return total or None


def number(value: Any, field: str) -> float:
    """Return a value of a message as a number; a list of one counts as that one.

    Raises
    ------
    DamagedMessageError
        If it is none.
    """
    if isinstance(value, np.ndarray | list):
        if len(value) != 1:
            raise DamagedMessageError(f"{field} has {len(value)} values; state which one is meant, as in {field}[0]")
        value = value[0]
    if isinstance(value, dict) and {"sec", "nanosec"} <= value.keys():
        return float(value["sec"]) + 1e-9 * float(value["nanosec"])
    try:
        return float(value)
    except (TypeError, ValueError):
        raise DamagedMessageError(f"{field} is no number") from None


def _fields(exposure: str, gain: str | None) -> Callable[[Mapping[str, Any]], tuple[float, float]]:
    def read(message: Mapping[str, Any]) -> tuple[float, float]:
        factor = 1.0 if gain is None else number(value_at(message, gain), gain)
        return number(value_at(message, exposure), exposure), factor

    return read


def _realsense(message: Mapping[str, Any]) -> tuple[float, float] | None:
    """Read the text that RealSense's node sends for every frame."""
    text = value_at(message, "json_data")
    if not isinstance(text, str) or len(text) > _MAX_JSON_CHARACTERS:
        return None
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        return None
    if not isinstance(content, dict):
        return None
    said = {str(key).lower().replace(" ", "_"): value for key, value in content.items()}
    if "actual_exposure" not in said:
        return None
    # 16 is a gain of one in the stereo cameras; in others the unit is only known to be linear.
    gain = number(said.get("gain_level", 16), "gain_level") / 16
    return number(said["actual_exposure"], "actual_exposure"), gain


def _realsense_text(message: Mapping[str, Any]) -> tuple[float, float] | None:
    """Read the text that RealSense's own recorder writes for every frame: ``Actual Exposure=5000;Gain Level=32;``."""
    text = value_at(message, "data")
    if not isinstance(text, str) or len(text) > _MAX_JSON_CHARACTERS:
        return None
    said = dict(pair.partition("=")[::2] for pair in text.split(";"))
    if "Actual Exposure" not in said:
        return None
    return _text_number(said["Actual Exposure"]), _text_number(said.get("Gain Level", "16")) / 16


def _diagnostics(message: Mapping[str, Any]) -> tuple[float, float] | None:
    """Read what libcamera reports of a frame as pairs of texts."""
    for status in message.get("status", ()):
        pairs = {str(v.get("key")): str(v.get("value")) for v in status.get("values", ()) if isinstance(v, dict)}
        if "ExposureTime" in pairs:
            gains = [_text_number(pairs.get(name, "1")) for name in ("AnalogueGain", "DigitalGain")]
            return _text_number(pairs["ExposureTime"]), math.prod(gains)
    return None


def _text_number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise DamagedMessageError(f"{quoted(text)} is no number") from None


_FLIR = (
    _HEADER + "uint64 camera_time\nint16 brightness\nuint32 exposure_time\nuint32 max_exposure_time\nfloat32 gain\n"
)
_DIAGNOSTICS = (
    _HEADER
    + "diagnostic_msgs/DiagnosticStatus[] status\n"
    + f"{'=' * 80}\nMSG: diagnostic_msgs/DiagnosticStatus\nbyte level\nstring name\nstring message\n"
    + "string hardware_id\ndiagnostic_msgs/KeyValue[] values\n"
    + f"{'=' * 80}\nMSG: diagnostic_msgs/KeyValue\nstring key\nstring value\n"
)

_KNOWN: dict[str, Carrier] = {
    "ExtendedCameraInfo": Carrier(
        _fields("exposure_time", "gain"), ExposureUnit.US, None, "exposure_time in µs, gain in the camera's unit"
    ),
    "ImageMetaData": Carrier(
        _fields("exposure_time", "gain"),
        ExposureUnit.US,
        GainUnit.DB,
        "exposure_time in µs, gain in dB",
        _FLIR + _HEADER_TYPE,
    ),
    "ExposureSequence": Carrier(
        _fields("shutter", "gain"), ExposureUnit.MS, GainUnit.DB, "shutter in ms, gain in dB"
    ),
    "Metadata": Carrier(
        _realsense,
        ExposureUnit.US,
        GainUnit.LINEAR,
        "actual_exposure in µs, gain_level / 16 as linear gain",
        _HEADER + "string json_data\n" + _HEADER_TYPE,
    ),
    "DiagnosticArray": Carrier(
        _diagnostics,
        ExposureUnit.US,
        GainUnit.LINEAR,
        "ExposureTime in µs, AnalogueGain × DigitalGain as linear gain",
        _DIAGNOSTICS + _HEADER_TYPE,
    ),
}
"""By the last part of the type, which is the same in all versions of the drivers."""

_NUMBERS = {
    f"std_msgs/msg/{name}": f"{name.lower()} data\n"
    for name in ("Float32", "Float64", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64")
}
_TELLING = ("exposure", "shutter")
_TEXT = "std_msgs/msg/String"
_RECORDED_BY_REALSENSE = Carrier(
    _realsense_text,
    ExposureUnit.US,
    GainUnit.LINEAR,
    "Actual Exposure in µs, Gain Level / 16 as linear gain",
    "string data\n",
)


def candidates(topics: tuple[Topic, ...]) -> Iterator[Topic]:
    """Give the topics that carry exposures, as far as their type and name tell."""
    for topic in topics:
        named = any(word in topic.name.lower() for word in _TELLING)
        if (
            _is_text_of_realsense(topic)
            or topic.type.rpartition("/")[2] in _KNOWN
            or (topic.type in _NUMBERS and named)
        ):
            yield topic


def _is_text_of_realsense(topic: Topic) -> bool:
    return topic.type == _TEXT and topic.name.endswith("/image/metadata")


def carrier_of(topic: Topic, options: ReadingOptions) -> Carrier:
    """Return how the exposures in messages of a topic are read; what the user states comes before what is known.

    Raises
    ------
    ExposureError
        If neither tells which field holds them.
    """
    if options.exposure_field is not None:
        for field in filter(None, (options.exposure_field, options.gain_field)):
            if not is_field(field):
                raise ExposureError(
                    f"{quoted(field)} is no name of a field, such as exposure_time or info.shutter[0]"
                )
        read = _fields(options.exposure_field, options.gain_field)
        carrier = Carrier(read, None, GainUnit.LINEAR, f"the field {options.exposure_field}", _described(topic))
    elif topic.type in _NUMBERS:
        carrier = Carrier(_fields("data", None), None, GainUnit.LINEAR, "its numbers", _NUMBERS[topic.type])
    elif _is_text_of_realsense(topic):
        carrier = _RECORDED_BY_REALSENSE
    else:
        known = _KNOWN.get(topic.type.rpartition("/")[2])
        if known is None:
            raise ExposureError(
                f"{escaped(topic.name)} is of type {escaped(topic.type)}; state which of its fields is the exposure "
                f"with --exposure-field"
            )
        carrier = known
    return replace(
        carrier, unit=options.exposure_unit or carrier.unit, gain_unit=options.gain_unit or carrier.gain_unit
    )


def _described(topic: Topic) -> str:
    known = _KNOWN.get(topic.type.rpartition("/")[2])
    return _NUMBERS.get(topic.type) or (known.description if known else "")
