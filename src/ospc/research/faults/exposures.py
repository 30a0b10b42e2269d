"""Faults of the exposures in the metadata; the images stay unchanged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ospc.arrays import FloatArray
from ospc.research.faults.footage import Fault, Footage, Strengths

_HIDDEN_GAIN_FRAMES = 10
"""Frames for which a hidden gain stays constant."""


def _stated(name: str, text: str, strengths: Strengths, change: Callable[[FloatArray, float], FloatArray]) -> Fault:
    """Return a fault that replaces the true exposures e, shape (frames,), at a strength x."""
    return Fault(name, text, strengths, lambda f, x: f.with_exposures(change(f.exposures_ms, x)))


def _in_lines(name: str, text: str, strengths: Strengths, wrong: Callable[[FloatArray], FloatArray | float]) -> Fault:
    """Return a fault that affects only a share of the lines."""

    def change(footage: Footage, share: float) -> Footage:
        e = footage.exposures_ms
        return footage.with_exposures(np.where(footage.some(share), wrong(e), e))

    return Fault(name, text, strengths, change)


def _moved(e: FloatArray, lag: FloatArray | float) -> FloatArray:
    """Return the exposures recorded with every frame if they lag by this many frames."""
    return np.asarray(np.exp(np.interp(np.arange(e.size) - lag, np.arange(e.size), np.log(e))))


def _smoothed(e: FloatArray, frames: float) -> FloatArray:
    side = int(frames) // 2
    return np.convolve(np.pad(e, side, mode="edge"), np.full(2 * side + 1, 1 / (2 * side + 1)), mode="valid")


def _lost_digit(e: FloatArray) -> FloatArray:
    leading = 10.0 ** np.floor(np.log10(e))
    return np.maximum(e % leading, leading / 100)


def _swapped(footage: Footage, share: float) -> Footage:
    swapped = footage.exposures_ms.copy()
    for i in np.flatnonzero(footage.some(share)):
        swapped[[i - 1, i]] = swapped[[i, i - 1]]
    return footage.with_exposures(swapped)


def _shuffled(footage: Footage, share: float) -> Footage:
    order = footage.random.permutation(np.flatnonzero(footage.some(share)))
    shuffled = footage.exposures_ms.copy()
    shuffled[order] = footage.exposures_ms[np.roll(order, 1)]
    return footage.with_exposures(shuffled)


def _power(footage: Footage, power: float) -> Footage:
    return replace(footage.with_exposures(footage.exposures_ms**power), power=power)


FAULTS = (
    _stated("offset", "{} ms added to every exposure", (0.5, 1, 2), lambda e, x: e + x),
    _stated("offset-down", "{} of the shortest exposure subtracted from all", (0.2, 0.5, 0.8),
        lambda e, x: e - x * e.min()),
    _stated("logarithm", "log2 of the exposure plus {}", (8, 5, 2), lambda e, x: np.log2(e) + x),
    Fault("power", "exposures to the power of {}", (0.95, 0.9, 0.8), _power),
    Fault("power-up", "exposures to the power of {}", (1.05, 1.1, 1.25), _power),
    _stated("reciprocal", "1000 over the exposure to the power of {}", (0.2, 1, 2), lambda e, x: 1000.0 * e**-x),
    _stated("ceiling", "a hidden gain instead of exposures above the {} quantile", (0.95, 0.85, 0.5),
        lambda e, x: np.minimum(e, np.quantile(e, x))),
    _stated("floor", "an iris instead of exposures below the {} quantile", (0.05, 0.15, 0.5),
        lambda e, x: np.maximum(e, np.quantile(e, x))),
    _stated("dual-gain", "a hidden gain of {} above the median exposure", (1.05, 1.2, 2),
        lambda e, x: np.where(e > np.median(e), e / x, e)),
    _stated("gain-step", "a hidden gain of {} for the longest two fifths of the exposures", (1.005, 1.01, 1.02),
        lambda e, x: np.where(e > np.quantile(e, 0.6), e / x, e)),
    _stated("gain-when-dark", "a hidden gain of {} for the longest fifth of the exposures", (1.1, 1.5, 4),
        lambda e, x: np.where(e > np.quantile(e, 0.8), e / x, e)),
    Fault("hidden-gain", "a hidden gain of ±{} that switches every 10 frames", (0.02, 0.05, 0.1),
        lambda f, x: f.with_exposures(f.exposures_ms / (1 + x * f.blocks(_HIDDEN_GAIN_FRAMES)))),
    _stated("drift", "exposures that drift from the truth to a factor of {}", (1.05, 1.2, 1.5),
        lambda e, x: e * np.geomspace(1, x, e.size)),
    _stated("stale", "exposures updated only every {} frames", (3, 10, 30),
        lambda e, x: e[np.arange(e.size) // int(x) * int(x)]),
    _stated("late", "exposures {} frames late", (1, 2, 3), _moved),
    _stated("early", "exposures {} frames early", (1, 2, 3), lambda e, x: _moved(e, -x)),
    _stated("late-by-a-part", "exposures {} of a frame late", (0.25, 0.5, 0.75), _moved),
    Fault("changing-lag", "exposures 1 frame late, and 2 frames in a fraction of {}", (0.1, 0.3, 0.5),
        lambda f, x: f.with_exposures(_moved(f.exposures_ms, np.where(f.some(x), 2.0, 1.0)))),
    _stated("lag-midway", "exposures {} frames late in the second half", (1, 2, 3),
        lambda e, x: _moved(e, np.where(np.arange(e.size) >= e.size // 2, float(x), 0.0))),
    _stated("gain-midway", "{} times all exposures in the second half", (1.1, 1.5, 1000),
        lambda e, x: np.where(np.arange(e.size) >= e.size // 2, x * e, e)),
    _stated("smoothed", "exposures averaged over {} frames", (3, 5, 9), _smoothed),
    _stated("stops", "exposures rounded to {} stops", (0.25, 0.5, 1),
        lambda e, x: 2.0 ** (np.rint(np.log2(e) / x) * x)),
    _stated("rounded", "exposures rounded to {} ms", (0.5, 1, 5), lambda e, x: np.maximum(np.rint(e / x), 1) * x),
    Fault("jitter", "exposures that scatter by {}", (0.01, 0.03, 0.1),
        lambda f, x: f.with_exposures(f.exposures_ms * np.exp(x * f.random.standard_normal(len(f))))),
    _in_lines("tenfold", "tenfold exposures in a fraction of {} of lines", (0.002, 0.01, 0.05), lambda e: 10 * e),
    _in_lines("not-a-number", "no number in a fraction of {} of lines", (0.01, 0.05, 0.2), lambda _: np.nan),
    _in_lines("zero", "0 in a fraction of {} of lines", (0.01, 0.05, 0.2), lambda _: 0.0),
    _in_lines("negative", "a minus sign in a fraction of {} of lines", (0.01, 0.05, 0.2), lambda e: -e),
    _in_lines("mixed-units", "microseconds in a fraction of {} of lines", (0.01, 0.1, 0.5), lambda e: 1000 * e),
    _in_lines("lost-digit", "the first digit lost in a fraction of {} of lines", (0.01, 0.05, 0.2), _lost_digit),
    _stated("another-unit", "{} times all exposures", (0.001, 1000, 1e6), lambda e, x: x * e),
    _stated("constant-written", "one exposure recorded for the first {} of frames", (0.2, 0.5, 1),
        lambda e, x: np.where(np.arange(e.size) < x * e.size, np.median(e), e)),
    Fault("swapped", "exposures of neighbours swapped in a fraction of {} of frames", (0.05, 0.2, 0.5), _swapped),
    Fault("shuffled", "exposures shuffled among a fraction of {} of frames", (0.05, 0.2, 1), _shuffled),
)  # fmt: skip
