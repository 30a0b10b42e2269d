"""One recording of a batch: its place, its camera, and the options to read and calibrate it with."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from ospc.errors import SettingError
from ospc.exposures.findings import LagChoice, lag_choice
from ospc.recording.options import ReadingOptions, declared_options
from ospc.settings import DefaultSettings, with_overrides

_URL = re.compile(r"[a-z][a-z0-9+.-]*://")
_OWN = ("kind", "correct_lag")
_READING = tuple(declared_options())


@dataclass(frozen=True)
class Entry:
    """One recording, by its path or object-store address, and the name of its camera.

    Options are settings of the default method, ``kind``, ``correct_lag``, and the fields of
    :class:`~ospc.recording.options.ReadingOptions`, by name.
    """

    recording: str
    camera: str = "camera"
    options: tuple[tuple[str, str], ...] = ()

    @property
    def is_remote(self) -> bool:
        """Whether the recording is in an object store."""
        return is_address(self.recording)

    @property
    def kind(self) -> str | None:
        """Kind of recording; None to recognise it by its content."""
        return dict(self.options).get("kind")

    @property
    def correct_lag(self) -> LagChoice:
        """By how many frames to shift exposures before calibrating: ``"auto"``, ``"never"``, or a number."""
        return lag_choice(dict(self.options).get("correct_lag", "auto"))

    @property
    def settings(self) -> DefaultSettings:
        """Settings of the method."""
        given = {name: value for name, value in self.options if name not in (*_OWN, *_READING)}
        settings = with_overrides(DefaultSettings(), given)
        assert isinstance(settings, DefaultSettings)
        return settings

    @property
    def reading(self) -> ReadingOptions:
        """How the recording is read."""
        return ReadingOptions.of({name: value for name, value in self.options if name in _READING})

    def with_defaults(self, defaults: Mapping[str, str]) -> Entry:
        """Return the entry with options added that it does not have itself."""
        return replace(self, options=tuple({**defaults, **dict(self.options)}.items()))

    def checked(self) -> Entry:
        """Return the entry itself, after checking its options."""
        try:
            _ = self.settings, self.reading, self.correct_lag
        except SettingError as error:
            raise SettingError(f"{self.recording}: {error}") from None
        return self


def is_address(text: str) -> bool:
    """Tell whether a text is an object-store address instead of a path."""
    return _URL.match(text) is not None


def options_of(text: str) -> tuple[tuple[str, str], ...]:
    """Return the options in a text such as ``rounds=4 kind=euroc``."""
    found = {}
    for part in text.replace(";", " ").split():
        name, equals, value = part.partition("=")
        if not (name and equals):
            raise SettingError(f"option {part!r} is not NAME=VALUE, such as rounds=4")
        found[name] = value
    return tuple(found.items())


def absolute(recording: str, folder: Path) -> str:
    """Return the absolute path of a recording, relative ones taken from a folder; an address as it is."""
    return recording if is_address(recording) else str((folder / recording).absolute())
