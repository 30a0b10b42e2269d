"""Units of exposures, gains and time stamps, stated or inferred from the numbers.

V4L2 counts ``exposure_time_absolute`` in units of 100 µs; DirectShow uses log2 of seconds; GenICam, libcamera and
RealSense use microseconds. Gains in decibels are amplitudes, so 20 dB is a factor of ten; ISO 100 is a gain of one.
"""

from __future__ import annotations

from enum import Enum

import numpy as np
import numpy.typing as npt

from ospc.arrays import FloatArray
from ospc.errors import ExposureError

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


def known_gain_unit(unit: GainUnit | None, gains: FloatArray, gain: str) -> GainUnit:
    """Return the stated unit. Without one, gains must be constant; the result is then ``GainUnit.NONE``.

    Raises
    ------
    ExposureError
        If gains in an unknown unit change. The message begins with ``gain``.
    """
    if unit is not None:
        return unit
    known = gains[np.isfinite(gains)]
    if known.size and (low := known.min()) < (high := known.max()):
        raise ExposureError(
            f"{gain} changes from {low:g} to {high:g} in the camera's own unit; give it with --gain-unit "
            f"(linear, db, iso, or none to ignore it)"
        )
    return GainUnit.NONE


SHORTEST_MS, _LONGEST_MS = 0.02, 1000.0
"""Plausible median exposures of a recording; the upper limit is used if the frame rate is unknown."""

_SHORTEST_LOG2_S, _LONGEST_LOG2_S = -20.0, 1.0
"""Plausible exposures in log2 s: from a microsecond to two seconds."""

_INTERVAL_MARGIN = 1.1
"""Factor by which exposures may exceed the frame interval because of jitter in the time stamps."""


def interval_ms(stamps_s: FloatArray) -> float:
    """Return the median time between frames; infinite if it is unknown."""
    steps = np.diff(stamps_s)
    middle_ms = 1e3 * float(np.median(steps)) if len(steps) and np.all(np.isfinite(steps)) else 0.0
    return middle_ms if middle_ms > 0 else np.inf


def infer_unit(exposures: npt.ArrayLike, stamps_s: FloatArray, source: str) -> ExposureUnit:
    """Infer the unit in which exposures are plausible: no longer than the frame interval, and not too short.

    Exposure ratios, and therefore response and vignette, are the same in all units except log2 s, which is recognised
    by negative values. ``stamps_s`` are the time stamps of the frames; with fewer than two, the interval is unknown.

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
    between_ms = interval_ms(stamps_s)
    longest = _INTERVAL_MARGIN * between_ms if np.isfinite(between_ms) else _LONGEST_MS
    for unit, factor in _IN_MS.items():
        if SHORTEST_MS <= middle * factor <= longest:
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
