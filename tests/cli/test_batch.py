from __future__ import annotations

import json
import os
import shutil
import signal
import time
from functools import partial

import pytest

from batch_recordings import QUICK, Pretending, simulated, variant
from command_line import leave_out, ospc
from ospc.errors import RecordingError
from ospc.simulation import SimulationSettings, simulate

SETTINGS = [part for name, value in QUICK for part in ("--set", f"{name}={value}")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with two recordings of one camera."""
    place = tmp_path_factory.mktemp("data")
    first = simulated(place / "A" / "r0", 0)
    variant(first, place / "A" / "r1", 1.5)
    return place


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch):
    """Run in this process: starting others takes seconds and is tested elsewhere."""
    monkeypatch.setattr("ospc.batch.work.on_this_machine", lambda tasks, processes: Pretending()(tasks))


@pytest.fixture
def undrawn(monkeypatch):
    leave_out(monkeypatch, "report")


run = partial(ospc, "batch")


def test_a_folder_becomes_a_page_a_table_and_calibrations(folder, tmp_path):
    result = run(folder, "-o", tmp_path / "out", *SETTINGS)
    assert result.exit_code == 3, result.output
    assert "2 of 2 recordings processed (0 of them before), 0 failed" in result.stdout
    assert "0 of 1 camera fully calibrated" in result.stdout
    assert result.stderr.startswith(
        "incomplete: A: response is marginal: typical irradiance ratios are known to within "
    )
    assert "; vignette is not identifiable: the vignette is known only to within " in result.stderr
    names = {place.name for place in (tmp_path / "out").iterdir()}
    assert names == {"batch.json", "batch.csv", "index.html", "cameras", "recordings"}
    for name in ("calibration.json", "report.html"):
        assert (tmp_path / "out" / "cameras" / "A" / name).exists()
    assert 'href="cameras/A/report.html"' in (tmp_path / "out" / "index.html").read_text()
    again = run(folder, "-o", tmp_path / "out", *SETTINGS)
    assert "(2 of them before)" in again.stdout


@pytest.mark.usefixtures("undrawn")
def test_a_camera_of_which_nothing_is_learned_gives_exit_code_3(tmp_path):
    simulated(tmp_path / "data" / "black", 0, exposures_ms=(1e-6,))
    result = run(tmp_path / "data", "-o", tmp_path / "out", *SETTINGS)
    assert result.exit_code == 3
    assert "data: nothing could be learned from its recordings" in result.stderr
    assert "calibrated" not in result.stdout.replace("0 of 1 camera fully calibrated", "")


@pytest.mark.usefixtures("undrawn")
def test_complete_cameras_give_exit_code_0(folder, tmp_path, monkeypatch):
    monkeypatch.setattr("ospc.photometry.calibration.Calibration.complete", True)
    result = run(folder, "-o", tmp_path / "out", *SETTINGS)
    assert result.exit_code == 0, result.output
    assert "1 of 1 camera fully calibrated" in result.stdout


@pytest.mark.usefixtures("undrawn")
def test_failures_are_reported_with_exit_code_4(folder, tmp_path):
    (tmp_path / "m.csv").write_text(f"recording,camera\n{folder / 'A' / 'r0'},X\nnone,X\n")
    result = run(tmp_path / "m.csv", "-o", tmp_path / "out", *SETTINGS)
    assert result.exit_code == 4
    assert f"failed: {tmp_path / 'none'}: " in result.stderr
    assert "(tried 2 times)" in result.stderr
    quiet = run(tmp_path / "m.csv", "-o", tmp_path / "out", *SETTINGS, "--quiet", "--retries", "0")
    assert quiet.stderr.startswith(f"failed: {tmp_path / 'none'}: ")
    assert not quiet.stdout
    result = run(tmp_path / "m.csv", "-o", tmp_path / "out", *SETTINGS, "--json", "--retries", "0")
    content = json.loads(result.stdout)
    assert (content["exit_code"], content["done"], len(content["failed"])) == (4, 1, 1)
    assert content["cameras"]["X"]["failed"] == 1


@pytest.mark.parametrize(
    "options",
    [
        ["--jobs", "2", "--scheduler", "tcp://x:1"],
        ["--set", "rounds"],
        ["--set", "foo=1"],
        ["--jobs", "0"],
        ["--retries", "-1"],
    ],
)
def test_wrong_usage_is_exit_code_2_and_writes_nothing(folder, tmp_path, options):
    assert run(folder, "-o", tmp_path / "out", *options).exit_code == 2
    assert not (tmp_path / "out").exists()


def test_an_empty_folder_is_a_one_line_error(tmp_path):
    (tmp_path / "empty").mkdir()
    result = run(tmp_path / "empty", "-o", tmp_path / "out")
    assert isinstance(result.exception, RecordingError)
    assert "no recordings there" in str(result.exception)


@pytest.mark.usefixtures("undrawn")
def test_folders_without_a_recording_are_named_with_the_reason(folder, tmp_path):
    for name in ("empty", "notes/deep"):
        (tmp_path / "data" / name).mkdir(parents=True)
    (tmp_path / "data" / "notes" / "deep" / "readme.txt").write_text("no recording")
    (tmp_path / "data" / "A").symlink_to(folder / "A" / "r0")
    result = run(tmp_path / "data", "-o", tmp_path / "out", *SETTINGS)
    assert result.exit_code == 3, result.output
    said = [line for line in result.stderr.splitlines() if line.startswith("left out: ")]
    assert said == [
        f"left out: {tmp_path / 'data' / 'empty'}: the folder is empty",
        f"left out: {tmp_path / 'data' / 'notes'}: has no images",
    ]
    assert (
        len(json.loads(run(tmp_path / "data", "-o", tmp_path / "out", *SETTINGS, "--json").stdout)["left_out"]) == 2
    )


@pytest.mark.usefixtures("undrawn")
def test_a_recording_of_another_size_is_left_out_and_named(folder, tmp_path):
    shutil.copytree(folder / "A" / "r0", tmp_path / "data" / "r0")
    simulate(tmp_path / "data" / "r1", SimulationSettings(size=(96, 64), frames=20, exposure="cycle"))
    result = run(tmp_path / "data", "-o", tmp_path / "out", *SETTINGS)
    assert "0 of 1 camera fully calibrated" in result.stdout
    assert "r1 contradicts others of data: another camera or mode: " in result.stderr
    assert (tmp_path / "out" / "cameras" / "data" / "calibration.json").exists()


@pytest.mark.usefixtures("undrawn")
def test_an_interruption_ends_the_wait_for_an_answer(folder, tmp_path, monkeypatch):
    def stuck(tasks, processes):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(60)
        yield

    monkeypatch.setattr("ospc.batch.work.on_this_machine", stuck)
    begun_s = time.monotonic()
    result = run(folder, "-o", tmp_path / "out", *SETTINGS)
    assert time.monotonic() - begun_s < 30
    assert result.exit_code == 130
    assert "fully calibrated" not in result.stdout
    assert "run the same command again to continue" in result.stdout
