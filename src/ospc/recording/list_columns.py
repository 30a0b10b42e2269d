"""Columns of a list of exposures: their meaning and units, read from the header or inferred from the first row.

Fields are separated by commas, semicolons, tabs or spaces. The header is the first line, or the last comment line
before the data. Without a header, lines are ``id stamp[s] exposure[ms]``, ``file exposure[ms]`` or ``exposure[ms]``.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ospc.errors import ExposureError, RecordingError, listed, quoted
from ospc.recording.exposure_units import ExposureUnit, GainUnit
from ospc.recording.table_text import is_fraction, is_number, lines_of

Rows = list[tuple[int, list[str]]]
"""Line number and fields of every line."""

_DECIMAL_COMMA = re.compile(r"\A([+-]?\d+),(\d+)\Z", re.ASCII)

_UNITS = {unit.value: unit for unit in ExposureUnit} | {
    **dict.fromkeys(("sec", "second"), ExposureUnit.S),
    **dict.fromkeys(("msec", "millisecond"), ExposureUnit.MS),
    **dict.fromkeys(("µs", "μs", "usec", "microsecond"), ExposureUnit.US),
    "nanosecond": ExposureUnit.NS,
    "100µs": ExposureUnit.US100,
}
"""Units of exposures and time stamps by their spelling, in lower case and without a plural."""

# Words for each meaning; columns that match an earlier group take precedence over later groups.
_V4L2_WORDS = ("exposuretimeabsolute", "exposureabsolute")
_EXPOSURE_WORDS = (
    ("exposure", "exposuretime", *_V4L2_WORDS),
    ("shutter", "shuttertime", "exptime", "integrationtime"),
    ("actualexposure", "actualexposuretime", "setexposure", "setexposuretime"),
    ("shutterspeed", "shutterspeedvalue"),
)
_STAMP_WORDS = (("timestamp", "stamp"), ("time",))
_IMAGE_WORDS = (
    ("file", "filename"),
    ("image", "imagename", "imagefile", "path", "name"),
    ("id", "frameid", "imageid"),
    ("frame", "framenumber", "frameindex", "imagenumber", "imageindex"),
)
_ISO_WORDS = (
    ("iso",),
    ("isospeed", "isospeedrating", "isovalue", "isosetting", "photographicsensitivity"),
    ("sensitivity", "sensorsensitivity", "isosensitivity"),
)

_GAIN = re.compile(
    r"(?P<total>total|overall|combined)?(?:a|d|analog|analogue|digital|sensor|master|camera|linear)?gains?"
    r"(?P<unit>db|iso|linear|factor|(?P<own>percent|pct|%|raw|level|code|steps?|index))?"
)
"""Names of gains without blanks, in lower case. Parts of a gain multiply; the unit may be the camera's own."""

_APERTURE_WORDS = (("fnumber",), ("fstop",), ("aperture",), ("aperturevalue",))

_GAIN_UNITS = {"db": GainUnit.DB, "iso": GainUnit.ISO}

_ASSUMED_LINEAR = ", as its name states no unit; add --gain-unit db if it is in decibels"

_LIKE_A_GAIN = re.compile(r"gain|sensitivity|iso$|^iso(?:speed|value|setting|rating|equivalent)")
_OF_A_COLOUR = re.compile(r"red|blue|colou?r|white|awb|wb|rgb|^[rb]gain|gain[rb]$")
_OF_ISO = re.compile(r"iso|^gaincontrol$|^standardoutputsensitivity$|^sensitivitytype$")
"""Names like those of gains; those of white balance, which does not change green; and what EXIF adds to the ISO."""


@dataclass(frozen=True)
class Columns:
    """The number of columns, and the index of the column with each meaning, or None.

    ``gains`` has index, header and unit of the columns by which the exposure is multiplied; the unit is None if only
    the manufacturer knows it. ``doubtful`` has index and header of other columns that look like gains, and
    ``aperture`` is the f-number. ``unit`` is the unit of the exposure and ``stamp_unit`` that of the time stamps,
    None if the header does not state it. ``notes`` state assumptions, and ``named`` whether there is a header.
    """

    count: int
    image: int | None = None
    stamp: int | None = None
    exposure: int | None = None
    gains: tuple[tuple[int, str, GainUnit | None], ...] = ()
    doubtful: tuple[tuple[int, str], ...] = ()
    aperture: int | None = None
    unit: ExposureUnit | None = None
    stamp_unit: ExposureUnit | None = None
    notes: tuple[str, ...] = ()
    named: bool = True


