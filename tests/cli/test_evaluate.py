"""``ospc evaluate``."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

from ospc.cli.evaluate import command


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
    result = CliRunner().invoke(command, ["ealign", *files])
    assert result.exit_code == 0
    for word in ("e_align", "e_s", "e_r", "ATE", "RPE", "degrees", "50, 20 with truth"):
        assert word in result.output


def test_ealign_as_json(files):
    content = json.loads(CliRunner().invoke(command, ["ealign", *files, "--json"]).output)
    assert 0 < content["e_align"] < 0.2
    assert content["e_s"] == pytest.approx(1, abs=0.1)
    assert content["e_r"] == content["e_r_deg"] < 5
    assert 0 < content["ate"] < 0.2
    assert 0 < content["rpe_translation"] < 0.5
    assert content["rpe_rotation_deg"] < 5
    assert content["poses"] == 50


def test_relative_errors_that_cannot_be_known_do_not_hide_the_others(files):
    result = CliRunner().invoke(command, ["ealign", *files, "--interval", "100"])
    assert result.exit_code == 0
    assert "apart" in result.output
    content = json.loads(CliRunner().invoke(command, ["ealign", *files, "--interval", "100", "--json"]).output)
    assert content["rpe_translation"] is None


def test_odometry_wants_a_program_or_the_one_built_in(tmp_path):
    from ospc.simulation import SimulationSettings, simulate

    place = tmp_path / "room"
    simulate(place, SimulationSettings(size=(96, 72), frames=6, speed=0.5))
    out = str(tmp_path / "out")
    for options in ([], ["--builtin", "--program", "x"]):
        result = CliRunner().invoke(command, ["odometry", str(place), "-o", out, *options])
        assert "one of the two" in str(result.exception)
    given = f"mine={place / 'pcalib.txt'},{place / 'vignette.png'}"
    options = ["-o", out, "--builtin", "--runs", "1", "--conditions", "truth,none", "--calibration", given]
    result = CliRunner().invoke(command, ["odometry", str(place), *options])
    assert result.exit_code == 0, result.output
    assert "mine" in result.output
    assert "Full truth" in result.output
    again = CliRunner().invoke(command, ["odometry", str(place), *options, "--json"])
    content = json.loads(again.stdout)
    assert set(content["room"]) == {"truth", "none", "mine"}


@pytest.mark.parametrize("text", ["mine", "=x", "mine="])
def test_a_calibration_has_a_name_and_files(tmp_path, text):
    from ospc.simulation import SimulationSettings, simulate

    place = tmp_path / "room"
    simulate(place, SimulationSettings(size=(96, 72), frames=2))
    result = CliRunner().invoke(command, ["odometry", str(place), "--builtin", "--calibration", text])
    assert result.exit_code != 0
