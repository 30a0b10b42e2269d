"""Options for reading a recording.

Every option is declared once, as a field of :class:`ReadingOptions`. Its annotation has what the command line and
other text interfaces need: the help text, the allowed values, and how to parse them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cache
from typing import Annotated, Any, get_type_hints

from ospc.errors import SettingError
from ospc.recording.channel import Channel, Mosaic
from ospc.recording.exposure_units import ExposureUnit, GainUnit


@dataclass(frozen=True)
class Option:
    """The text form of an option.

    ``parse`` turns a text into the value; ``choices`` are the allowed texts, any if empty; ``metavar`` stands for the
    value in help texts; ``aliases`` are additional flags of the command line.
    """

    help: str
    parse: Callable[[str], object]
    choices: tuple[str, ...] = ()
    metavar: str | None = None
    aliases: tuple[str, ...] = ()


def _values(kind: type[Enum]) -> tuple[str, ...]:
    return tuple(str(member.value) for member in kind)


_CHANNELS = tuple(name for name in _values(Channel) if name != Channel.ALL.value)
"""Channels that can be calibrated."""


@dataclass(frozen=True)
class ReadingOptions:
    """What the user states about a recording; None to use or infer it from the content."""

    channel: Annotated[
        Channel | None,
        Option("Channel of colour or Bayer images, by default green.", Channel, _CHANNELS),
    ] = None
    bayer: Annotated[
        Mosaic | None, Option("The images are a Bayer mosaic of this pattern.", Mosaic, Mosaic.PATTERNS)
    ] = None
    exposure_unit: Annotated[
        ExposureUnit | None,
        Option("Unit of the exposures, instead of inferring it.", ExposureUnit, _values(ExposureUnit)),
    ] = None
    gain_unit: Annotated[
        GainUnit | None,
        Option(
            "Unit of the gains that exposures are multiplied by; none ignores the gains.", GainUnit, _values(GainUnit)
        ),
    ] = None
    image_topic: Annotated[
        str | None, Option("Topic of a bag with the images.", str, metavar="TOPIC", aliases=("--topic",))
    ] = None
    exposure_topic: Annotated[str | None, Option("Topic of a bag with the exposures.", str, metavar="TOPIC")] = None
    exposure_field: Annotated[
        str | None,
        Option(
            "Field of the messages on that topic with the exposure, such as info.shutter[0].", str, metavar="FIELD"
        ),
    ] = None
    gain_field: Annotated[str | None, Option("Field of these messages with a gain.", str, metavar="FIELD")] = None
    unknown_exposures: bool = False
    """Open recordings without usable exposures too; every frame then has an exposure of 1 ms. It has no text form."""

    @property
    def of_bags(self) -> list[str]:
        """Names of the options that are given and only make sense for ROS bags."""
        names = ("image_topic", "exposure_topic", "exposure_field", "gain_field")
        return [f"--{name.replace('_', '-')}" for name in names if getattr(self, name)]

    @classmethod
    def of(cls, texts: Mapping[str, str | None]) -> ReadingOptions:
        """Return the options from texts by field name; None if an option is not given.

        Raises
        ------
        SettingError
            If a text is not allowed for its option.
        """
        declared = declared_options()
        values: dict[str, Any] = {}
        for name, text in texts.items():
            if text is None:
                continue
            option = declared[name]
            if option.choices and text not in option.choices:
                raise SettingError(f"option {name} must be one of {', '.join(option.choices)}, not '{text}'")
            values[name] = option.parse(text)
        return cls(**values)


@cache
def declared_options() -> dict[str, Option]:
    """Return the text form of each option that has one, by field name."""
    hints = get_type_hints(ReadingOptions, include_extras=True)
    return {name: hint.__metadata__[0] for name, hint in hints.items() if hasattr(hint, "__metadata__")}


DEFAULT = ReadingOptions()
