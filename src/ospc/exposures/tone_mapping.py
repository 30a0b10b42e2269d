"""Detect local tone mapping: processing that treats parts of an image differently.

With one response for the whole image, a change of exposure has the same effect on a grey level wherever it is and
whatever surrounds it; without a change of exposure, only the vignette changes the grey level.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.exposures.brightness import BrightnessChange
from ospc.robust import huber_weights, medians, robust_scale
from ospc.settings.brightness import (
    CLEAR_TONE_SPREAD_LOG,
    GREY_BIN_EDGES,
    MAX_TONE_LOG_CHANGE,
    MAX_TONE_PAIRS,
    MIN_TONE_CELL_SAMPLES,
    MIN_TONE_CELLS,
    MIN_TONE_PAIRS,
    MIN_TONE_SAMPLES,
    POSSIBLE_TONE_SPREAD_LOG,
    TONE_CELLS,
    TONE_HUBER_SIGMAS,
    TONE_REWEIGHTINGS,
    TONE_RIDGE,
)

NO_LOCAL_TONE = "switch off local contrast, HDR and shading correction in the camera"
"""Remedy for local tone mapping."""


@dataclass(frozen=True)
class LocalTone:
    """How much brightness changes depend on image region, measured on ``pairs`` pairs of frames.

    ``place_spread_log`` is the robust standard deviation, in ln of the grey level, of the differences between the
    changes of image regions (twelve cells) within one pair, beyond what grey level, exposure and vignette explain.
    """

    place_spread_log: float
    pairs: int

    @property
    def is_clear(self) -> bool:
        """Whether the signs of local tone mapping are clear."""
        return self.place_spread_log > CLEAR_TONE_SPREAD_LOG

    @property
    def text(self) -> str:
        """Description of the signs; empty if there are none."""
        if not self.is_clear and self.place_spread_log <= POSSIBLE_TONE_SPREAD_LOG:
            return ""
        certainty = "there are clear signs of" if self.is_clear else "there may be"
        return (
            f"{certainty} local tone mapping: brightness changes differ between parts of the image by "
            f"{self.place_spread_log:.1%} per frame"
        )


def local_tone(changes: Sequence[BrightnessChange], log_change: FloatArray) -> LocalTone | None:
    """Measure how much brightness changes between consecutive frames depend on the image region.

    ``log_change`` is the change of ln exposure of each pair, with any lag corrected, shape (pairs,). Returns None if
    too few points could be compared.
    """
    usable = [
        i
        for i, change in enumerate(changes)
        if abs(log_change[i]) <= MAX_TONE_LOG_CHANGE and len(change.samples.log_ratio) >= MIN_TONE_CELL_SAMPLES
    ]
    usable = usable[:: max(1, -(-len(usable) // MAX_TONE_PAIRS))]
    counts = [len(changes[i].samples.log_ratio) for i in usable]
    if len(usable) < MIN_TONE_PAIRS or sum(counts) < MIN_TONE_SAMPLES:
        return None
    pair = np.repeat(np.arange(len(usable)), counts)
    target = np.concatenate([changes[i].samples.log_ratio for i in usable])
    expected = np.concatenate([_global_columns(changes[i], float(log_change[i])) for i in usable])
    residual = target - expected @ _fit(expected, target)
    position = np.concatenate([changes[i].samples.position0 for i in usable])
    return LocalTone(_spread_between_cells(residual, position, pair), len(usable))


def _global_columns(change: BrightnessChange, log_change: float) -> FloatArray:
    """Return the terms of a global model of log ratios: grey level times exposure, and a decentred vignette.

    ln M between two exposures is an odd function of the change of ln e at each grey level. Its cubic part matters
    where changes of different sizes alternate, as in a series of brackets.
    """
    samples = change.samples
    knots = np.log(GREY_BIN_EDGES)
    grey = np.stack([np.interp(samples.log_grey, knots, row) for row in np.eye(len(knots))], axis=1)
    squared0, squared1 = (np.sum(p**2, axis=1) for p in (samples.position0, samples.position1))
    moved = samples.position1 - samples.position0
    by_exposure = grey * log_change, grey * log_change**3
    return np.column_stack([*by_exposure, squared1 - squared0, squared1**2 - squared0**2, moved])


def _fit(columns: FloatArray, target: FloatArray) -> FloatArray:
    """Return the coefficients of a robust linear fit."""
    weight = np.ones(len(target))
    coefficients: FloatArray = np.zeros(columns.shape[1])
    for _ in range(TONE_REWEIGHTINGS):
        normal = np.asarray((columns * weight[:, None]).T @ columns)
        normal[np.diag_indices_from(normal)] += TONE_RIDGE * np.trace(normal) / len(normal) + 1e-12
        coefficients = np.asarray(np.linalg.solve(normal, columns.T @ (weight * target)))
        residual = target - columns @ coefficients
        weight = huber_weights(residual, TONE_HUBER_SIGMAS * robust_scale(residual) + 1e-6)
    return coefficients


def _spread_between_cells(residual: FloatArray, position: FloatArray, pair: IntArray) -> float:
    """Return the robust scale of the differences between the residuals of image cells within a pair of frames."""
    across, down = TONE_CELLS
    extent = np.maximum(np.abs(position).max(axis=0), 1e-6)
    x, y = (
        np.clip((position[:, k] / extent[k] + 1) / 2 * n, 0, n - 1).astype(int) for k, n in ((0, across), (1, down))
    )
    cell = pair * across * down + y * across + x
    number, group, count = np.unique(cell, return_inverse=True, return_counts=True)
    enough = count >= MIN_TONE_CELL_SAMPLES
    middle, of_pair = medians(residual, group)[enough], number[enough] // (across * down)
    offsets = [middle[of_pair == p] - np.median(middle[of_pair == p]) for p in np.unique(of_pair)]
    deviations = np.concatenate(
        [np.abs(values) for values in offsets if len(values) >= MIN_TONE_CELLS] or [np.zeros(1)]
    )
    return robust_scale(deviations)
