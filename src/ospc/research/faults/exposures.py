"""Faults of the exposures in the metadata; the images stay as they are."""

from __future__ import annotations

import numpy as np

from ospc.arrays import FloatArray
from ospc.research.faults.footage import Fault, Footage, blocks, half, some

_HIDDEN_GAIN_FRAMES = 10
"""Frames for which a hidden gain stays as it is."""


def _offset(footage: Footage, offset_ms: float, _random: np.random.Generator) -> Footage:
    return footage.with_exposures(footage.exposures_ms + offset_ms)


def _too_small(footage: Footage, share: float, _random: np.random.Generator) -> Footage:
    return footage.with_exposures(footage.exposures_ms - share * footage.exposures_ms.min())


def _logarithm(footage: Footage, constant: float, _random: np.random.Generator) -> Footage:
    return footage.with_exposures(np.log2(footage.exposures_ms) + constant)


def _power(footage: Footage, exponent: float, _random: np.random.Generator) -> Footage:
    return footage.with_exposures(footage.exposures_ms**exponent)


def _reciprocal(footage: Footage, exponent: float, _random: np.random.Generator) -> Footage:
    return footage.with_exposures(1000.0 * footage.exposures_ms**-exponent)


def _ceiling(footage: Footage, quantile: float, _random: np.random.Generator) -> Footage:
    return footage.with_exposures(np.minimum(footage.exposures_ms, np.quantile(footage.exposures_ms, quantile)))


def _floor(footage: Footage, quantile: float, _random: np.random.Generator) -> Footage:
    return footage.with_exposures(np.maximum(footage.exposures_ms, np.quantile(footage.exposures_ms, quantile)))


def _dual_gain(footage: Footage, gain: float, _random: np.random.Generator) -> Footage:
    long = footage.exposures_ms > np.median(footage.exposures_ms)
    return footage.with_exposures(np.where(long, footage.exposures_ms / gain, footage.exposures_ms))


def _gain_when_dark(footage: Footage, gain: float, _random: np.random.Generator) -> Footage:
    dark = footage.exposures_ms > np.quantile(footage.exposures_ms, 0.8)
    return footage.with_exposures(np.where(dark, footage.exposures_ms / gain, footage.exposures_ms))


def _hidden_gain(footage: Footage, share: float, random: np.random.Generator) -> Footage:
    gain = 1 + share * blocks(len(footage.exposures_ms), _HIDDEN_GAIN_FRAMES, random)
    return footage.with_exposures(footage.exposures_ms / gain)


def _drift(footage: Footage, factor: float, _random: np.random.Generator) -> Footage:
    return footage.with_exposures(footage.exposures_ms * np.geomspace(1, factor, len(footage)))


