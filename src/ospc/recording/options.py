"""How a recording is read, as far as its content does not say.

Every option is declared once, as a field of :class:`ReadingOptions`. Its metadata hold what the command line and
other text interfaces need: help, the texts it takes, and how a text becomes a value.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from enum import Enum
from typing import Any

from ospc.errors import SettingError
from ospc.recording.bayer import Mosaic
from ospc.recording.channel import Channel
from ospc.recording.exposure_units import ExposureUnit, GainUnit

_KEY = "option"


@dataclass(frozen=True)
class Option:
    """How a user states an option as text.

    Attributes
    ----------
    help
        What it is, in a sentence.
    parse
        Turns a text into the value.
    choices
        The only texts it takes; any if empty.
    metavar
        Placeholder for the value in help texts.
    aliases
        Further flags of the command line.
    """

    help: str
    parse: Callable[[str], object]
    choices: tuple[str, ...] = ()
    metavar: str | None = None
    aliases: tuple[str, ...] = ()


def _stated(summary: str, parse: Callable[[str], object] = str, **more: Any) -> dict[str, Option]:
    """Return the metadata of a field."""
    if isinstance(parse, type) and issubclass(parse, Enum):
        more["choices"] = tuple(str(member.value) for member in parse)
    return {_KEY: Option(summary, parse, **more)}


@dataclass(frozen=True)
class ReadingOptions:
    """What the user states about a recording; None wherever its content decides."""

    channel: Channel | None = field(
        default=None,
        metadata=_stated(
            "Channel of colour or Bayer images; by default the luminance of colour images and the green pixels of a "
            "Bayer mosaic.",
            Channel,
        ),
    )
    bayer: Mosaic | None = field(
        default=None,
        metadata=_stated("The images are a Bayer mosaic of this pattern.", Mosaic, choices=tuple(Mosaic.PATTERNS)),
    )
    exposure_unit: ExposureUnit | None = field(
        default=None, metadata=_stated("Unit of the exposures, instead of inferring it.", ExposureUnit)
    )
    gain_unit: GainUnit | None = field(
        default=None,
        metadata=_stated("Unit of the gains that exposures are multiplied by; none ignores the gains.", GainUnit),
    )
    image_topic: str | None = field(
        default=None,
        metadata=_stated("Topic of a bag with the images.", metavar="TOPIC", aliases=("--topic",)),
    )
    exposure_topic: str | None = field(
        default=None, metadata=_stated("Topic of a bag with the exposures.", metavar="TOPIC")
    )
    exposure_field: str | None = field(
        default=None,
        metadata=_stated(
            "Field of the messages on that topic with the exposure, such as info.shutter[0].", metavar="FIELD"
        ),
    )
    gain_field: str | None = field(
        default=None, metadata=_stated("Field of these messages with a gain.", metavar="FIELD")
    )
    unknown_exposures: bool = field(
        default=False,
        metadata=_stated(
            "Open recordings without usable exposures too; every frame then has an exposure of 1 ms.",
            "true".__eq__,
            choices=("true", "false"),
        ),
    )

    @classmethod
    def of(cls, texts: Mapping[str, str | None]) -> ReadingOptions:
        """Return the options stated as text.

        Parameters
        ----------
        texts
            Texts by the names of the fields; None for what is not stated.

        Raises
        ------
        SettingError
            If an option does not take the text.
        """
        declared = declared_options()
        values: dict[str, Any] = {}
        for name, text in texts.items():
            if text is None:
                continue
            option = declared[name]
            if option.choices and text not in option.choices:
                raise SettingError(f"option {name} is one of {', '.join(option.choices)}, not '{text}'")
            values[name] = option.parse(text)
        return cls(**values)


def declared_options() -> dict[str, Option]:
    """Return how each option is stated as text, by the names of the fields."""
    return {entry.name: entry.metadata[_KEY] for entry in fields(ReadingOptions)}


DEFAULT = ReadingOptions()
