"""Units of exposures, gains and time stamps, read from the header of a list or inferred from the numbers.

V4L2 counts ``exposure_time_absolute`` in units of 100 µs; DirectShow uses log2 of seconds; GenICam, libcamera and
RealSense use microseconds. Gains in decibels are amplitudes, so 20 dB is a factor of ten; ISO 100 is a gain of one.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from ospc.arrays import FloatArray
from ospc.errors import ExposureError, listed, quoted

REALSENSE_UNIT_GAIN = 16
"""``gain_level`` of RealSense stereo cameras at a gain of one; the unit is also linear for other models."""


class ExposureUnit(Enum):
    """A unit of exposures."""

    S = "s"
    MS = "ms"
    US = "us"
    NS = "ns"
    US100 = "100us"
    LOG2_S = "log2s"

    def to_ms(self, exposures: npt.ArrayLike) -> FloatArray:
        """Convert exposures in this unit to milliseconds; infinite in case of overflow."""
        values = np.asarray(exposures, dtype=np.float64)
        with np.errstate(over="ignore"):
            return np.asarray(np.exp2(values) * 1e3 if self is ExposureUnit.LOG2_S else values * _IN_MS[self])


_IN_MS = {
    ExposureUnit.MS: 1.0,
    ExposureUnit.US: 1e-3,
    ExposureUnit.S: 1e3,
    ExposureUnit.US100: 0.1,
    ExposureUnit.NS: 1e-6,
}
"""Linear units in milliseconds, in order of preference if several are plausible."""


class GainUnit(Enum):
    """A unit of gains."""

    LINEAR = "linear"
    DB = "db"
    ISO = "iso"
    NONE = "none"

    @property
    def label(self) -> str:
        """Name of the unit in messages."""
        return {GainUnit.DB: "dB", GainUnit.ISO: "ISO"}.get(self, self.value)

    def linear(self, gains: npt.ArrayLike) -> FloatArray:
        """Return gains as linear factors; ones for ``none``, which ignores gains."""
        values = np.asarray(gains, dtype=np.float64)
        if self is GainUnit.NONE:
            return np.ones_like(values)
        if self is GainUnit.DB:
            with np.errstate(over="ignore"):
                return np.asarray(10 ** (values / 20))
        return values / 100 if self is GainUnit.ISO else values


_SHORTEST_MS, _LONGEST_MS = 0.02, 1000.0
"""Plausible median exposures of a recording; the upper limit is used if the frame rate is unknown."""

_SHORTEST_LOG2_S, _LONGEST_LOG2_S = -20.0, 1.0
"""Plausible exposures in log2 s: from a microsecond to two seconds."""

_INTERVAL_MARGIN = 1.1
"""Factor by which exposures may exceed the frame interval because of jitter in the time stamps."""


def infer_unit(exposures: npt.ArrayLike, interval_ms: float | None, source: str) -> ExposureUnit:
    """Infer the unit in which exposures are plausible: no longer than the frame interval, and not too short.

    Exposure ratios, and therefore response and vignette, are the same in all units except log2 s, which is recognised
    by negative values. ``interval_ms`` is the median time between frames, None if unknown.

    Raises
    ------
    ExposureError
        If the exposures are not plausible in any unit. The message begins with ``source``.
    """
    numbers = np.asarray(exposures, dtype=np.float64)
    finite = numbers[np.isfinite(numbers)]
    if np.any(finite < 0):
        if np.all((finite >= _SHORTEST_LOG2_S) & (finite <= _LONGEST_LOG2_S)):
            return ExposureUnit.LOG2_S
        raise ExposureError(
            f"{source}: an exposure of {finite.min():g} is not possible in any unit; give the unit or correct it"
        )
    positive = finite[finite > 0]
    if not positive.size:
        raise ExposureError(f"{source}: has no positive exposures; check that it is the right field")
    middle = float(np.median(positive))
    longest = _INTERVAL_MARGIN * interval_ms if interval_ms is not None else _LONGEST_MS
    for unit, factor in _IN_MS.items():
        if _SHORTEST_MS <= middle * factor <= longest:
            return unit
    raise ExposureError(
        f"{source}: exposures around {middle:g} are not plausible in any unit at this frame rate; give their unit "
        f"(s, ms, us, 100us, log2s)"
    )


_STAMP_UNITS = ((1e17, 1e-9, "nanoseconds"), (1e14, 1e-6, "microseconds"), (1e11, 1e-3, "milliseconds"))
"""Smallest value since 1970, scale and name of units of time stamps: 1e11 s would be the year 5138."""

_LONGEST_STEP_S = 1000.0
"""Median time between frames above which time stamps of a clock that begins at 0 are hardly in seconds."""

_PLAUSIBLE_STEPS_S = (0.0025, 2.0)
"""Median time between frames, from 400 to 0.5 per second, that confirms a finer unit; only one unit can fit."""


def in_seconds(stamps: FloatArray, source: str, *, stated: bool = False) -> tuple[FloatArray, list[str]]:
    """Return time stamps in seconds, converted if they are too large for seconds, and a note about their unit.

    If seconds are ``stated``, only stamps since 1970 are converted, and not those of a clock that begins at 0, whose
    unit is inferred from the time between frames.
    """
    said = f"{source}: time stamps are assumed to be in"
    for least, scale, unit in _STAMP_UNITS:
        if stamps.size and stamps[0] >= least:
            return stamps * scale, [f"{said} {unit}, inferred from their size"]
    step = 0.0 if stated or len(stamps) < 2 else float(np.median(np.diff(stamps)))
    for _, scale, unit in _STAMP_UNITS if step > _LONGEST_STEP_S else ():
        if _PLAUSIBLE_STEPS_S[0] <= step * scale <= _PLAUSIBLE_STEPS_S[1]:
            rate = f"{1 / (step * scale):.4g} per second"
            return stamps * scale, [f"{said} {unit}, inferred from the frame rate, {rate}"]
    return stamps, []


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
)
_STAMP_WORDS = (("timestamp", "stamp"), ("time",))
_IMAGE_WORDS = (
    ("file", "filename"),
    ("image", "imagename", "imagefile", "path", "name"),
    ("id", "frameid", "imageid"),
    ("frame", "framenumber", "frameindex", "imagenumber", "imageindex"),
)
_GAIN_WORDS = ("gain", "analoggain", "analoguegain", "digitalgain", "iso")


@dataclass(frozen=True)
class Columns:
    """The number of columns, and the index of the column with each meaning, or None.

    ``gains`` has index, header and unit of the columns by which the exposure is multiplied. ``unit`` is the unit of
    the exposure and ``stamp_unit`` that of the time stamps, None if the header does not state it. ``notes`` state
    assumptions, and ``named`` whether there is a header.
    """

    count: int
    image: int | None = None
    stamp: int | None = None
    exposure: int | None = None
    gains: tuple[tuple[int, str, GainUnit], ...] = ()
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
    parsed = [_word_and_unit(name) for name in header]
    exposure = _only(header, parsed, _EXPOSURE_WORDS, place)
    if exposure is None:
        return Columns(len(header))
    stamp = _only(header, parsed, _STAMP_WORDS, place)
    image = _only(header, parsed, _IMAGE_WORDS, place)
    gains = tuple((i, header[i], gain_unit_named(header[i])) for i in _among(parsed, _GAIN_WORDS))
    stamp_unit = None if stamp is None else unit_named(header[stamp])
    return Columns(len(header), image, stamp, exposure, gains, unit_named(header[exposure]), stamp_unit)


def unit_named(name: str) -> ExposureUnit | None:
    """Return the unit in the name of a column or field, such as ``exposure_us``; None if it has none."""
    word, unit = _word_and_unit(name)
    return ExposureUnit.US100 if word in _V4L2_WORDS and not unit else _UNITS.get(unit)


def gain_unit_named(name: str) -> GainUnit:
    """Return the unit in the name of a gain, such as ``gain_db``; linear if it has none."""
    word, unit = _word_and_unit(name)
    return GainUnit.ISO if word == "iso" else GainUnit.DB if unit == "db" else GainUnit.LINEAR


def _word_and_unit(name: str) -> tuple[str, str]:
    """Split ``Exposure Time [us]``, ``exposure_time_us`` or ``exposure(us)`` into word and unit."""
    plain = re.sub(r"log2[\s_(\[]*s(?=\W|$)", "log2s", name.strip().lower())
    words = [word for word in re.split(r"[\s_\-\[\](){}#:./]+", plain) if word]
    for unit in (words[-1], words[-1].rstrip("s")) if len(words) > 1 else ():
        if unit in (*_UNITS, "db"):
            return "".join(words[:-1]), unit
    return "".join(words), ""


def _among(parsed: Sequence[tuple[str, str]], words: Sequence[str]) -> list[int]:
    return [i for i, (word, _) in enumerate(parsed) if word in words or word.removesuffix("s") in words]


def _only(
    header: Sequence[str], parsed: Sequence[tuple[str, str]], groups: Sequence[Sequence[str]], place: str
) -> int | None:
    """Return the only column with a meaning; None if there is none, ExposureError if there are several."""
    found = next((columns for words in groups if (columns := _among(parsed, words))), [])
    if len(found) > 1:
        names = listed([quoted(header[i]) for i in found])
        good = "exposure_ms" if groups is _EXPOSURE_WORDS else groups[0][0]
        raise ExposureError(
            f"{place}: the columns {names} have the same meaning; keep one of them and name it '{good}'"
        )
    return found[0] if found else None
