"""Meaning and unit of the columns in a list of exposures, from its header."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ospc.errors import ExposureError, listed, quoted
from ospc.recording.exposure_units import ExposureUnit, GainUnit

_IN_SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9}
_UNITS = {
    "s": ExposureUnit.S,
    "sec": ExposureUnit.S,
    "ms": ExposureUnit.MS,
    "us": ExposureUnit.US,
    "µs": ExposureUnit.US,
    "μs": ExposureUnit.US,
    "ns": ExposureUnit.NS,
    "100us": ExposureUnit.US100,
    "100µs": ExposureUnit.US100,
    "log2s": ExposureUnit.LOG2_S,
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
    """A column of gains.

    Attributes
    ----------
    column
        Index of the column.
    name
        Its header.
    scale
        ``linear``, ``db`` (amplitude: 20 dB are a factor of ten) or ``iso`` (100 is a gain of one).
    """

    column: int
    name: str
    scale: Literal["linear", "db", "iso"]

    def linear(self, value: float, unit: GainUnit | None = None) -> float:
        """Return the factor for the exposure; a stated unit overrides that of the header."""
        return float((unit or GainUnit(self.scale)).linear(np.array(value, dtype=np.float64)))


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

    Parameters
    ----------
    header
        Names of the columns.
    place
        File and line, for messages.

    Raises
    ------
    ExposureError
        If several columns could hold the exposures, their time stamps, or the names of the images.
    """
    parsed = [_word_and_unit(name) for name in header]
    exposure = _only(header, parsed, _EXPOSURE_WORDS, place)
    if exposure is None:
        return Columns(len(header))
    stamp = _only(header, parsed, _STAMP_WORDS, place)
    image = _only(header, parsed, _IMAGE_WORDS, place)
    gains = tuple(Gain(i, header[i], _scale(*parsed[i])) for i in _among(parsed, _GAIN_WORDS))
    notes = []
    unit = _UNITS.get(parsed[exposure][1])
    to_s = 1.0 if stamp is None else _IN_SECONDS.get(parsed[stamp][1], 1.0)
    if gains:
        said = ", ".join(f"{quoted(gain.name)} ({gain.scale})" for gain in gains)
        notes.append(f"exposures are multiplied by the gain in {said}")
    return Columns(len(header), image, stamp, exposure, gains, unit, to_s, tuple(notes))


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


def _scale(word: str, unit: str) -> Literal["linear", "db", "iso"]:
    if word == "iso":
        return "iso"
    return "db" if unit == "db" else "linear"
