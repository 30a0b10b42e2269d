"""Batches account for every recording, repeat no work, and report failures without stopping."""

from __future__ import annotations

import csv
import json
import os
import shutil
from functools import partial

import numpy as np
import pytest

import ospc.batch.work as module
from batch_recordings import QUICK, Pretending, simulated, variant
from command_line import leave_out
from ospc.batch.manifest import Entry
from ospc.batch.run import run_batch
from ospc.batch.store import Store
from ospc.batch.work import Task, on_this_machine, work
from ospc.errors import FormatError, SettingError
from ospc.photometry.calibration import Calibration
from ospc.pooling.pool import Pool
from ospc.state import container


@pytest.fixture(scope="module", autouse=True)
def nothing_drawn():
    with pytest.MonkeyPatch.context() as patch:
        leave_out(patch, "report")
        yield


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Four recordings of two cameras, and one with invalid image files."""
    place = tmp_path_factory.mktemp("recordings")
    first = simulated(place / "A" / "r0", 0)
    for number in (1, 2, 3):
        variant(first, place / "AAB"[number - 1] / f"r{number}", 1 + number / 10)
    corrupt = place / "B" / "corrupt"
    shutil.copytree(first, corrupt)
    for image in (corrupt / "images").iterdir():
        image.write_bytes(b"nothing")
    return place


@pytest.fixture(scope="module")
def entries(recordings):
    names = ("A/r0", "A/r1", "A/r2", "B/r3", "B/corrupt", "B/missing")
    return [Entry(str(recordings / name), name[0], QUICK) for name in names]


@pytest.fixture(scope="module")
def done(entries, tmp_path_factory):
    out = tmp_path_factory.mktemp("done") / "out"
    return run_batch(entries, out, Pretending()), out


def statuses(out):
    with (out / "batch.csv").open(newline="") as stream:
        return [row["status"] for row in csv.DictReader(stream)]


def results(out):
    return {place.name: place.read_bytes() for place in sorted((out / "recordings").rglob("*.ospc"))}


def test_every_recording_has_a_row_and_failures_their_reason(done):
    outcome, out = done
    assert [row.status for row in outcome.rows] == ["done"] * 4 + ["failed"] * 2
    corrupt, missing = outcome.failed
    assert "corrupt" in corrupt.error
    assert "there is no such file or folder" in missing.error
    assert missing.attempts == 2
    assert statuses(out) == [row.status for row in outcome.rows]
    assert "Failed: 2" in (out / "index.html").read_text()
    assert json.loads((out / "batch.json").read_text())["failed"] == 2


def test_sigma_of_a_response_is_that_at_measured_grey_levels(done):
    outcome, out = done
    store = Store(out / "recordings")
    for row in outcome.rows[:4]:
        response = store.get(row.key).calibration.response
        measured = np.interp(np.linspace(*response.support, 1000), response.levels, response.inverse_sigma)
        assert row.response_sigma == pytest.approx(measured.max(), rel=0.05)
        assert row.response_sigma < response.inverse_sigma.max()


def test_recordings_of_a_camera_are_merged(done, entries):
    outcome, out = done
    assert [(camera.name, camera.recordings, camera.failed) for camera in outcome.cameras] == [
        ("A", 3, 0),
        ("B", 3, 2),
    ]
    found = Calibration.load(out / "cameras" / "A")
    assert found.source["name"] == "A"
    assert len(Pool.load(out / "cameras" / "A")) == 3
    assert found.counts["recordings"] == 3


def test_processes_give_the_same_bytes(done, entries, tmp_path):
    outcome = run_batch(entries, tmp_path / "out", partial(on_this_machine, processes=2), retries=0)
    assert results(tmp_path / "out") == results(done[1])
    same = [
        (a.recording, a.status, a.key, a.error, a.samples) == (b.recording, b.status, b.key, b.error, b.samples)
        for a, b in zip(outcome.rows, done[0].rows, strict=True)
    ]
    assert all(same)


def test_finished_recordings_are_recognised_after_moving_or_touching(recordings, entries, tmp_path):
    runner = Pretending()
    run_batch(entries[:2], tmp_path / "out", runner)
    assert runner.asked == [("calibrate", "r0"), ("calibrate", "r1")]
    moved = tmp_path / "moved"
    shutil.copytree(recordings / "A" / "r0", moved)
    os.utime(moved / "times.txt", (0, 0))
    again = Pretending()
    outcome = run_batch([Entry(str(moved), "A", QUICK), *entries[1:3]], tmp_path / "out", again)
    assert [name for what, name in again.asked if what == "calibrate"] == ["r2"]
    assert [row.attempts for row in outcome.rows] == [0, 0, 1]


@pytest.mark.parametrize("change", ["settings", "exposures", "an image", "a damaged result"])
def test_a_changed_recording_or_setting_is_processed_again(recordings, tmp_path, change):
    place = tmp_path / "r"
    shutil.copytree(recordings / "A" / "r0", place)
    entry = Entry(str(place), "A", QUICK)
    run_batch([entry], tmp_path / "out", Pretending())
    if change == "settings":
        entry = Entry(str(place), "A", (*QUICK, ("max_points", "100")))
    elif change == "exposures":
        times = place / "times.txt"
        times.write_text(times.read_text().rstrip() + ".5\n")
    elif change == "an image":
        image = sorted((place / "images").iterdir())[1]
        image.write_bytes(image.read_bytes() + b"\0")
    else:
        (result,) = (tmp_path / "out" / "recordings").rglob("*.ospc")
        result.write_bytes(result.read_bytes()[:-1])
    runner = Pretending()
    outcome = run_batch([entry], tmp_path / "out", runner)
    assert ("calibrate", "r") in runner.asked
    assert outcome.rows[0].status == "done"


def test_a_camera_of_which_nothing_is_learned_any_more_has_no_earlier_result(recordings, tmp_path):
    place, camera = tmp_path / "r", tmp_path / "out" / "cameras" / "A"
    shutil.copytree(recordings / "A" / "r0", place)
    entry = Entry(str(place), "A", QUICK)
    run_batch([entry], tmp_path / "out", Pretending())
    (camera / "notes.txt").write_text("mine")
    run_batch([entry], tmp_path / "out", Pretending(failing={"r": 9}))
    assert (camera / "calibration.json").exists()
    lines = [line.split() for line in (place / "times.txt").read_text().splitlines() if line[:1] != "#"]
    (place / "times.txt").write_text("".join(f"{number} {stamp} 1\n" for number, stamp, _ in lines))
    missing = [entry, Entry(str(tmp_path / "missing"), "A", QUICK)]
    assert "nothing could be learned" in run_batch(missing, tmp_path / "out", Pretending()).cameras[0].error
    assert (camera / "calibration.json").exists()
    run_batch([entry], tmp_path / "out", Pretending())
    assert [file.name for file in camera.iterdir()] == ["notes.txt"]


def test_failures_are_tried_again_after_all_others(entries, tmp_path):
    runner = Pretending(failing={"r0": 1, "r1": 9})
    outcome = run_batch(entries[:3], tmp_path / "out", runner, retries=2)
    assert [name for _, name in runner.asked] == ["r0", "r1", "r2", "r0", "r1", "r1"]
    assert [(row.status, row.attempts) for row in outcome.rows] == [("done", 2), ("failed", 3), ("done", 1)]
    assert outcome.rows[1].error == "r1 is torn"


def test_interrupted_it_writes_what_is_done_and_goes_on_later(entries, tmp_path):
    def stop(stage, done, _total, _failed):
        if stage == "calibrating" and done == 2:
            raise KeyboardInterrupt

    outcome = run_batch(entries[:4], tmp_path / "out", Pretending(), progress=stop)
    assert outcome.interrupted
    assert [row.status for row in outcome.rows] == ["done", "done", "not done", "not done"]
    assert "2 recordings not done yet" in (tmp_path / "out" / "index.html").read_text()
    runner = Pretending()
    outcome = run_batch(entries[:4], tmp_path / "out", runner)
    assert [name for what, name in runner.asked if what == "calibrate"] == ["r2", "r3"]
    assert {row.status for row in outcome.rows} == {"done"}


def test_finished_results_are_written_and_reported_if_the_workers_are_lost(entries, tmp_path):
    class Lost(Pretending):
        def __call__(self, tasks):
            for number, answer in enumerate(super().__call__(tasks)):
                if number == 2:
                    raise SettingError("the scheduler is lost")
                yield answer

    with pytest.raises(SettingError, match="the scheduler is lost"):
        run_batch(entries[:4], tmp_path / "out", Lost())
    assert statuses(tmp_path / "out") == ["done"] * 2 + ["not done"] * 2


def test_without_workers_nothing_is_written(entries, tmp_path):
    class Absent(Pretending):
        def __call__(self, tasks):
            raise SettingError("no scheduler answers")
            yield

    with pytest.raises(SettingError, match="no scheduler answers"):
        run_batch(entries[:4], tmp_path / "out", Absent())
    assert not (tmp_path / "out").exists()


def test_a_batch_whose_last_files_are_missing_goes_on(done, entries, tmp_path):
    _, out = done
    copy = tmp_path / "copy"
    for missing in ("batch.json", "batch.csv"):
        shutil.copytree(out, copy, dirs_exist_ok=missing != "batch.json")
        for name in {"batch.json", missing}:
            (copy / name).unlink()
        run_batch(entries, copy, Pretending())
        assert (copy / "index.html").read_bytes() == (out / "index.html").read_bytes()


def test_other_folders_and_batches_of_other_versions_are_refused(entries, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("all of it")
    with pytest.raises(SettingError, match="something other than an earlier batch"):
        run_batch(entries[:1], tmp_path / "mine", Pretending())
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "batch.json").write_text('{"schema": "ospc-batch/0"}')
    with pytest.raises(SettingError, match=r"a batch of another version .*ospc-batch/0"):
        run_batch(entries[:1], tmp_path / "old", Pretending(), force=True)
    with pytest.raises(SettingError, match="is a file"):
        run_batch(entries[:1], tmp_path / "old" / "batch.json", Pretending())


def test_results_of_other_versions_are_made_again(done, entries, tmp_path):
    shutil.copytree(done[1], tmp_path / "out")
    for place in (tmp_path / "out" / "recordings").rglob("*.ospc"):
        found = container.from_bytes(place.read_bytes(), "it")
        container.save(container.Container(found.kind, 0, found.content, found.arrays), place)
    runner = Pretending()
    run_batch(entries[:2], tmp_path / "out", runner)
    assert [name for what, name in runner.asked if what == "calibrate"] == ["r0", "r1"]


def test_a_result_of_another_request_is_refused(tmp_path):
    class Lying(Pretending):
        def __call__(self, tasks):
            for answer in super().__call__(tasks):
                yield type(answer)(answer.number, "0" * 64, answer.result)

    place = simulated(tmp_path / "r", 1, frames=2)
    with pytest.raises(FormatError, match="is not the requested one"):
        run_batch([Entry(str(place), "A", QUICK)], tmp_path / "out", Lying())


def test_one_process_that_dies_takes_only_its_own_task(recordings, tmp_path, entries):
    deadly = tmp_path / "deadly"
    shutil.copytree(recordings / "A" / "r0", deadly)
    (tmp_path / "sitecustomize.py").write_text(
        "import os, ospc.batch.work as w\n"
        "before = w.open_recording\n"
        "def dying(path, *a):\n"
        "    if path.name == 'deadly': os.kill(os.getpid(), 9)\n"
        "    return before(path, *a)\n"
        "w.open_recording = dying\n"
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join(filter(None, (str(tmp_path), os.environ.get("PYTHONPATH")))))
        tasks = [Task(0, Entry(str(deadly), "A", QUICK)), *(Task(n, entry) for n, entry in enumerate(entries[:3], 1))]
        answers = {answer.number: answer for answer in on_this_machine(tasks, 2)}
    assert answers[0].error == "the process that worked on it died (SIGKILL, perhaps out of memory)"
    assert all(answers[number].result for number in (1, 2, 3))


def test_equal_work_gives_equal_bytes(entries):
    assert work(Task(0, entries[0])).result == work(Task(7, entries[0])).result


def test_a_recording_that_changes_while_it_is_read_has_no_result(recordings, tmp_path, monkeypatch):
    place = tmp_path / "moving"
    shutil.copytree(recordings / "A" / "r0", place)
    calibrated = module._calibrated

    def losing_an_image(*arguments):
        sorted((place / "images").iterdir())[-1].unlink()
        return calibrated(*arguments)

    monkeypatch.setattr(module, "_calibrated", losing_an_image)
    answer = work(Task(0, Entry(str(place), "A", QUICK)))
    assert "changed meanwhile" in answer.error
    assert not answer.result