def _stale(footage: Footage, frames: float, _random: np.random.Generator) -> Footage:
    step = int(frames)
    return footage.with_exposures(footage.exposures_ms[np.arange(len(footage)) // step * step])


def _moved(exposures_ms: FloatArray, lag: FloatArray | float) -> FloatArray:
    """Return what is written beside every frame if it belongs to a frame earlier by a lag."""
    place = np.arange(len(exposures_ms)) - lag
    return np.asarray(np.exp(np.interp(place, np.arange(len(exposures_ms)), np.log(exposures_ms))))


def _late(footage: Footage, frames: float, _random: np.random.Generator) -> Footage:
    return footage.with_exposures(_moved(footage.exposures_ms, frames))


def _early(footage: Footage, frames: float, _random: np.random.Generator) -> Footage:
    return footage.with_exposures(_moved(footage.exposures_ms, -frames))


def _changing_lag(footage: Footage, share: float, random: np.random.Generator) -> Footage:
    return footage.with_exposures(_moved(footage.exposures_ms, np.where(some(len(footage), share, random), 2.0, 1.0)))


def _lag_midway(footage: Footage, frames: float, _random: np.random.Generator) -> Footage:
    lag = np.where(np.arange(len(footage)) >= half(footage), float(frames), 0.0)
    return footage.with_exposures(_moved(footage.exposures_ms, lag))


def _smoothed(footage: Footage, frames: float, _random: np.random.Generator) -> Footage:
    side = int(frames) // 2
    padded = np.pad(footage.exposures_ms, side, mode="edge")
    return footage.with_exposures(np.convolve(padded, np.full(2 * side + 1, 1 / (2 * side + 1)), mode="valid"))


def _stops(footage: Footage, stops: float, _random: np.random.Generator) -> Footage:
    return footage.with_exposures(2.0 ** (np.rint(np.log2(footage.exposures_ms) / stops) * stops))


def _rounded(footage: Footage, step_ms: float, _random: np.random.Generator) -> Footage:
    return footage.with_exposures(np.maximum(np.rint(footage.exposures_ms / step_ms), 1) * step_ms)


def _jitter(footage: Footage, sigma: float, random: np.random.Generator) -> Footage:
    return footage.with_exposures(footage.exposures_ms * np.exp(sigma * random.standard_normal(len(footage))))


def _replaced(footage: Footage, share: float, random: np.random.Generator, values: FloatArray | float) -> Footage:
    wrong = some(len(footage), share, random)
    return footage.with_exposures(np.where(wrong, values, footage.exposures_ms))


def _tenfold(footage: Footage, share: float, random: np.random.Generator) -> Footage:
    return _replaced(footage, share, random, 10 * footage.exposures_ms)


def _not_a_number(footage: Footage, share: float, random: np.random.Generator) -> Footage:
    return _replaced(footage, share, random, np.nan)


def _zero(footage: Footage, share: float, random: np.random.Generator) -> Footage:
    return _replaced(footage, share, random, 0.0)


def _negative(footage: Footage, share: float, random: np.random.Generator) -> Footage:
    return _replaced(footage, share, random, -footage.exposures_ms)


def _mixed_units(footage: Footage, share: float, random: np.random.Generator) -> Footage:
    return _replaced(footage, share, random, 1000 * footage.exposures_ms)


def _lost_digit(footage: Footage, share: float, random: np.random.Generator) -> Footage:
    leading = 10.0 ** np.floor(np.log10(footage.exposures_ms))
    return _replaced(footage, share, random, np.maximum(footage.exposures_ms % leading, leading / 100))


def _another_unit(footage: Footage, factor: float, _random: np.random.Generator) -> Footage:
    return footage.with_exposures(factor * footage.exposures_ms)


def _constant(footage: Footage, share: float, _random: np.random.Generator) -> Footage:
    frozen = np.arange(len(footage)) < share * len(footage)
    return footage.with_exposures(np.where(frozen, np.median(footage.exposures_ms), footage.exposures_ms))


def _swapped(footage: Footage, share: float, random: np.random.Generator) -> Footage:
    swapped = footage.exposures_ms.copy()
    for i in np.flatnonzero(some(len(footage), share, random)):
        swapped[[i - 1, i]] = swapped[[i, i - 1]]
    return footage.with_exposures(swapped)


def _shuffled(footage: Footage, share: float, random: np.random.Generator) -> Footage:
    places = np.flatnonzero(some(len(footage), share, random))
    shuffled = footage.exposures_ms.copy()
    order = random.permutation(places)
    shuffled[order] = footage.exposures_ms[np.roll(order, 1)]
    return footage.with_exposures(shuffled)


FAULTS = (
    Fault("offset", "{} ms added to every exposure", (0.5, 1, 2), _offset),
    Fault("offset-down", "{} of the shortest exposure taken off every one", (0.2, 0.5, 0.8), _too_small),
    Fault("logarithm", "log2 of the exposure plus {}", (8, 5, 2), _logarithm),
    Fault("power", "exposures to the power of {}", (0.95, 0.9, 0.8), _power),
    Fault("power-up", "exposures to the power of {}", (1.05, 1.1, 1.25), _power),
    Fault("reciprocal", "1000 over the exposure to the power of {}", (0.2, 1, 2), _reciprocal),
    Fault("ceiling", "exposures above their quantile {} are a hidden gain", (0.95, 0.85, 0.5), _ceiling),
    Fault("floor", "exposures below their quantile {} are an iris", (0.05, 0.15, 0.5), _floor),
    Fault("dual-gain", "a hidden gain of {} above the middle exposure", (1.05, 1.2, 2), _dual_gain),
    Fault(
        "gain-when-dark", "a hidden gain of {} in the fifth of the longest exposures", (1.1, 1.5, 4), _gain_when_dark
    ),
    Fault("hidden-gain", "a hidden gain of ±{} that switches every 10 frames", (0.02, 0.05, 0.1), _hidden_gain),
    Fault("drift", "exposures that drift from the truth to a factor of {}", (1.05, 1.2, 1.5), _drift),
    Fault("stale", "exposures written anew only every {} frames", (3, 10, 30), _stale),
    Fault("late", "exposures {} frames late", (1, 2, 3), _late),
    Fault("early", "exposures {} frames early", (1, 2, 3), _early),
    Fault("late-by-a-part", "exposures {} of a frame late", (0.25, 0.5, 0.75), _late),
    Fault("changing-lag", "exposures 1 frame late, a share of {} 2 frames", (0.1, 0.3, 0.5), _changing_lag),
    Fault("lag-midway", "exposures {} frames late from half-way on", (1, 2, 3), _lag_midway),
    Fault("smoothed", "a mean over {} frames instead of each exposure", (3, 5, 9), _smoothed),
    Fault("stops", "exposures rounded to {} stops", (0.25, 0.5, 1), _stops),
    Fault("rounded", "exposures rounded to {} ms", (0.5, 1, 5), _rounded),
    Fault("jitter", "exposures that scatter by {}", (0.01, 0.03, 0.1), _jitter),
    Fault("tenfold", "ten times the exposure in a share of {} of lines", (0.002, 0.01, 0.05), _tenfold),
    Fault("not-a-number", "no number in a share of {} of lines", (0.01, 0.05, 0.2), _not_a_number),
    Fault("zero", "0 in a share of {} of lines", (0.01, 0.05, 0.2), _zero),
    Fault("negative", "a minus in a share of {} of lines", (0.01, 0.05, 0.2), _negative),
    Fault("mixed-units", "microseconds in a share of {} of lines", (0.01, 0.1, 0.5), _mixed_units),
    Fault("lost-digit", "the first digit lost in a share of {} of lines", (0.01, 0.05, 0.2), _lost_digit),
    Fault("another-unit", "{} times all exposures", (0.001, 1000, 1e6), _another_unit),
    Fault("constant-written", "one exposure written for the first {} of frames", (0.2, 0.5, 1), _constant),
    Fault("swapped", "exposures of neighbours swapped at a share of {} of frames", (0.05, 0.2, 0.5), _swapped),
    Fault("shuffled", "exposures shuffled among a share of {} of frames", (0.05, 0.2, 1), _shuffled),
)
