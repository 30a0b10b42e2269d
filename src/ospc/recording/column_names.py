"""Meaning and unit of the columns in a list of exposures, from its header."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from ospc.errors import ExposureError, listed, quoted
from ospc.recording.exposure_units import ExposureUnit, GainUnit

_STAMP_UNITS_S = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9}
"""Units of time stamps, in seconds."""

_UNITS = {unit.value: unit for unit in ExposureUnit} | {
    "sec": ExposureUnit.S,
    "µs": ExposureUnit.US,
    "μs": ExposureUnit.US,
    "100µs": ExposureUnit.US100,
}
_LONG_UNITS = {
    "second": "s",
    "millisecond": "ms",
    "msec": "ms",
    "microsecond": "us",
    "usec": "us",
    "nanosecond": "ns",
}

# Words for each meaning, in order of preference: columns of an earlier group hide those of later groups.
_EXPOSURE_WORDS = (("exposure", "exposuretime"), ("shutter", "shuttertime", "exptime", "integrationtime"))
_STAMP_WORDS = (("timestamp", "stamp"), ("time",))
_IMAGE_WORDS = (("file", "filename"), ("image", "imagename", "imagefile", "path", "name"), ("id", "frameid"))
_GAIN_WORDS = ("gain", "analoggain", "analoguegain", "digitalgain", "iso")


@dataclass(frozen=True)
class Gain:
    """Index, header and unit of a column of gains."""

    column: int
    name: str
    unit: GainUnit


@dataclass(frozen=True)
class Columns:
    """Meaning of the columns.

    Attributes
    ----------
    count
        Number of columns.
    image, stamp, exposure
        Index of the column, None if there is none.
    gains
        Columns of gains by which the exposure is multiplied.
    unit
        Unit of the exposure; None if the header does not state it.
    to_s
        Seconds per unit of the time stamp.
    notes
        What was assumed.
    """

    count: int
    image: int | None = None
    stamp: int | None = None
    exposure: int | None = None
    gains: tuple[Gain, ...] = ()
    unit: ExposureUnit | None = None
    to_s: float = 1.0
    notes: tuple[str, ...] = ()


def name_columns(header: Sequence[str], place: str) -> Columns:
    """Infer the meaning of columns from their names.

    Raises
    ------
    ExposureError
        If several columns could hold the exposures, their time stamps, or the names of the images; the message begins
        with ``place``.
    """
    parsed = [_word_and_unit(name) for name in header]
    exposure = _only(header, parsed, _EXPOSURE_WORDS, place)
    if exposure is None:
        return Columns(len(header))
    stamp = _only(header, parsed, _STAMP_WORDS, place)
    image = _only(header, parsed, _IMAGE_WORDS, place)
    gains = tuple(Gain(i, header[i], _gain_unit(*parsed[i])) for i in _among(parsed, _GAIN_WORDS))
    to_s = 1.0 if stamp is None else _STAMP_UNITS_S.get(parsed[stamp][1], 1.0)
    said = ", ".join(f"{quoted(gain.name)} ({gain.unit.value})" for gain in gains)
    notes = (f"exposures are multiplied by the gain in {said}",) if gains else ()
    return Columns(len(header), image, stamp, exposure, gains, _UNITS.get(parsed[exposure][1]), to_s, notes)


def _word_and_unit(name: str) -> tuple[str, str]:
    """Split ``Exposure Time [us]``, ``exposure_time_us`` or ``exposure(us)`` into word and unit."""
    plain = re.sub(r"log2[\s_(\[]*s(?=\W|$)", "log2s", name.strip().lower())
    words = [word for word in re.split(r"[\s_\-\[\](){}#:./]+", plain) if word]
    last = words[-1].rstrip("s") if words else ""
    unit = words[-1] if words and words[-1] in (*_UNITS, "db") else _LONG_UNITS.get(last, "")
    if unit and len(words) > 1:
        return "".join(words[:-1]), _LONG_UNITS.get(last, unit)
    return "".join(words), ""


def _among(parsed: Sequence[tuple[str, str]], words: Sequence[str]) -> list[int]:
    return [i for i, (word, _) in enumerate(parsed) if word in words or word.removesuffix("s") in words]


def _only(
    header: Sequence[str], parsed: Sequence[tuple[str, str]], groups: Sequence[Sequence[str]], place: str
) -> int | None:
    """Return the only column with a meaning, None if there is none."""
    found = next((columns for words in groups if (columns := _among(parsed, words))), [])
    if len(found) > 1:
        names = listed([quoted(header[i]) for i in found])
        good = "exposure_ms" if groups is _EXPOSURE_WORDS else groups[0][0]
        raise ExposureError(
            f"{place}: the columns {names} have the same meaning; keep one of them and name it '{good}'"
        )
    return found[0] if found else None


def _gain_unit(word: str, unit: str) -> GainUnit:
    if word == "iso":
        return GainUnit.ISO
    return GainUnit.DB if unit == "db" else GainUnit.LINEAR
