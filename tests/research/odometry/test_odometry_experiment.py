"""Recordings × conditions × runs: the experiment is complete, resumable, and lists failures in the table."""

from __future__ import annotations

import csv
import json
import pickle
import shutil
from dataclasses import replace

import numpy as np
import pytest

from ospc.errors import NotObservableError, RecordingError, SettingError
from ospc.evaluation.trajectory import AlignmentError
from ospc.formats.opening import open_photometry
from ospc.recording import open_recording
from ospc.research.odometry.experiment import Experiment, RunResult, Tracked, result_of, tasks_of
from ospc.research.odometry.inputs import AFFINE, STANDARD, Calibrations, OdometryInput, chosen, external, images_of
from ospc.research.odometry.report import columns_of, median_table, odometry_report
from ospc.research.runner import ResultStore
from ospc.research.runner import run as run_tasks


@pytest.fixture
def experiment(recording, tmp_path):
    truth = open_photometry(recording.path)
    given = {"ours": truth, "joint-wgt": truth, "mine": truth}
    conditions = (*chosen(["truth", "ours", "none"]), external("mine"))
    return Experiment({"room": recording}, conditions, 2, Calibrations(tmp_path / "c", given), tmp_path / "out")


def calls(tmp_path) -> int:
    place = tmp_path / "calls.txt"
    return len(place.read_text().splitlines()) if place.exists() else 0


def run(experiment, program):
    tasks, failed = tasks_of(experiment, program)
    as_elsewhere = pickle.loads(pickle.dumps(tasks))  # another process would get them like this
    finished = run_tasks(as_elsewhere, ResultStore(experiment.folder / "cache"))
    results = [*failed, *(result_of(one, experiment) for one in finished)]
    return {(r.recording, r.condition.name, r.run): r for r in results}


def test_all_runs_are_made_once_and_found_again(experiment, make_program, tmp_path):
    first = run(experiment, make_program())
    assert calls(tmp_path) == 8
    assert set(first) == {(("room"), name, n) for name in ("truth", "ours", "none", "mine") for n in (0, 1)}
    again = run(experiment, make_program())
    assert calls(tmp_path) == 8
    assert {key: found.error for key, found in again.items()} == {key: found.error for key, found in first.items()}


def test_another_calibration_program_or_number_of_runs_is_run_anew(experiment, make_program, tmp_path):
    run(experiment, make_program())
    before = calls(tmp_path)
    run(replace(experiment, runs=3), make_program())
    assert calls(tmp_path) == before + 4
    run(replace(experiment, runs=1), make_program(arguments=("preset=1",)))
    assert calls(tmp_path) == before + 4 + 4


def test_an_interruption_keeps_finished_results(experiment, make_program, tmp_path):
    tasks, _ = tasks_of(experiment, make_program())
    runs = run_tasks(tasks, ResultStore(experiment.folder / "cache"))
    next(runs)
    runs.close()
    assert calls(tmp_path) == 1
    outcome = run(experiment, make_program())
    assert len(outcome) == 8
    assert calls(tmp_path) <= 8


def test_a_calibration_that_cannot_be_made_is_a_failed_run(experiment, make_program):
    wanting = replace(experiment, conditions=(external("absent"), *chosen(["none"])))
    outcome = run(wanting, make_program())
    assert [outcome["room", name, 0].ending for name in ("absent", "none")] == ["failed", "finished"]
    report = odometry_report(wanting, outcome.values())
    assert any("absent" in note for note in report.notes)
    written = report.write(wanting.folder)
    assert {p.name for p in written} == {
        "runs.csv",
        "results.json",
        "table.md",
        "cumulative.png",
        "trajectories-room.png",
    }
    assert "failed (2/2 failed)" in (wanting.folder / "table.md").read_text()
    content = json.loads((wanting.folder / "results.json").read_text())
    assert content["medians"]["room"]["absent"] == {"median": None, "finished": 0, "runs": 2}
    with (wanting.folder / "runs.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["condition"], row["run"]) for row in rows] == [
        ("absent", "0"),
        ("absent", "1"),
        ("none", "0"),
        ("none", "1"),
    ]
    assert float(rows[2]["e_align"]) == pytest.approx(outcome["room", "none", 0].error)


