"""Methods that share frames match them only once."""

from __future__ import annotations

import numpy as np
import pytest

from ospc.calibrator import OnlineCalibrator
from ospc.methods.paper import FeatureMatcher
from ospc.recording.frame import Frame
from ospc.research import method
from ospc.research.accuracy.design import PresetMethods
from ospc.research.method import VIGNETTE_SOLVERS, Estimate, SharedMatcher, run_methods
from ospc.research.source import SimulatedSource
from ospc.settings import PaperSettings
from ospc.simulation import SimulationSettings, frames

SETTINGS = SimulationSettings(size=(240, 180), frames=30, seed=3, scene_seed=0, exposure="cycle", speed=1.5)


@pytest.fixture(scope="module")
def recording():
    return list(frames(SETTINGS))


def found_by(name, recording, *, solvers=True, progress=lambda _share: None):
    source = SimulatedSource("simulated", SETTINGS, group="simulated" if solvers else "static")
    return run_methods(PresetMethods(name).make(source), recording, len(recording), progress)


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


def test_solvers_share_features_and_matches(recording, monkeypatch):
    counting = Counting()
    monkeypatch.setattr(method, "FeatureMatcher", lambda _settings: counting)
    shares = []
    found = found_by("paper", recording, progress=shares.append)
    assert list(found) == [f"paper/{solver}" for solver in VIGNETTE_SOLVERS]
    assert counting.extracted == list(range(len(recording)))
    assert len(set(counting.matched)) == len(counting.matched)
    assert shares[-1] == 1.0


def test_without_solvers_the_preset_is_run_as_it_is(recording):
    assert list(found_by("paper", recording[:5], solvers=False)) == ["paper"]


def test_default_gives_a_calibration(recording):
    found = found_by("default", recording[:12])
    assert list(found) == ["default"]
    assert isinstance(found["default"], Estimate)


@pytest.mark.parametrize("name", ["default", "paper"])
def test_a_method_that_breaks_down_loses_only_its_own_case(name, monkeypatch):
    def broken(*_arguments):
        raise ZeroDivisionError("what a pity")

    monkeypatch.setattr(OnlineCalibrator, "push", broken)
    monkeypatch.setattr(SharedMatcher, "features", broken)
    frame = Frame.of_array(np.full((48, 64), 100, np.uint8), 1.0)
    found = found_by(name, [frame])
    assert set(found.values()) == {"unexpected ZeroDivisionError: what a pity"}
