"""Units of exposures and gains, and how to infer a unit from the numbers alone.

Sources: V4L2 counts ``exposure_time_absolute`` in 100 µs, DirectShow uses log2 of seconds, GenICam, libcamera and
RealSense microseconds. A gain in decibels is an amplitude, 20 dB are a factor of ten; ISO 100 is a gain of one.
"""

from __future__ import annotations

from enum import Enum

import numpy as np
import numpy.typing as npt

from ospc.arrays import FloatArray
from ospc.errors import ExposureError

EXPOSURE_RANGE_MS = (1e-9, 1e9)
"""From a picosecond to eleven days; a number outside is not an exposure."""

REALSENSE_UNIT_GAIN = 16
"""``gain_level`` of RealSense's stereo cameras at a gain of one; in other models the unit is linear too."""


class ExposureUnit(Enum):
    """A unit of exposures."""

    S = "s"
    MS = "ms"
    US = "us"
    NS = "ns"
    US100 = "100us"
    LOG2_S = "log2s"

    def to_ms(self, exposures: npt.ArrayLike) -> FloatArray:
        """Convert exposures in this unit to milliseconds; infinite if the result exceeds all floats."""
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
"""Linear units, in order of preference if several are plausible."""


class GainUnit(Enum):
    """A unit of gains."""

    LINEAR = "linear"
    DB = "db"
    ISO = "iso"
    NONE = "none"

    def linear(self, gains: npt.ArrayLike) -> FloatArray:
        """Return the factors by which exposures are multiplied; ones for ``none``, which ignores gains."""
        values = np.asarray(gains, dtype=np.float64)
        if self is GainUnit.NONE:
            return np.ones_like(values)
        if self is GainUnit.DB:
            with np.errstate(over="ignore"):
                return np.asarray(10 ** (values / 20))
        return values / 100 if self is GainUnit.ISO else values


_SHORTEST_MS, _LONGEST_MS = 0.02, 1000.0
"""Plausible median exposures of a recording; the longest applies if the frame rate is unknown."""

_SHORTEST_LOG2_S, _LONGEST_LOG2_S = -20.0, 1.0
"""Plausible exposures in log2 s: from a microsecond to two seconds."""

_INTERVAL_MARGIN = 1.1
"""An exposure may exceed the frame interval by this factor, as time stamps jitter."""


def infer_unit(exposures: npt.ArrayLike, interval_ms: float | None, source: str) -> ExposureUnit:
    """Infer the unit in which exposures are plausible: no longer than the frame interval, and not too short.

    Ratios of exposures, and so response and vignette, are the same in all units but log2 s, which is recognised by
    its negative values.

    Parameters
    ----------
    exposures
        The numbers.
    interval_ms
        Median time between frames; None if it is unknown.
    source
        Name of the exposures in messages.

    Raises
    ------
    ExposureError
        If they are plausible in no unit.
    """
    numbers = np.asarray(exposures, dtype=np.float64)
    finite = numbers[np.isfinite(numbers)]
    if np.any(finite < 0):
        if np.all((finite >= _SHORTEST_LOG2_S) & (finite <= _LONGEST_LOG2_S)):
            return ExposureUnit.LOG2_S
        raise ExposureError(
            f"{source}: an exposure of {finite.min():g} is possible in no unit; state the unit or correct the value"
        )
    positive = finite[finite > 0]
    if not positive.size:
        raise ExposureError(f"{source}: holds no positive exposure; check whether it is the right field")
    middle = float(np.median(positive))
    longest = _INTERVAL_MARGIN * interval_ms if interval_ms is not None else _LONGEST_MS
    for unit, factor in _IN_MS.items():
        if _SHORTEST_MS <= middle * factor <= longest:
            return unit
    raise ExposureError(
        f"{source}: exposures around {middle:g} fit no unit at the given frame rate; state the unit of exposures "
        f"(s, ms, us, 100us, log2s)"
    )
