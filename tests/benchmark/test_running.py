"""Methods run over the same frames: matched once, the same results as each on its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ospc.benchmark import running
from ospc.benchmark.running import VIGNETTE_SOLVERS, SharedMatcher, run_preset
from ospc.calibrator import OnlineCalibrator
from ospc.methods.paper import FeatureMatcher
from ospc.photometry.calibration import Calibration
from ospc.recording.frame import Frame
from ospc.settings import PaperSettings, preset
from ospc.simulation import SimulationSettings, frames

SETTINGS = SimulationSettings(size=(320, 240), frames=50, seed=3, exposure="cycle", speed=1.5)


@pytest.fixture(scope="module")
def recording():
    return list(frames(SETTINGS))


class Counting:
    def __init__(self):
        self._matcher = FeatureMatcher(PaperSettings())
        self.extracted, self.matched = [], []

    def features(self, frame):
        self.extracted.append(frame.index)
        return self._matcher.features(frame)

    def correspondences(self, left, right, size):
        self.matched.append((left.frame, right.frame))
        return self._matcher.correspondences(left, right, size)


def test_every_solver_gives_what_it_gives_alone(recording, monkeypatch):
    counting = Counting()
    monkeypatch.setattr(running, "FeatureMatcher", lambda _settings: counting)
    shares = []
    found = run_preset("paper", recording, len(recording), shares.append)
    assert list(found) == [f"paper/{solver}" for solver in VIGNETTE_SOLVERS]
    assert counting.extracted == list(range(len(recording)))
    assert len(set(counting.matched)) == len(counting.matched)
    assert shares[-1] == 1.0
    for solver in VIGNETTE_SOLVERS:
        alone = OnlineCalibrator(replace(preset("paper"), vignette_solver=solver))
        for frame in recording:
            alone.push(frame)
        expected, got = alone.calibration(), found[f"paper/{solver}"]
        assert got.verdicts == expected.verdicts
        assert got.vignette == expected.vignette
        assert (got.response is None) == (expected.response is None)
        if expected.response is not None:
            assert np.array_equal(got.response.inverse_table, expected.response.inverse_table)


def test_without_solvers_the_preset_is_run_as_it_is(recording):
    assert list(run_preset("paper", recording[:5], 5, lambda _share: None, solvers=None)) == ["paper"]


def test_default_gives_a_calibration(recording):
    found = run_preset("default", recording[:12], 12, lambda _share: None)
    assert list(found) == ["default"]
    assert isinstance(found["default"], Calibration)


@pytest.mark.parametrize("name", ["default", "paper"])
def test_a_method_that_breaks_down_loses_only_its_own_case(name, monkeypatch):
    def broken(*_arguments):
        raise ZeroDivisionError("what a pity")

    monkeypatch.setattr(OnlineCalibrator, "push", broken)
    monkeypatch.setattr(SharedMatcher, "features", broken)
    frame = Frame.of_array(np.full((48, 64), 100, np.uint8), 1.0)
    found = run_preset(name, [frame], 1, lambda _share: None)
    assert set(found.values()) == {"ZeroDivisionError: what a pity"}