def name_columns(header: Sequence[str], place: str) -> Columns:
    """Infer the meaning of columns from their names.

    Raises
    ------
    ExposureError
        If several columns could be the exposures, the time stamps, or the image names. The message begins with
        ``place``.
    """
    exposure = _only(header, _EXPOSURE_WORDS, place)
    if exposure is None:
        return Columns(len(header))
    stamp = _only(header, _STAMP_WORDS, place)
    image = _only(header, _IMAGE_WORDS, place)
    iso = _only(header, _ISO_WORDS, place)
    gains = _gains(header) + ([] if iso is None else [(iso, header[iso], GainUnit.ISO)])
    taken = {exposure, stamp, image, *(i for i, _, _ in gains)}
    doubtful = [(i, name) for i, name in enumerate(header) if i not in taken and _is_doubtful(name, iso is not None)]
    return Columns(
        len(header),
        image=image,
        stamp=stamp,
        exposure=exposure,
        gains=tuple(gains),
        doubtful=tuple(doubtful),
        aperture=_only(header, _APERTURE_WORDS, place),
        unit=unit_named(header[exposure]),
        stamp_unit=None if stamp is None else unit_named(header[stamp]),
    )


def _gains(header: Sequence[str]) -> list[tuple[int, str, GainUnit | None]]:
    """Return the columns of gains other than ISO: the parts of the gain, or the total if its parts are not there."""
    found = [(i, name, match) for i, name in enumerate(header) if (match := _GAIN.fullmatch(_joined(name)))]
    parts = [entry for entry in found if not entry[2]["total"]] or found
    return [(i, name, gain_unit_named(name)) for i, name, _ in parts]


def _is_doubtful(name: str, has_iso: bool) -> bool:
    """Return whether a name looks like that of a gain, except of a part of the ISO, of a total, or of a colour."""
    joined = _joined(name)
    explained = _OF_A_COLOUR.search(joined) or _GAIN.fullmatch(joined) or (has_iso and _OF_ISO.search(joined))
    return _LIKE_A_GAIN.search(joined) is not None and not explained


def unit_named(name: str) -> ExposureUnit | None:
    """Return the unit in the name of a column or field, such as ``exposure_us``; None if it has none."""
    word, unit = _word_and_unit(name)
    return ExposureUnit.US100 if word in _V4L2_WORDS and not unit else _UNITS.get(unit)


def is_gain(name: str) -> bool:
    """Return whether a column or topic with this name certainly has gains."""
    return _GAIN.fullmatch(_joined(name)) is not None or _is_iso(name)


def looks_like_gain(name: str) -> bool:
    """Return whether a column or topic with this name has gains certainly or probably."""
    return is_gain(name) or _is_doubtful(name, has_iso=False)


def gain_unit_named(name: str) -> GainUnit | None:
    """Return the unit in the name of a gain, such as ``gain_db``.

    It is linear if the name states none, and None if it is the camera's own, as in ``gain_percent``.
    """
    if _is_iso(name):
        return GainUnit.ISO
    match = _GAIN.fullmatch(_joined(name))
    if match is None:
        return GainUnit.DB if _word_and_unit(name)[1] == "db" else GainUnit.LINEAR
    return None if match["own"] else _GAIN_UNITS.get(match["unit"], GainUnit.LINEAR)


def states_gain_unit(name: str) -> bool:
    """Return whether the name of a gain states its unit; otherwise the gain is taken as linear."""
    match = _GAIN.fullmatch(_joined(name))
    return match is None or match["unit"] is not None


def gain_unit_note(name: str, unit: GainUnit, *, stated: bool) -> str:
    """Return the unit of a gain for notes, and that it is assumed if neither its name nor the user states it."""
    return f" ({unit.label}{'' if stated or states_gain_unit(name) else _ASSUMED_LINEAR})"


