from __future__ import annotations

import json

import numpy as np
import pytest

from command_line import ospc
from ospc.simulation import SimulationSettings, simulate


@pytest.fixture
def files(tmp_path):
    random = np.random.default_rng(0)
    truth = np.column_stack([np.arange(50) * 0.1, random.normal(size=(50, 3)), np.tile([0, 0, 0, 1], (50, 1))])
    estimate = truth.copy()
    estimate[:, 1:4] = 2 * truth[:, 1:4] + 0.1 * random.normal(size=(50, 3))
    truth[20:30, 1:] = np.nan
    for name, table in (("result.txt", estimate), ("truth.txt", truth)):
        np.savetxt(tmp_path / name, table)
    return str(tmp_path / "result.txt"), str(tmp_path / "truth.txt")


def test_ealign_prints_its_figures_with_units(files):
    result = ospc("evaluate", "ealign", *files)
    assert result.exit_code == 0
    for word in ("e_align", "e_s", "e_r", "ATE", "RPE", "degrees", "50, 20 with truth"):
        assert word in result.output


def test_ealign_as_json(files):
    content = json.loads(ospc("evaluate", "ealign", *files, "--json").output)
    assert 0 < content["e_align"] < 0.2
    assert content["e_s"] == pytest.approx(1, abs=0.1)
    assert content["e_r"] == content["e_r_deg"] < 5
    assert 0 < content["ate"] < 0.2
    assert 0 < content["rpe_translation"] < 0.5
    assert content["rpe_rotation_deg"] < 5
    assert content["poses"] == 50


def test_missing_relative_errors_do_not_hide_the_other_figures(files):
    result = ospc("evaluate", "ealign", *files, "--interval", "100")
    assert result.exit_code == 0
    assert "apart" in result.output
    content = json.loads(ospc("evaluate", "ealign", *files, "--interval", "100", "--json").output)
    assert content["rpe_translation"] is None


def test_tracking_works_without_exposures_and_says_so(tmp_path):
    settings = SimulationSettings(size=(128, 96), frames=6)
    recording = simulate(tmp_path / "recording", settings).path
    (recording / "times.txt").unlink()
    result = ospc("evaluate", "tracking", recording / "images", "--calibration", recording)
    assert result.exit_code == 0, result.output
    assert "exposures are unknown and assumed to be equal" in result.output
    content = json.loads(
        ospc("evaluate", "tracking", recording / "images", "--calibration", recording, "--json").output
    )
    assert content["exposures_known"] is False
