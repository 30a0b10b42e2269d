"""Recordings × conditions × runs: complete, resumable, with failures in the table."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from ospc.errors import RecordingError, SettingError
from ospc.evaluation.trajectory import read_trajectory
from ospc.odometry.batch import end_segments
from ospc.odometry.calibrations import Calibrations, true_photometry
from ospc.odometry.conditions import AFFINE, STANDARD, chosen, external
from ospc.odometry.experiment import Experiment, run_experiment, write_outcome
from ospc.odometry.inputs import OdometryInput, images_of
from ospc.odometry.run import RunResult
from ospc.odometry.summary import markdown, table
from ospc.recording import open_recording


@pytest.fixture
def experiment(recording, tmp_path):
    truth = true_photometry(recording)
    given = {"ours": truth, "joint-wgt": truth, "mine": truth}
    conditions = (*chosen(["truth", "ours", "none"]), external("mine"))
    return Experiment({"room": recording}, conditions, 2, Calibrations(tmp_path / "c", given), tmp_path / "out")


def calls(tmp_path) -> int:
    place = tmp_path / "calls.txt"
    return len(place.read_text().splitlines()) if place.exists() else 0


def test_all_runs_are_made_once_and_found_again(experiment, make_program, tmp_path):
    program = make_program()
    seen: list[bool] = []
    first = run_experiment(experiment, program, 2, lambda _result, stored: seen.append(stored))
    assert seen == [False] * 8
    # truth, ours and mine are the same files, and so the same runs
    assert calls(tmp_path) == 8
    assert [(r.condition, r.run) for r in first.results] == [
        (name, run) for name in ("truth", "ours", "none", "mine") for run in (0, 1)
    ]
    again = run_experiment(experiment, program, 1, lambda _result, stored: seen.append(stored))
    assert seen[8:] == [True] * 8
    assert calls(tmp_path) == 8
    stored = {r.condition: r.e_align for r in again.results}
    assert stored["truth"] == pytest.approx(stored["mine"])


def test_another_calibration_program_or_number_of_runs_is_run_anew(experiment, make_program, tmp_path):
    run_experiment(experiment, make_program())
    before = calls(tmp_path)
    run_experiment(replace(experiment, runs=3), make_program())
    assert calls(tmp_path) == before + 4
    run_experiment(replace(experiment, runs=1), make_program(arguments=("preset=1",)))
    assert calls(tmp_path) == before + 4 + 4


def test_an_interruption_keeps_what_is_finished(experiment, make_program, tmp_path):
    def interrupt(_result: RunResult, _stored: bool) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_experiment(experiment, make_program(), 1, interrupt)
    before = calls(tmp_path)
    assert before < 8
    run_experiment(experiment, make_program())
    assert calls(tmp_path) <= 8 + 1


def test_a_calibration_that_cannot_be_made_is_a_failed_run(experiment, make_program):
    wanting = replace(experiment, conditions=(external("absent"), *chosen(["none"])))
    outcome = run_experiment(wanting, make_program())
    assert [r.outcome for r in outcome.results] == ["failed", "failed", "finished", "finished"]
    assert "absent" in outcome.notes[0]
    _, problems = write_outcome(wanting, outcome)
    assert not problems
    assert "failed (2/2 failed)" in (wanting.folder / "table.md").read_text()
    content = json.loads((wanting.folder / "results.json").read_text())
    assert content["medians"]["room"]["absent"] == {"median": None, "finished": 0, "runs": 2}


def test_files_hold_every_run_and_pictures_are_drawn(experiment, make_program):
    outcome = run_experiment(experiment, make_program())
    files, problems = write_outcome(experiment, outcome)
    assert not problems
    assert {p.name for p in files} == {
        "runs.csv",
        "results.json",
        "table.md",
        "cumulative.png",
        "trajectories-room.png",
    }
    with (experiment.folder / "runs.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 8
    assert float(rows[0]["e_align"]) == pytest.approx(outcome.results[0].e_align)


def result(condition: str, run: int, error: float | None, recording: str = "a") -> RunResult:
    outcome = "finished" if error is not None else "lost"
    return RunResult(recording, condition, run, outcome, "", error, None, None, None, 1, 1.0, 1.0)


def test_the_table_has_medians_the_lowest_bold_and_says_how_many_failed():
    conditions = chosen(["truth", "ours", "none"])
    results = [result("truth", i, e) for i, e in enumerate((0.1, 0.3, 0.2))]
    results += [result("ours", i, e) for i, e in enumerate((0.15, None, 0.1))]
    results += [result("none", i, e) for i, e in enumerate((None, None, 5.0))]
    lines = markdown(table(results, conditions), conditions).splitlines()
    assert lines[2] == "| a | 0.2000 | **0.1500 (1/3 failed)** | failed (2/3 failed) |"


def test_recordings_without_geometry_or_truth_are_refused_before_anything_runs(recording, tmp_path, experiment):
    for name in ("camera.txt", "groundtruthSync.txt"):
        place = tmp_path / name[:4]
        place.mkdir()
        for other in {"camera.txt", "groundtruthSync.txt", "times.txt"} - {name}:
            (place / other).write_bytes((recording.path / other).read_bytes())
        (place / "images").symlink_to(recording.path / "images")
        with pytest.raises(RecordingError, match=name):
            replace(experiment, recordings={"x": open_recording(place)})


def test_numbers_that_make_no_sense_are_refused(experiment):
    for change in ({"runs": 0}, {"conditions": ()}, {"recordings": {}}, {"end_share": 0.7}):
        with pytest.raises(SettingError):
            replace(experiment, **change)


def test_the_conditions_are_the_papers():
    assert [(c.name, c.mode, c.calibrated, c.metadata_exposures) for c in STANDARD] == [
        ("truth", 0, True, True),
        ("ours", 0, True, True),
        ("joint-wgt", 0, True, True),
        ("joint-wogt", 0, True, True),
        ("none", 2, False, False),
    ]
    assert (AFFINE.mode, AFFINE.calibrated) == (1, False)
    with pytest.raises(SettingError, match="no condition"):
        chosen(["best"])
    for bad in ("truth", "a b", "", "../x"):
        with pytest.raises(SettingError):
            external(bad)


def test_the_truth_can_be_cut_to_its_ends(simulated):
    truth = read_trajectory(simulated / "groundtruthSync.txt")
    ends = end_segments(truth, 0.2)
    np.testing.assert_array_equal(np.flatnonzero(ends.known), [*range(8), *range(32, 40)])


def test_images_are_linked_where_they_can_be_and_written_where_not(recording, tmp_path):
    assert images_of(recording, tmp_path / "cache") == recording.path / "images"
    place = tmp_path / "more"
    place.mkdir()
    for name in ("camera.txt", "times.txt", "groundtruthSync.txt"):
        (place / name).write_bytes((recording.path / name).read_bytes())
    (place / "images").mkdir()
    for image in (recording.path / "images").iterdir():
        (place / "images" / image.name).symlink_to(image)
    (place / "images" / "notes.txt").write_text("not an image")
    written = images_of(open_recording(place), tmp_path / "cache")
    assert written != place / "images"
    assert len(list(written.iterdir())) == 40
    assert images_of(open_recording(place), tmp_path / "cache") == written


def test_a_given_calibration_may_lack_a_vignette(recording, tmp_path, make_program):
    only_response = replace(true_photometry(recording), vignette=None)
    images = images_of(recording, tmp_path / "images")
    command = make_program().command(OdometryInput(recording, images, external("mine"), only_response))
    assert any(word.startswith("gamma=") for word in command)
    assert not any(word.startswith("vignette=") for word in command)