def test_estimates_are_made_once_and_the_joint_ones_differ_by_an_exponent(recording, tmp_path):
    told = []
    kept = Calibrations(tmp_path / "kept", progress=lambda what, _share: told.append(what))
    wgt, wogt = (kept.of(recording, condition) for condition in chosen(["joint-wgt", "joint-wogt"]))
    assert len(told) == 40
    again = kept.of(recording, chosen(["joint-wgt"])[0])
    assert len(told) == 40
    np.testing.assert_array_equal(again.response.inverse_table, wgt.response.inverse_table)
    greys = np.linspace(0.3, 0.9, 7)
    logs = [np.log(one.response.inverse(greys)) for one in (wgt, wogt)]
    assert np.ptp(logs[0] / logs[1]) < 0.02


def result(name: str, run: int, error: float | None) -> RunResult:
    (condition,) = chosen([name])
    if error is None:
        return RunResult("room", condition, run, Tracked(None), "lost")
    errors = AlignmentError(e_align=error, e_s=1.0, e_r_deg=0.0, rmse=0.0, poses=1, first=1, second=1, unmatched=0)
    return RunResult("room", condition, run, Tracked(None), "finished", errors=errors)


def test_the_table_has_medians_the_lowest_marked_and_says_how_many_failed(experiment):
    conditions = chosen(["truth", "ours", "none"])
    errors = {"truth": (0.1, 0.3, 0.2), "ours": (0.15, None, 0.1), "none": (None, None, 5.0)}
    results = [result(c, n, e) for c, some in errors.items() for n, e in enumerate(some)]
    table = median_table(columns_of(replace(experiment, conditions=conditions), results))
    assert table.rows == (("room", "0.2000", "0.1500 (1/3 failed)", "failed (2/3 failed)"),)
    assert table.best == {(0, 2)}


def test_recordings_without_geometry_or_truth_are_refused_before_anything_runs(recording, tmp_path, experiment):
    for name in ("camera.txt", "groundtruthSync.txt"):
        place = tmp_path / name[:4]
        place.mkdir()
        for other in {"camera.txt", "groundtruthSync.txt", "times.txt"} - {name}:
            (place / other).write_bytes((recording.path / other).read_bytes())
        (place / "images").symlink_to(recording.path / "images")
        with pytest.raises(RecordingError, match=name):
            replace(experiment, recordings={"x": open_recording(place)})


def test_a_truth_that_determines_no_drift_is_refused_before_anything_runs(recording, tmp_path, experiment):
    shutil.copytree(recording.path, tmp_path / "room")
    truth = tmp_path / "room" / "groundtruthSync.txt"
    rows = [line.split() for line in truth.read_text().splitlines()]
    known = [row if number in (0, 1) else [row[0], *7 * ["nan"]] for number, row in enumerate(rows)]
    truth.write_text("".join(" ".join(row) + "\n" for row in known))
    with pytest.raises(NotObservableError, match="determines no drift: first half"):
        replace(experiment, recordings={"x": open_recording(tmp_path / "room")})


def test_numbers_that_make_no_sense_are_refused(experiment):
    for change in ({"runs": 0}, {"conditions": ()}, {"recordings": {}}):
        with pytest.raises(SettingError):
            replace(experiment, **change)


def test_the_conditions_are_the_papers():
    assert [(c.name, c.mode, c.calibrated) for c in STANDARD] == [
        ("truth", 0, True),
        ("paper", 0, True),
        ("ours", 0, True),
        ("joint-wgt", 0, True),
        ("joint-wogt", 0, True),
        ("none", 2, False),
    ]
    assert (AFFINE.mode, AFFINE.calibrated) == (1, False)
    with pytest.raises(SettingError, match="no condition"):
        chosen(["best"])
    for bad in ("truth", "a b", "", "../x"):
        with pytest.raises(SettingError):
            external(bad)


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
    only_response = replace(open_photometry(recording.path), vignette=None)
    images = images_of(recording, tmp_path / "images")
    command = make_program().command(OdometryInput.of(recording, images, external("mine"), only_response))
    assert any(word.startswith("gamma=") for word in command)
    assert not any(word.startswith("vignette=") for word in command)
