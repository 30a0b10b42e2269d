"""Messages that carry exposures, and the fields with exposure and gain.

Sources: the definitions of these messages and the documentation of the drivers that send them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ospc.errors import ExposureError, quoted
from ospc.recording.bags.container import Topic
from ospc.recording.bags.messages import (
    NS_PER_S,
    DamagedMessageError,
    MessageType,
    is_field,
    shown,
    stamp_ns_of,
    value_at,
)
from ospc.recording.exposure_units import REALSENSE_UNIT_GAIN, ExposureUnit, GainUnit
from ospc.recording.list_columns import (
    gain_unit_named,
    gain_unit_note,
    is_gain,
    looks_like_gain,
    states_gain_unit,
    unit_named,
)
from ospc.recording.options import ReadingOptions

_MAX_TEXT_CHARACTERS = 100_000
"""Maximum length of metadata texts; those of RealSense cameras have about 1000 characters."""

_Extract = Callable[[Any], tuple[float, float] | None]
"""Returns exposure and gain (1 for none) of a message in their units; None if it has no exposure."""


@dataclass(frozen=True)
class Carrier:
    """How the messages of a topic carry exposures, with a summary of fields and units for the user.

    ``unit`` is None to infer it from the numbers; ``gain_unit`` is None if only the manufacturer knows it.
    ``has_gain`` is whether the messages include the gain; otherwise it may be on topics of its own. ``gain_assumed``
    is whether the gain is only assumed to be linear.
    """

    topic: Topic
    extract: _Extract
    unit: ExposureUnit | None
    gain_unit: GainUnit | None
    summary: str
    has_gain: bool = True
    gain_assumed: bool = False

    def readings(self) -> Callable[[bytes], tuple[float, float, int] | None]:
        """Return a function that reads serialised messages.

        Raises
        ------
        DamagedMessageError
            If the bag does not define the type of the messages.
        """
        kind = _type_of(self.topic)
        return lambda data: self.read(kind.decode(data))

    def read(self, message: Any) -> tuple[float, float, int] | None:
        """Return exposure, gain and time stamp in ns (0 for none) of a message; DamagedMessageError if that fails."""
        try:
            found = self.extract(message)
            return None if found is None else (*found, stamp_ns_of(message))
        except (AttributeError, TypeError, ValueError, OverflowError):
            # A known type may be defined in another way.
            raise DamagedMessageError(f"messages of type {quoted(self.topic.type)} have unexpected fields") from None


def _type_of(topic: Topic) -> MessageType:
    return MessageType(topic.type, topic.encoding, topic.definition, idl=topic.idl)


def _number(value: Any, field: str) -> float:
    """Return a value of a message as a number, from a list its only item, and from a duration seconds."""
    if isinstance(value, np.ndarray | list):
        if len(value) != 1:
            raise DamagedMessageError(f"{field} has {len(value)} values; choose one, as in {field}[0]")
        value = value[0]
    if hasattr(value, "sec") and hasattr(value, "nanosec"):
        return float(value.sec) + float(value.nanosec) / NS_PER_S
    try:
        return float(value)
    except (TypeError, ValueError):
        raise DamagedMessageError(f"{field} is not a number") from None


def _fields(exposure: str, gain: str | None) -> _Extract:
    def extract(message: Any) -> tuple[float, float]:
        factor = 1.0 if gain is None else _number(value_at(message, gain), gain)
        return _number(value_at(message, exposure), exposure), factor

    return extract


def _realsense(text_field: str) -> _Extract:
    """Return how to read a text about a frame: JSON, or ``Actual Exposure=5000;Gain Level=32;`` of the recorder."""

    def extract(message: Any) -> tuple[float, float] | None:
        text = getattr(message, text_field)
        if len(text) > _MAX_TEXT_CHARACTERS:
            return None
        try:
            content = json.loads(text)
        except (ValueError, RecursionError):
            content = dict(pair.partition("=")[::2] for pair in text.split(";"))
        if not isinstance(content, dict):
            return None
        said = {key.lower().replace(" ", "_"): value for key, value in content.items()}
        if "actual_exposure" not in said:
            return None
        gain = _number(said.get("gain_level", REALSENSE_UNIT_GAIN), "gain_level") / REALSENSE_UNIT_GAIN
        return _number(said["actual_exposure"], "actual_exposure"), gain

    return extract


def _diagnostics(message: Any) -> tuple[float, float] | None:
    """Read the metadata of libcamera, which are pairs of texts."""
    for status in message.status:
        said = {pair.key: pair.value for pair in status.values}
        if "ExposureTime" in said:
            gains = [_number(said.get(name, "1"), name) for name in ("AnalogueGain", "DigitalGain")]
            return _number(said["ExposureTime"], "ExposureTime"), math.prod(gains)
    return None


_US, _MS, _LINEAR, _DB = ExposureUnit.US, ExposureUnit.MS, GainUnit.LINEAR, GainUnit.DB
_TIME_AND_GAIN, _GAIN = _fields("exposure_time", "gain"), f"{REALSENSE_UNIT_GAIN} as linear gain"
_KNOWN: dict[str, tuple[_Extract, ExposureUnit, GainUnit | None, str]] = {
    "ExtendedCameraInfo": (_TIME_AND_GAIN, _US, None, "exposure_time in µs, gain in the camera's unit"),
    "ImageMetaData": (_TIME_AND_GAIN, _US, _DB, "exposure_time in µs, gain in dB"),
    "ExposureSequence": (_fields("shutter", "gain"), _MS, _DB, "shutter in ms, gain in dB"),
    "Metadata": (_realsense("json_data"), _US, _LINEAR, f"actual_exposure in µs, gain_level / {_GAIN}"),
    "DiagnosticArray": (_diagnostics, _US, _LINEAR, "ExposureTime in µs, AnalogueGain × DigitalGain as linear gain"),
}
"""How known messages carry exposures, by the last part of their type, which all versions of a driver share."""

_NUMBERS = tuple(
    f"std_msgs/msg/{name}" for name in ("Float32", "Float64", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64")
)
_EXPOSURE_WORDS = ("exposure", "shutter")
"""A topic of plain numbers carries exposures if its name contains one of these words."""


def candidates(topics: tuple[Topic, ...]) -> Iterator[Topic]:
    """Yield the topics that carry exposures according to their types and names."""
    for topic in topics:
        named = any(word in topic.name.lower() for word in _EXPOSURE_WORDS) and not is_gain(_last_step(topic))
        if _known(topic) is not None and (topic.type not in _NUMBERS or named):
            yield topic


def gains_in(topics: tuple[Topic, ...]) -> Iterator[Topic]:
    """Yield the topics of plain numbers that carry gains according to their names."""
    exposures = {topic.name for topic in candidates(topics)}
    for topic in topics:
        named = looks_like_gain(_last_step(topic)) or looks_like_gain(topic.name)
        if topic.type in _NUMBERS and named and topic.name not in exposures:
            yield topic


def gain_carrier(topic: Topic, options: ReadingOptions) -> Carrier:
    """Return how a topic carries gains, as if they were exposures; only the name of a sure gain tells the unit.

    The summary is the unit for notes.
    """
    name = _last_step(topic)
    unit = options.gain_unit or (gain_unit_named(name) if is_gain(name) else None)
    said = "" if unit is None else gain_unit_note(name, unit, stated=options.gain_unit is not None)
    return Carrier(topic, _fields("data", None), None, unit, said)


def _last_step(topic: Topic) -> str:
    return topic.name.rpartition("/")[2]


def _known(topic: Topic) -> Carrier | None:
    if topic.type in _NUMBERS:
        unit = unit_named(topic.name)
        how = "" if unit is None else f" in {unit.value}"
        return Carrier(topic, _fields("data", None), unit, _LINEAR, f"its numbers{how}", has_gain=False)
    if topic.type == "std_msgs/msg/String" and topic.name.endswith("/image/metadata"):
        return Carrier(topic, _realsense("data"), _US, _LINEAR, f"Actual Exposure in µs, Gain Level / {_GAIN}")
    known = _KNOWN.get(topic.type.rpartition("/")[2])
    return None if known is None else Carrier(topic, *known)


def carrier_of(topic: Topic, options: ReadingOptions, source: str) -> Carrier:
    """Return how the messages of a topic, called ``source`` in messages, carry exposures; options take precedence.

    Raises
    ------
    ExposureError
        If the user must state the field with the exposures.
    """
    carrier = _known(topic)
    if options.exposure_field is not None:
        gain = options.gain_field
        if gain is None and options.gain_unit is not GainUnit.NONE:
            gain = _gain_field(topic, source)
        carrier = _stated(topic, options.exposure_field, gain, options)
    elif options.gain_field is not None:
        raise ExposureError("--gain-field needs --exposure-field, the field of the same messages with the exposure")
    if carrier is None:
        numbers = _number_fields(topic)
        raise ExposureError(
            f"{source} has type {topic.type}; give the field of the exposure with "
            f"--exposure-field{numbers and f': {shown(numbers)}'}"
        )
    gain_unit = (options.gain_unit if carrier.has_gain else None) or carrier.gain_unit
    return replace(carrier, unit=options.exposure_unit or carrier.unit, gain_unit=gain_unit)


def _number_fields(topic: Topic) -> list[str]:
    """Return the fields of messages that are numbers; none if the bag does not define their type."""
    try:
        return _type_of(topic).numbers()
    except DamagedMessageError:
        return []


def _gain_field(topic: Topic, source: str) -> str | None:
    """Return the field with the gain, None if there is none; ExposureError if it is unclear which field it is."""
    found = [field for field in _number_fields(topic) if looks_like_gain(_last_part(field))]
    if len(found) > 1 or not all(is_gain(_last_part(field)) for field in found):
        raise ExposureError(
            f"{source} also has {shown(found)}; name the field by which exposures must be multiplied with "
            "--gain-field, or add --gain-unit none to ignore all gains"
        )
    return found[0] if found else None


def _stated(topic: Topic, exposure: str, gain: str | None, options: ReadingOptions) -> Carrier:
    """Return the carrier with the fields that the user states; their names may contain units."""
    for field in filter(None, (exposure, gain)):
        if not is_field(field):
            raise ExposureError(f"{quoted(field)} is not a field name, such as exposure_time or info.shutter[0]")
    unit = options.exposure_unit or unit_named(_last_part(exposure))
    summary = f"the field {exposure}" if unit is None else f"the field {exposure} in {unit.value}"
    if gain is None:
        return Carrier(topic, _fields(exposure, None), unit, _LINEAR, summary, has_gain=False)
    name, chosen = _last_part(gain), options.gain_unit or (None if options.gain_field is None else _LINEAR)
    gain_unit = options.gain_unit or gain_unit_named(name) or chosen
    said = "" if gain_unit is None else gain_unit_note(name, gain_unit, stated=options.gain_unit is not None)
    summary += f" times the gain in field {gain}{said}"
    assumed = chosen is None and not states_gain_unit(name)
    return Carrier(topic, _fields(exposure, gain), unit, gain_unit, summary, gain_assumed=assumed)


def _last_part(field: str) -> str:
    """Return ``shutter_us`` of ``info.shutter_us[0]``."""
    return field.rpartition(".")[2].partition("[")[0]