def _is_iso(name: str) -> bool:
    return any(_among([name], words) for words in _ISO_WORDS)


def _joined(name: str) -> str:
    return "".join(_word_and_unit(name))


def _word_and_unit(name: str) -> tuple[str, str]:
    """Split ``Exposure Time [us]``, ``exposure_time_us`` or ``exposure(us)`` into word and unit."""
    plain = re.sub(r"log2[\s_(\[]*s(?=\W|$)", "log2s", name.strip().lower())
    words = [word for word in re.split(r"[\s_\-\[\](){}#:./]+", plain) if word]
    for unit in (words[-1], words[-1].rstrip("s")) if len(words) > 1 else ():
        if unit in (*_UNITS, "db"):
            return "".join(words[:-1]), unit
    return "".join(words), ""


def _among(header: Sequence[str], words: Sequence[str]) -> list[int]:
    """Return the columns whose name, without its unit, is one of these words or its plural."""
    found = [_word_and_unit(name)[0] for name in header]
    return [i for i, word in enumerate(found) if word in words or word.removesuffix("s") in words]


def _only(header: Sequence[str], groups: Sequence[Sequence[str]], place: str) -> int | None:
    """Return the only column with a meaning; None if there is none, ExposureError if there are several."""
    found = next((columns for words in groups if (columns := _among(header, words))), [])
    if len(found) > 1:
        names = listed([quoted(header[i]) for i in found])
        good = "exposure_ms" if groups is _EXPOSURE_WORDS else groups[0][0]
        raise ExposureError(
            f"{place}: the columns {names} have the same meaning; keep one of them and name it '{good}'"
        )
    return found[0] if found else None


def columns_of(text: str, source: str) -> tuple[Columns, Rows]:
    """Return the meaning of the columns and the rows of a list; errors as :func:`name_columns`."""
    lines = lines_of(text, source)
    start = next((i for i, (_, line) in enumerate(lines) if not line.startswith("#")), None)
    if start is None:
        raise RecordingError(f"{source}: has no frames; it needs one line per image")
    separator = next((s for s in (";", ",", "\t") if s in lines[start][1]), None)
    rows = [(n, _fields(line, separator, f"{source}, line {n}")) for n, line in lines[start:] if line[0] != "#"]
    if separator in (";", "\t"):  # between commas, a decimal comma would be a separator
        rows = [(n, [_DECIMAL_COMMA.sub(r"\1.\2", field) for field in fields]) for n, fields in rows]
    if not any(is_number(field) or is_fraction(field) for field in rows[0][1]):
        return name_columns(rows[0][1], f"{source}, line {rows[0][0]}"), rows[1:]
    if start > 0:
        number, comment = lines[start - 1]
        heading = _fields(comment.lstrip("# "), separator, f"{source}, line {number}")
        if len(heading) == len(rows[0][1]):
            columns = name_columns(heading, f"{source}, line {number}")
            if columns.exposure is not None:
                return columns, rows
    return _unnamed(rows[0][1]), rows


def _unnamed(fields: list[str]) -> Columns:
    """Infer the columns of a file without a header from their number and the first row."""
    count = len(fields)
    unnamed = Columns(count, named=False)
    if count == 3:
        return replace(unnamed, image=0, stamp=1, exposure=2, notes=("columns are read as id, stamp[s], exposure",))
    if count == 2 and not is_number(fields[0]):
        return replace(unnamed, image=0, exposure=1, notes=("columns are read as file, exposure",))
    if count == 1:
        return replace(unnamed, exposure=0, notes=("its numbers are read as exposures",))
    return unnamed


def _fields(line: str, separator: str | None, place: str) -> list[str]:
    """Split a line; units such as ``[ms]`` stay with their name."""
    if separator is None:
        return re.sub(r"\s+(?=[\[(]\w{1,3}[\])])", "", line).split()
    try:
        return [field.strip() for field in next(csv.reader([line], delimiter=separator, strict=True))]
    except csv.Error as error:
        raise RecordingError(f"{place}: has invalid quotes ({error}); correct the line") from None
