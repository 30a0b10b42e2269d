"""``ospc experiments``."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from command_line import ospc
from ospc.cli.experiments import command
from ospc.errors import SettingError
from ospc.research.experiments.design import EXPERIMENTS
from ospc.research.experiments.systems import SYSTEMS, in_colour, system_sources
from ospc.research.runner import Task
from ospc.research.source import SimulatedSource
from ospc.simulation import SimulationSettings


def run(*words):
    return ospc("experiments", *words)


def test_every_experiment_has_a_command():
    assert set(command.commands) == {*EXPERIMENTS, "ambiguity", "systems"}


def test_a_given_recording_is_measured_with_another_programs_calibration(tiny_room, tmp_path, monkeypatch):
    theirs = f"theirs={tiny_room}/pcalib.txt,{tiny_room}/vignette.png"
    words = ["parameters", tiny_room, "-o", tmp_path / "out", "--calibration", theirs]
    first = run(*words)
    assert first.exit_code == 0, first.output
    assert "theirs" in first.output
    table = (tmp_path / "out" / "measurements.csv").read_text()
    assert table.count("\n") == 4
    assert (tmp_path / "out" / "curves-room.png").is_file()
    monkeypatch.setattr(Task, "run", lambda *_: pytest.fail("computed again"))
    again = run(*words)
    assert again.exit_code == 0, again.output
    assert (tmp_path / "out" / "measurements.csv").read_text() == table


@pytest.mark.parametrize("study", ["parameters", "systems"])
def test_recordings_of_one_name_are_refused(study, tiny_room, tmp_path):
    result = run(study, tiny_room, tiny_room, "-o", tmp_path)
    assert isinstance(result.exception, SettingError)
    assert "two recordings are named room" in str(result.exception)


def test_a_folder_with_other_files_is_refused_and_unchanged(tiny_room, tmp_path):
    (tmp_path / "table.md").write_text("my notes")
    result = run("ambiguity", tiny_room, "-o", tmp_path)
    assert isinstance(result.exception, SettingError)
    assert "not from an earlier study" in str(result.exception)
    assert [place.name for place in tmp_path.iterdir()] == ["table.md"]


def test_an_interruption_is_reported_and_finished_results_are_kept(tmp_path, monkeypatch):
    whole = Task.run

    def interrupted(task, progress):
        if task.about.name.endswith("1"):
            raise KeyboardInterrupt
        return whole(task, progress)

    monkeypatch.setattr(Task, "run", interrupted)
    result = run("static", "-o", tmp_path, "--count", 2, "--frames", 6, "--size", "48x36")
    assert result.exit_code == 130
    assert "the same command continues" in result.output
    assert "debevec-malik" in result.output
    assert len(list((tmp_path / "cache").iterdir())) == 1


@pytest.mark.parametrize(
    "words", [["--size", "big"], ["--data", "/nowhere"], ["--calibration", "x"], ["--calibration", "=y"]]
)
def test_wrong_options_are_one_sentence(tmp_path, words):
    result = ospc("experiments", "joint", "-o", tmp_path, "--frames", 4, *words)
    assert result.exit_code == 2 or isinstance(result.exception, SettingError)
    assert words[1] in result.output + str(result.exception)


def test_systems_are_listed_measured_side_by_side_and_resumed(tmp_path, monkeypatch):
    listed = run("systems", "--list")
    assert listed.exit_code == 0, listed.output
    assert "lin-2004: Lin, Gu, Yamazaki, Shum 2004" in listed.output
    assert listed.output.count("\n") == len(SYSTEMS)
    only = ["--only", "lin-zhang*,zheng-2008,fallback", "--count", 1, "--frames", 3, "--size", "96x72"]
    first = run("systems", "-o", tmp_path, *only)
    assert first.exit_code == 0, first.output
    assert (tmp_path / "systems.png").is_file()
    table = (tmp_path / "table.md").read_text()
    assert "Zheng, Lin, Kambhamettu, Yu, Kang 2008" in table
    assert "Coverage of the bands" in table
    assert "bergmann" not in table
    monkeypatch.setattr(Task, "run", lambda *_: pytest.fail("computed again"))
    assert run("systems", "-o", tmp_path, *only).exit_code == 0
    with pytest.raises(SettingError, match="no system"):
        raise run("systems", "-o", tmp_path, "--only", "nobody").exception


def test_systems_can_be_handed_to_other_processes():
    for system in SYSTEMS.values():
        assert pickle.loads(pickle.dumps(system)) is system


def test_every_simulated_recording_has_a_camera_of_its_own():
    first, second = system_sources(2, 3, (96, 72), None)
    assert first.factors != second.factors
    assert not np.array_equal(first.truth().vignette.image(), second.truth().vignette.image())
    with pytest.raises(SettingError, match="recording"):
        system_sources(0, 3, (96, 72), None)


def test_the_green_channel_of_a_recording_in_colour_is_the_recording():
    source = SimulatedSource("room", SimulationSettings(size=(96, 72), frames=2))
    for grey, colour in zip(source.frames(), in_colour(source).frames(), strict=True):
        assert colour.image.shape == (72, 96, 3)
        assert colour.exposure_ms == grey.exposure_ms
        np.testing.assert_array_equal(colour.image[..., 1], grey.image)
        assert not np.array_equal(colour.image[..., 0], grey.image)
