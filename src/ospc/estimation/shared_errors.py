"""Errors that pairs of frames share, which the scatter between the pairs therefore does not show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.observations import ExposedObservations
from ospc.settings.fit import LOG_RATIO_DECIMALS, SHARED_ERROR, SHARED_ERROR_GREY, SHARED_ERROR_LOG_RATIO


@dataclass(frozen=True)
class SharedErrors:
    """Scores of the errors that pairs of frames share."""

    disagreement: FloatArray
    """Differences of the scores between halves of the observations, shape (ways, p)."""
    expected: FloatArray
    """Scores of the errors to expect in points of the same kind, shape (kinds, p)."""


def halves(observations: ExposedObservations) -> FloatArray:
    """Return the half, −1 or 1, that each point belongs to for each way of splitting, shape (ways, points).

    The ways are: early and late, large and small exposure ratios, rising and falling exposure, centre and edge.
    """
    first = observations.starts
    last = first + observations.counts - 1
    log_ratio = np.round(observations.log_exposure[last] - observations.log_exposure[first], LOG_RATIO_DECIMALS)
    squared_radius = np.sum(observations.position**2, axis=1)
    size, time, place = np.abs(log_ratio), observations.group[first], squared_radius[first] + squared_radius[last]
    above = (time > np.median(time), size > np.median(size), log_ratio > 0.0, place > np.median(place))
    return np.where(above, 1.0, -1.0)


def expected_errors(observations: ExposedObservations) -> tuple[FloatArray, IntArray, int]:
    """Return the expected error of ln k and the kind of each observation's pair, shape (n,), and the number of kinds.

    Points of a kind, with about the same exposure ratio and grey level in the brighter frame, share their error.
    """
    # They matter in brackets: if all exposures differ by powers of one ratio, the observations hardly show changes of
    # ln g that are periodic with it, and even small errors look like such changes.
    if not observations.in_pairs:
        return np.zeros(len(observations)), np.zeros(len(observations), np.int64), 0
    log_ratio = np.round(np.diff(observations.log_exposure.reshape(-1, 2), axis=1)[:, 0], LOG_RATIO_DECIMALS)
    by_ratio = np.abs(log_ratio) // SHARED_ERROR_LOG_RATIO
    by_grey = observations.grey.reshape(-1, 2).max(axis=1) // SHARED_ERROR_GREY
    kinds, kind = np.unique(by_ratio * (1 + by_grey.max(initial=0)) + by_grey, return_inverse=True)
    return np.repeat(SHARED_ERROR * log_ratio, 2), np.repeat(kind, 2), len(kinds)
