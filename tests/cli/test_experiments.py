"""``ospc experiments``."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from ospc.cli.experiments import command
from ospc.experiments.design import EXPERIMENTS
from ospc.simulation import SimulationSettings, simulate


@pytest.fixture
def run(monkeypatch):
    monkeypatch.delenv("OSPC_DATA", raising=False)
    return lambda *words: CliRunner().invoke(command, [str(word) for word in words])


def test_every_experiment_has_a_command():
    assert set(command.commands) == {*EXPERIMENTS, "static", "ambiguity"}


def test_a_given_recording_and_another_programs_calibration_are_measured(run, tmp_path):
    place = tmp_path / "room"
    simulate(place, SimulationSettings(size=(64, 48), frames=8))
    result = run(
        "parameters",
        place,
        "-o",
        tmp_path / "out",
        "--calibration",
        f"theirs={place}/pcalib.txt,{place}/vignette.png",
    )
    assert result.exit_code == 0, result.output
    assert "theirs" in result.output
    assert (tmp_path / "out" / "measurements.csv").read_text().count("\n") == 4
    assert (tmp_path / "out" / "curves-room.png").is_file()


def test_static_sweeps_are_simulated(run, tmp_path):
    result = run("static", "-o", tmp_path / "out", "--count", 1, "--frames", 6, "--size", "48x36")
    assert result.exit_code == 0, result.output
    assert "debevec-malik" in result.output


@pytest.mark.parametrize(
    "words", [["--size", "big"], ["--data", "/nowhere"], ["--calibration", "x"], ["--calibration", "=y"]]
)
def test_wrong_options_are_one_sentence(run, tmp_path, words):
    result = run("joint", "-o", tmp_path, "--frames", 4, *words)
    assert result.exit_code != 0
    assert type(result.exception).__name__ in ("SettingError", "FormatError")
