"""Faults of the exposures in the metadata; the images stay unchanged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from ospc.arrays import FloatArray
from ospc.research.faults.footage import Fault, Footage, blocks, some

_HIDDEN_GAIN_FRAMES = 10
"""Frames for which a hidden gain stays constant."""

_Stated: TypeAlias = Callable[[FloatArray, float, np.random.Generator], FloatArray]
"""The exposures that replace the true e, shape (frames,), at a strength x."""


def _stated(name: str, text: str, strengths: tuple[float, float, float], change: _Stated) -> Fault:
    def put(footage: Footage, strength: float, random: np.random.Generator) -> Footage:
        return footage.with_exposures(change(footage.exposures_ms, strength, random))

    return Fault(name, text, strengths, put)


def _in_lines(
    name: str, text: str, strengths: tuple[float, float, float], wrong: Callable[[FloatArray], FloatArray | float]
) -> Fault:
    """Return a fault that affects only a share of the lines."""

    def change(e: FloatArray, share: float, random: np.random.Generator) -> FloatArray:
        return np.where(some(e.size, share, random), wrong(e), e)

    return _stated(name, text, strengths, change)


def _moved(e: FloatArray, lag: FloatArray | float) -> FloatArray:
    """Return the exposures recorded with every frame if they lag by this many frames."""
    return np.asarray(np.exp(np.interp(np.arange(e.size) - lag, np.arange(e.size), np.log(e))))


def _smoothed(e: FloatArray, frames: float, _random: np.random.Generator) -> FloatArray:
    side = int(frames) // 2
    return np.convolve(np.pad(e, side, mode="edge"), np.full(2 * side + 1, 1 / (2 * side + 1)), mode="valid")


def _lost_digit(e: FloatArray) -> FloatArray:
    leading = 10.0 ** np.floor(np.log10(e))
    return np.maximum(e % leading, leading / 100)


def _swapped(e: FloatArray, share: float, random: np.random.Generator) -> FloatArray:
    swapped = e.copy()
    for i in np.flatnonzero(some(e.size, share, random)):
        swapped[[i - 1, i]] = swapped[[i, i - 1]]
    return swapped


def _shuffled(e: FloatArray, share: float, random: np.random.Generator) -> FloatArray:
    order = random.permutation(np.flatnonzero(some(e.size, share, random)))
    shuffled = e.copy()
    shuffled[order] = e[np.roll(order, 1)]
    return shuffled


def _power(footage: Footage, power: float, _random: np.random.Generator) -> Footage:
    return replace(footage.with_exposures(footage.exposures_ms**power), power=power)


FAULTS = (
    _stated("offset", "{} ms added to every exposure", (0.5, 1, 2), lambda e, x, _: e + x),
    _stated("offset-down", "{} of the shortest exposure subtracted from all", (0.2, 0.5, 0.8),
        lambda e, x, _: e - x * e.min()),
    _stated("logarithm", "log2 of the exposure plus {}", (8, 5, 2), lambda e, x, _: np.log2(e) + x),
    Fault("power", "exposures to the power of {}", (0.95, 0.9, 0.8), _power),
    Fault("power-up", "exposures to the power of {}", (1.05, 1.1, 1.25), _power),
    _stated("reciprocal", "1000 over the exposure to the power of {}", (0.2, 1, 2), lambda e, x, _: 1000.0 * e**-x),
    _stated("ceiling", "a hidden gain instead of exposures above the {} quantile", (0.95, 0.85, 0.5),
        lambda e, x, _: np.minimum(e, np.quantile(e, x))),
    _stated("floor", "an iris instead of exposures below the {} quantile", (0.05, 0.15, 0.5),
        lambda e, x, _: np.maximum(e, np.quantile(e, x))),
    _stated("dual-gain", "a hidden gain of {} above the median exposure", (1.05, 1.2, 2),
        lambda e, x, _: np.where(e > np.median(e), e / x, e)),
    _stated("gain-step", "a hidden gain of {} for the longest two fifths of the exposures", (1.005, 1.01, 1.02),
        lambda e, x, _: np.where(e > np.quantile(e, 0.6), e / x, e)),
    _stated("gain-when-dark", "a hidden gain of {} for the longest fifth of the exposures", (1.1, 1.5, 4),
        lambda e, x, _: np.where(e > np.quantile(e, 0.8), e / x, e)),
    _stated("hidden-gain", "a hidden gain of ±{} that switches every 10 frames", (0.02, 0.05, 0.1),
        lambda e, x, random: e / (1 + x * blocks(e.size, _HIDDEN_GAIN_FRAMES, random))),
    _stated("drift", "exposures that drift from the truth to a factor of {}", (1.05, 1.2, 1.5),
        lambda e, x, _: e * np.geomspace(1, x, e.size)),
    _stated("stale", "exposures updated only every {} frames", (3, 10, 30),
        lambda e, x, _: e[np.arange(e.size) // int(x) * int(x)]),
    _stated("late", "exposures {} frames late", (1, 2, 3), lambda e, x, _: _moved(e, x)),
    _stated("early", "exposures {} frames early", (1, 2, 3), lambda e, x, _: _moved(e, -x)),
    _stated("late-by-a-part", "exposures {} of a frame late", (0.25, 0.5, 0.75), lambda e, x, _: _moved(e, x)),
    _stated("changing-lag", "exposures 1 frame late, and 2 frames in a share of {}", (0.1, 0.3, 0.5),
        lambda e, x, random: _moved(e, np.where(some(e.size, x, random), 2.0, 1.0))),
    _stated("lag-midway", "exposures {} frames late in the second half", (1, 2, 3),
        lambda e, x, _: _moved(e, np.where(np.arange(e.size) >= e.size // 2, float(x), 0.0))),
    _stated("smoothed", "exposures averaged over {} frames", (3, 5, 9), _smoothed),
    _stated("stops", "exposures rounded to {} stops", (0.25, 0.5, 1),
        lambda e, x, _: 2.0 ** (np.rint(np.log2(e) / x) * x)),
    _stated("rounded", "exposures rounded to {} ms", (0.5, 1, 5), lambda e, x, _: np.maximum(np.rint(e / x), 1) * x),
    _stated("jitter", "exposures that scatter by {}", (0.01, 0.03, 0.1),
        lambda e, x, random: e * np.exp(x * random.standard_normal(e.size))),
    _in_lines("tenfold", "ten times the exposure in a share of {} of lines", (0.002, 0.01, 0.05), lambda e: 10 * e),
    _in_lines("not-a-number", "no number in a share of {} of lines", (0.01, 0.05, 0.2), lambda _: np.nan),
    _in_lines("zero", "0 in a share of {} of lines", (0.01, 0.05, 0.2), lambda _: 0.0),
    _in_lines("negative", "a minus sign in a share of {} of lines", (0.01, 0.05, 0.2), lambda e: -e),
    _in_lines("mixed-units", "microseconds in a share of {} of lines", (0.01, 0.1, 0.5), lambda e: 1000 * e),
    _in_lines("lost-digit", "the first digit lost in a share of {} of lines", (0.01, 0.05, 0.2), _lost_digit),
    _stated("another-unit", "{} times all exposures", (0.001, 1000, 1e6), lambda e, x, _: x * e),
    _stated("constant-written", "one exposure recorded for the first {} of frames", (0.2, 0.5, 1),
        lambda e, x, _: np.where(np.arange(e.size) < x * e.size, np.median(e), e)),
    _stated("swapped", "exposures of neighbours swapped at a share of {} of frames", (0.05, 0.2, 0.5), _swapped),
    _stated("shuffled", "exposures shuffled among a share of {} of frames", (0.05, 0.2, 1), _shuffled),
)  # fmt: skip
