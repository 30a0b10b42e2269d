"""Signs that the camera treats parts of an image differently, as local tone mapping does.

With one response for the whole image, the same change of exposure moves the same grey level equally far, wherever it
is and whatever is around it, and without a change of exposure nothing but the vignette moves it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median

from ospc.arrays import FloatArray, IntArray
from ospc.exposures.brightness import GREY_BINS, BrightnessChange
from ospc.robust import robust_scale

NO_LOCAL_TONE = "switch off local contrast, HDR and shading correction in the camera"
"""What to do about it."""

_MIN_PAIRS = 10
"""Fewest pairs of frames behind a result: samples of one pair err together, so that pairs are what counts."""

_MAX_PAIRS = 120
"""Most pairs used, spread over the recording: more take longer, and what depends on the camera shows in fewer."""

_MIN_SAMPLES = 2000
"""Fewest places of all pairs together: some fifteen unknowns are fitted to them before places are compared."""

_MAX_LOG_CHANGE = 1.5
"""Largest change of ln exposure used: beyond, most places are clipped in one of the frames."""

_CELLS = (4, 3)
"""Cells of the image, across and down, that are compared: about square, and large enough for several samples each."""

_MIN_CELL_SAMPLES = 8
"""Fewest samples that a cell's median is taken of: an outlier or two do not move it far."""

_MIN_CELLS = 3
"""Fewest cells of a pair that are compared: of two, both are equally far from their median."""

_ROUNDS = 4
"""Rounds of iterated reweighting; a linear fit with so many samples settles quickly."""

_HUBER_SIGMAS = 2.0
"""Residual, in robust standard deviations, from which on weights decrease (Huber): moving objects, wrong matches."""

_SURE_SPREAD_LOG = 0.015
_POSSIBLE_SPREAD_LOG = 0.006
"""Differences between parts of an image within one frame, in ln of the grey level, that are clear and possible signs
of local tone mapping. Without it they were 0.011 at most in 48 simulated recordings, and 0.0044 in all but one."""


@dataclass(frozen=True)
class LocalTone:
    """How much brightness changes depend on place and surroundings, from so many pairs of frames.

    ``place_spread_log`` is by how much, in ln of the grey level, parts of the image (twelve cells) change differently
    from the rest within one frame, beyond what grey level, exposure and vignette explain: a robust standard
    deviation.
    """

    place_spread_log: float
    pairs: int

    @property
    def is_clear(self) -> bool:
        """Whether these are clear signs of local tone mapping."""
        return self.place_spread_log > _SURE_SPREAD_LOG

    @property
    def text(self) -> str:
        """What the signs say, as a sentence; empty where there are none."""
        if not self.is_clear and self.place_spread_log <= _POSSIBLE_SPREAD_LOG:
            return ""
        certainty = "there are clear signs of" if self.is_clear else "there may be"
        return (
            f"{certainty} local tone mapping: parts of the image change in brightness differently from the rest, by "
            f"{self.place_spread_log:.1%} a frame"
        )


def local_tone(changes: Sequence[BrightnessChange], log_change: FloatArray) -> LocalTone | None:
    """Measure how much changes of brightness between consecutive frames depend on place and surroundings.

    ``log_change`` is the change of ln exposure of each, from metadata that belong to the frames, shape (pairs,). None
    where too few places could be compared.
    """
    usable = [
        i
        for i, change in enumerate(changes)
        if abs(log_change[i]) <= _MAX_LOG_CHANGE and len(change.samples.log_ratio) >= _MIN_CELL_SAMPLES
    ]
    usable = usable[:: max(1, -(-len(usable) // _MAX_PAIRS))]
    counts = [len(changes[i].samples.log_ratio) for i in usable]
    if len(usable) < _MIN_PAIRS or sum(counts) < _MIN_SAMPLES:
        return None
    pair = np.repeat(np.arange(len(usable)), counts)
    target = np.concatenate([changes[i].samples.log_ratio for i in usable])
    expected = np.concatenate([_global_columns(changes[i], float(log_change[i])) for i in usable])
    left = target - expected @ _fit(expected, target)
    place = np.concatenate([changes[i].samples.position0 for i in usable])
    return LocalTone(_spread_over_places(left, place, pair), len(usable))


def _global_columns(change: BrightnessChange, log_change: float) -> FloatArray:
    """Return what a log ratio may depend on: grey level times exposure, and a vignette that may be decentred."""
    samples = change.samples
    knots = np.log(GREY_BINS)
    grey = np.stack([np.interp(samples.log_grey, knots, row) for row in np.eye(len(knots))], axis=1)
    squared0, squared1 = (np.sum(p**2, axis=1) for p in (samples.position0, samples.position1))
    moved = samples.position1 - samples.position0
    return np.column_stack([grey * log_change, squared1 - squared0, squared1**2 - squared0**2, moved])


def _fit(columns: FloatArray, target: FloatArray) -> FloatArray:
    """Return the robust solution of a linear fit."""
    weight = np.ones(len(target))
    size: FloatArray = np.zeros(columns.shape[1])
    for _ in range(_ROUNDS):
        normal = np.asarray((columns * weight[:, None]).T @ columns)
        normal[np.diag_indices_from(normal)] += 1e-6 * np.trace(normal) / len(normal) + 1e-12
        size = np.asarray(np.linalg.solve(normal, columns.T @ (weight * target)))
        left = np.abs(target - columns @ size)
        weight = 1 / np.maximum(left / (_HUBER_SIGMAS * robust_scale(left) + 1e-6), 1)
    return size


def _spread_over_places(left: FloatArray, place: FloatArray, pair: IntArray) -> float:
    """Return the typical difference between what cells of the image leave unexplained in one pair of frames."""
    across, down = _CELLS
    extent = np.maximum(np.abs(place).max(axis=0), 1e-6)
    x, y = (np.clip((place[:, k] / extent[k] + 1) / 2 * n, 0, n - 1).astype(int) for k, n in ((0, across), (1, down)))
    cell = pair * across * down + y * across + x
    number, count = np.unique(cell, return_counts=True)
    number = number[count >= _MIN_CELL_SAMPLES]
    middle, of_pair = median(left, cell, number), number // (across * down)
    apart = [middle[of_pair == p] - np.median(middle[of_pair == p]) for p in np.unique(of_pair)]
    different = np.concatenate([np.abs(values) for values in apart if len(values) >= _MIN_CELLS] or [np.zeros(1)])
    return robust_scale(different)
