"""The accuracy gate: errors of whole runs on simulated recordings, limited to twice their measured values.

``benchmarks/mutations.py`` shows what the gate detects: it breaks the estimator in known ways, and each must
exceed a limit.
"""

from __future__ import annotations

import pytest
from accurate_recordings import LIMITS, RECORDINGS


@pytest.mark.parametrize(("name", "metric"), [(name, metric) for name in LIMITS for metric in LIMITS[name]])
def test_errors_stay_below_their_limits(run, name, metric, record_property):
    errors, limit = run(name).errors, LIMITS[name][metric]
    assert metric in errors, "that part of the calibration wasn't found at all"
    record_property("error", errors[metric])
    record_property("limit", limit)
    assert errors[metric] <= limit


@pytest.mark.parametrize("name", RECORDINGS)
def test_exposures_without_lag_are_not_moved(run, name):
    assert run(name).calibration.source.get("exposure_lag_corrected_frames", 0) == 0


@pytest.mark.parametrize("name", RECORDINGS)
def test_response_and_vignette_are_known(run, name):
    assert {verdict.known for verdict in run(name).calibration.verdicts.values()} == {True}


@pytest.mark.parametrize("name", RECORDINGS)
def test_there_are_no_warnings(run, name):
    assert run(name).calibration.warnings == ()


def test_pairs_compared_before_the_vignette_was_known_are_given_up(run):
    """The errors of a whole run cannot show this: these pairs change them by less than chance."""
    found = run("dark").calibration
    ratios, pairs = found.exposure_ratios, found.counts["pairs"]
    assert pairs >= 64
    assert len(ratios.metadata) <= pairs - 16
