"""``ospc experiments``."""

from __future__ import annotations

import csv

import pytest

from command_line import ospc
from ospc.cli.experiments import command
from ospc.errors import SettingError
from ospc.research import source
from ospc.research.experiments.design import EXPERIMENTS


def run(*words):
    return ospc("experiments", *words)


def test_every_experiment_has_a_command():
    assert set(command.commands) == {*EXPERIMENTS, "ambiguity"}


def test_a_given_recording_is_measured_with_another_programs_calibration(tiny_room, tmp_path, monkeypatch):
    theirs = f"theirs={tiny_room}/pcalib.txt,{tiny_room}/vignette.png"
    words = ["parameters", tiny_room, "-o", tmp_path / "out", "--calibration", theirs]
    first = run(*words)
    assert first.exit_code == 0, first.output
    assert "theirs" in first.output
    table = (tmp_path / "out" / "measurements.csv").read_text()
    assert table.count("\n") == 4
    assert (tmp_path / "out" / "curves-room.png").is_file()
    monkeypatch.setattr("ospc.research.source._run_and_judge", lambda *_: pytest.fail("computed again"))
    again = run(*words)
    assert again.exit_code == 0, again.output
    assert (tmp_path / "out" / "measurements.csv").read_text() == table


def test_exposures_of_another_recording_fail_alone(tiny_room, tmp_path):
    (tmp_path / "theirs.txt").write_text("1\n" * 999)
    result = run("joint", tiny_room, "-o", tmp_path / "out", "--exposures", f"theirs={tmp_path / 'theirs.txt'}")
    assert result.exit_code == 0, result.exception
    with (tmp_path / "out" / "measurements.csv").open() as file:
        failures = {row["method"]: row["failure"] for row in csv.DictReader(file)}
    assert failures.pop("theirs").endswith("give one for each frame")
    assert "" in failures.values()


@pytest.mark.parametrize("more", [["--count", 2], ["--calibration", "a=b"], ["--exposures", "a=b"], ["other"]])
def test_the_ambiguity_refuses_what_it_would_ignore(more, tiny_room, tmp_path):
    result = run("ambiguity", tiny_room, "-o", tmp_path / "out", *more)
    assert result.exit_code == 2
    assert "a single recording" in result.output


@pytest.mark.parametrize("name", ["count", "size", "speed", "data"])
def test_options_for_simulated_recordings_are_refused_with_given_ones(name, tiny_room, tmp_path):
    value = {"size": "64x48", "data": tmp_path}.get(name, 2)
    given = run("parameters", tiny_room, "-o", tmp_path / "out", f"--{name}", value)
    assert given.exit_code == 2
    assert f"--{name} cannot be combined with given recordings" in given.output
    if name in ("speed", "data"):
        static = run("static", "-o", tmp_path / "out", f"--{name}", value)
        assert f"--{name} cannot be combined with a static camera" in static.output


def test_recordings_of_one_name_are_refused(tiny_room, tmp_path):
    result = run("parameters", tiny_room, tiny_room, "-o", tmp_path)
    assert isinstance(result.exception, SettingError)
    assert "two recordings are named room" in str(result.exception)


def test_a_folder_with_other_files_is_refused_and_unchanged(tiny_room, tmp_path):
    (tmp_path / "table.md").write_text("my notes")
    result = run("ambiguity", tiny_room, "-o", tmp_path)
    assert isinstance(result.exception, SettingError)
    assert "not from an earlier study" in str(result.exception)
    assert [place.name for place in tmp_path.iterdir()] == ["table.md"]


def test_an_interruption_is_reported_and_finished_results_are_kept(tmp_path, monkeypatch):
    whole = source._run_and_judge

    def interrupted(recording, methods, progress):
        if recording.name.endswith("1"):
            raise KeyboardInterrupt
        return whole(recording, methods, progress)

    monkeypatch.setattr("ospc.research.source._run_and_judge", interrupted)
    result = run("static", "-o", tmp_path, "--count", 2, "--frames", 6, "--size", "48x36")
    assert result.exit_code == 130
    assert "the same command continues" in result.output
    assert "debevec-malik" in result.output
    assert len(list((tmp_path / "cache").glob("static*"))) == 1


def test_files_of_an_earlier_run_go_and_those_of_others_stay(tmp_path):
    few = ["static", "-o", tmp_path, "--frames", 6, "--size", "48x36", "--count"]
    assert run(*few, 2).exit_code == 0
    (tmp_path / "curves-mine.csv").write_text("mine")
    curves = {file.name for file in tmp_path.glob("curves-*")}
    assert run(*few, 1).exit_code == 0
    gone = curves - {file.name for file in tmp_path.glob("curves-*")}
    assert gone == {"curves-static-srgb-1.csv", "curves-static-srgb-1.png"}


@pytest.mark.parametrize(
    "words", [["--size", "big"], ["--data", "/nowhere"], ["--calibration", "x"], ["--calibration", "=y"]]
)
def test_wrong_options_are_one_sentence(tmp_path, words):
    result = ospc("experiments", "joint", "-o", tmp_path, "--frames", 4, *words)
    assert result.exit_code == 2 or isinstance(result.exception, SettingError)
    assert words[1] in result.output + str(result.exception)
