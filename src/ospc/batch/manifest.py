"""Read the list of recordings of a batch from a folder, a pattern, or a table."""

from __future__ import annotations

import csv
import glob
import io
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ospc.batch.object_store import is_address, matches
from ospc.errors import FormatError, RecordingError, SettingError, listed, os_error_as, quoted
from ospc.exposures.lag_choice import LagChoice, lag_choice
from ospc.recording.kinds import is_recording, open_recording
from ospc.recording.list_search import is_output
from ospc.recording.options import ReadingOptions, declared_options
from ospc.settings import DefaultSettings, check_names, with_overrides

_OWN = ("kind", "correct_lag")
_READING = tuple(declared_options())


@dataclass(frozen=True)
class Entry:
    """One recording, given by its path or object-store address, and the name of its camera.

    Option names are settings of the default method, ``kind``, ``correct_lag``, and the fields of
    :class:`~ospc.recording.options.ReadingOptions`, except ``unknown_exposures``: only recordings with exposures can
    be merged.
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
        """What to do about a lag of the exposures: ``"auto"``, ``"never"``, or a number of frames."""
        return lag_choice(dict(self.options).get("correct_lag", "auto"))

    @property
    def settings(self) -> DefaultSettings:
        """Settings of the method."""
        given = {name: value for name, value in self.options if name not in (*_OWN, *_READING)}
        return with_overrides(DefaultSettings(), given, (*_OWN, *_READING))

    @property
    def reading(self) -> ReadingOptions:
        """Options for reading the recording."""
        return ReadingOptions.of({name: value for name, value in self.options if name in _READING})

    def with_defaults(self, defaults: Mapping[str, str]) -> Entry:
        """Return the entry with defaults for options that it does not set."""
        return replace(self, options=tuple({**defaults, **dict(self.options)}.items()))

    def checked(self) -> Entry:
        """Check the options and return the entry."""
        try:
            check_names(self.settings)
            _ = self.reading, self.correct_lag
        except SettingError as error:
            raise SettingError(f"{self.recording}: {error}") from None
        return self


def options_of(text: str) -> tuple[tuple[str, str], ...]:
    """Return the options in a text such as ``rounds=4 kind=euroc``."""
    found = {}
    for part in text.replace(";", " ").split():
        name, equals, value = part.partition("=")
        if not (name and equals):
            raise SettingError(f"option {part!r} is not NAME=VALUE, such as rounds=4")
        found[name] = value
    return tuple(found.items())


_MOST_BYTES = 1_000_000_000
_MOST_ENTRIES = 5_000_000
"""Limits of a manifest: what one process can hold in memory."""

_DEEPEST = 4
"""Depth to which folders are searched for recordings: camera, day, run, and one to spare."""


def read_manifest(
    manifest: str, camera: str | None = None, left_out: Callable[[str], None] = lambda _reason: None
) -> list[Entry]:
    """Return the recordings listed by a manifest, without opening them.

    The manifest is one of

    - a ``.csv`` table, separated by commas or semicolons, with the columns ``recording`` (a path, relative to the
      table's folder, or an object-store address), ``camera`` and ``options`` (such as ``rounds=4 kind=euroc``); the
      last two are optional, and other columns are ignored;
    - a folder: a recording, or every recording in it, up to four folders deep; a recording's parent folder names its
      camera;
    - a pattern such as ``recordings/*/cam0``, which may be an object-store address; cameras are named as for folders.

    ``camera`` overrides the cameras of the manifest. ``left_out`` is called with a reason for each folder below the
    given one that contains no recording.

    Raises
    ------
    OspcError
        If the manifest does not exist or lists no recording, a table cannot be read or has no column ``recording``,
        an option is unknown or has an invalid value, or an optional dependency is missing.
    """
    place = Path(manifest)
    if is_address(manifest):
        entries = [Entry(address, _parent_of(address)) for address in matches(manifest)]
    elif place.is_dir():
        found = [place] if is_recording(place) else _recordings_in(place, left_out)
        entries = [_of_path(each) for each in found]
    elif place.suffix.lower() == ".csv":
        entries = list(_of_table(place))
    else:
        entries = [_of_path(Path(path)) for path in sorted(glob.glob(manifest, recursive=True))]  # noqa: PTH207 (the pattern may be absolute)
    if not entries:
        raise RecordingError(f"{manifest}: no recordings there; give a folder, a pattern, or a table of recordings")
    if len(entries) > _MOST_ENTRIES:
        raise RecordingError(f"{manifest}: more than {_MOST_ENTRIES} recordings; split it")
    if camera is not None:
        entries = [replace(entry, camera=camera) for entry in entries]
    return list(dict.fromkeys(entries))


def _parent_of(address: str) -> str:
    parts = [part for part in address.split("://", 1)[1].split("/") if part]
    return parts[-2] if len(parts) > 1 else "camera"


def _of_path(place: Path) -> Entry:
    return Entry(str(place.absolute()), place.absolute().parent.name)


def _recordings_in(folder: Path, left_out: Callable[[str], None], depth: int = 0) -> Iterator[Path]:
    """Yield the recordings below a folder, without searching inside recordings."""
    for place in sorted(folder.iterdir()):
        if place.name.startswith("."):
            continue
        if is_output(place):
            left_out(f"{place}: is the output of a calibration or correction")
        elif is_recording(place):
            yield place
        elif place.is_dir():
            below: list[Path] = []
            unknown: list[str] = []
            if not place.is_symlink() and depth + 1 < _DEEPEST:
                with suppress(OSError):  # a folder that cannot be read is left out
                    below = list(_recordings_in(place, unknown.append, depth + 1))
            yield from below
            # If nothing is found, report the outermost folder, not everything in it.
            for reason in unknown if below else [_why_unknown(place, depth)]:
                left_out(reason)


def _why_unknown(place: Path, depth: int) -> str:
    if place.is_symlink():
        return f"{place}: a link that does not point to a recording"
    try:
        with os_error_as(RecordingError, f"{place}: cannot be read"):
            if depth + 1 >= _DEEPEST and any(inner.is_dir() or is_recording(inner) for inner in place.iterdir()):
                return f"{place}: is not searched, because its content is more than {_DEEPEST} levels deep"
            open_recording(place)
    except RecordingError as error:
        return error.problem
    return f"{place}: not recognised as a recording"


def _of_table(place: Path) -> Iterator[Entry]:
    with os_error_as(RecordingError, f"{place}: cannot be read", "check the path"):
        if place.stat().st_size > _MOST_BYTES:
            raise FormatError(f"{place}: is larger than {_MOST_BYTES // 10**6} MB; split it")
        rows = _rows(place)
    folder = place.absolute().parent
    for number, row in enumerate(rows, start=2):
        recording = (row.get("recording") or "").strip()
        if not recording or "\0" in recording:
            raise FormatError(f"{place}, row {number}: names no recording; give a path in column recording")
        if not is_address(recording):
            recording = str((folder / recording).absolute())
        camera = (row.get("camera") or "").strip() or "camera"
        try:
            yield Entry(recording, camera, options_of(row.get("options") or "")).checked()
        except SettingError as error:
            raise SettingError(f"{place}, row {number}: {error}") from None


def _rows(place: Path) -> list[dict[Any, Any]]:
    """Return the cells of each row by column; a row may have fewer cells than there are columns."""
    try:
        text = place.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise FormatError(f"{place}: is not UTF-8 text; save it as UTF-8") from None
    try:
        separator = _separator(text)
        reader = csv.DictReader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
        names = reader.fieldnames or []
        rows = list(reader)
    except csv.Error as error:
        raise FormatError(f"{place}: cannot be read as CSV ({error})") from None
    if "recording" not in names:
        found = listed([quoted(name) for name in names]) or "none"
        raise FormatError(
            f"{place}: has no column recording (its columns: {found}); name the columns in the first line, separated "
            "by commas or semicolons; camera and options are optional"
        )
    for number, row in enumerate(rows, start=2):
        if any(row.get(None, ())):  # cells beyond the last column
            quote = "paths with commas" if separator == "," else "cells with semicolons"
            raise FormatError(f"{place}, row {number}: has more cells than the first line; quote {quote}")
    return rows


def _separator(text: str) -> str:
    """Return what separates the cells: spreadsheets write semicolons where the decimal sign is a comma."""
    header = text.lstrip("\r\n").partition("\n")[0]
    return ";" if ";" in header and "," not in header else ","
