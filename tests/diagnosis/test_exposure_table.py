"""Exposures by frame number, summarised without copies for any number of frames."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from ospc.exposures.table import ExposureReport, ExposureTable, exposure_cycle, filled

MANY = 300_000


def table(exposures_ms: np.ndarray, lag: int = 0) -> ExposureTable:
    made = ExposureTable(lag)
    for exposure_ms in exposures_ms:
        made.append(exposure_ms)
    return made


def test_missing_exposures_lie_between_their_neighbours() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        values = rng.normal(size=12)
        known = rng.random(12) < 0.6
        expected = np.interp(np.arange(12), np.flatnonzero(known), values[known]) if known.any() else np.zeros(12)
        np.testing.assert_array_equal(filled(np.where(known, values, np.nan)), expected)


@pytest.mark.parametrize("wrong_share", [0.0, 0.01, 0.02])
def test_a_long_course_is_summed_up_like_a_short_one(wrong_share: float) -> None:
    rng = np.random.default_rng(1)
    exposures_ms = np.array([1.0, 2.0, 5.0, 3.0])[np.arange(MANY) % 4]
    exposures_ms[rng.random(MANY) < wrong_share] = 7.0
    log_exposure = np.log(exposures_ms)
    report = ExposureReport.of(log_exposure)
    assert report.values == len(np.unique(exposures_ms))
    assert report.changed_share == np.mean(np.abs(np.diff(log_exposure)) >= 0.01)
    repeated = np.mean(np.abs(log_exposure[4:] - log_exposure[:-4]) < 1e-3)
    assert report.cycle_frames == exposure_cycle(log_exposure) == (4 if repeated >= 0.97 else None)


def test_frames_without_end_take_eight_bytes_each() -> None:
    made = table(np.array([1.0, 2.0, 5.0])[np.arange(MANY) % 3])
    tracemalloc.start()
    ExposureReport.of(filled(made.log_recorded))
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak_bytes < 4 * MANY


def test_later_frames_have_no_exposure_even_if_theirs_was_recorded_early() -> None:
    early = replace(table(np.arange(1.0, 9.0)).before(5), lag_frames=-2)
    assert np.flatnonzero(np.isfinite(early.log_exposure_of(np.arange(8)))).tolist() == [2, 3, 4]
