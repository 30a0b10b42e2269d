from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from itertools import islice

import numpy as np
import pytest

from command_line import leave_out, ospc
from ospc.calibrator import OnlineCalibrator
from ospc.errors import FormatError, SettingError
from ospc.formats.dso import read_pcalib, read_vignette
from ospc.photometry.calibration import Calibration
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette
from ospc.pooling.pool import Pool
from ospc.recording import Frame, open_recording
from ospc.simulation import SimulationSettings, simulate
from summaries import CAMERA, OTHER_LENS, SIZE, summary


@pytest.fixture(scope="module")
def states(tmp_path_factory):
    """Output folders of four recordings, the last with another lens."""
    place = tmp_path_factory.mktemp("states")
    folders = []
    for number, camera in enumerate((CAMERA, CAMERA, CAMERA, OTHER_LENS)):
        folder = place / str(number)
        folder.mkdir()
        Pool.of([summary(camera, number)]).save(folder / "state.ospc")
        folders.append(folder)
    return folders


@pytest.fixture(autouse=True)
def nothing_drawn(monkeypatch):
    leave_out(monkeypatch, "draw", "report")


run = partial(ospc, "merge")


def test_the_output_has_the_files_of_a_calibration_and_can_be_merged_again(states, tmp_path):
    result = run(*states[:2], "-o", tmp_path / "two")
    assert result.exit_code == 0, result.output
    assert "from 2 recordings" in result.stdout
    assert read_pcalib(tmp_path / "two" / "pcalib.txt").inverse_table.size == 256
    assert read_vignette(tmp_path / "two" / "vignette.png").size == SIZE
    run(tmp_path / "two", states[2] / "state.ospc", states[0], "-o", tmp_path / "three")
    run(*reversed(states[:3]), "-o", tmp_path / "at_once")
    for name in ("calibration.json", "state.ospc", "vignette.png"):
        assert (tmp_path / "three" / name).read_bytes() == (tmp_path / "at_once" / name).read_bytes()


def test_a_recording_given_twice_counts_once_with_a_note(states, tmp_path):
    result = run(*states[:2], states[0], "-o", tmp_path / "out")
    assert "from 2 recordings" in result.stdout
    assert "1 of 3 states left out, because each recording counts once" in result.output


def test_another_lens_gives_a_warning_even_if_quiet(states, tmp_path):
    result = run(*states, "-o", tmp_path / "out", "--quiet")
    assert result.exit_code == 0
    assert result.stdout == ""
    assert "warning: recording 3 differs from the others: the vignette at radius" in result.stderr
    assert Calibration.load(tmp_path / "out").source["differing"][0]["name"] == "recording 3"


def test_a_state_without_observations_is_left_out_with_a_warning(states, tmp_path):
    empty = tmp_path / "empty"
    empty.mkdir()
    calibrator = OnlineCalibrator()
    calibrator.push(Frame.of_array(np.full(SIZE[::-1], 90, np.uint8), 5.0))
    calibrator.save_state(empty / "state.ospc", complete=True)
    result = run(states[0], empty, states[1], "-o", tmp_path / "out")
    assert "from 2 recordings" in result.stdout
    assert f"warning: {empty} was left out: no response could be fitted to this recording alone" in result.stderr
    assert json.loads(run(states[0], empty, "-o", tmp_path / "one", "--json").stdout)["left_out"] == [str(empty)]
    assert "no response could be fitted" in str(run(empty, "-o", tmp_path / "none").exception)


def test_disagreement_gives_exit_code_3(states, tmp_path):
    result = run(states[0], states[3], "-o", tmp_path / "out", "--json")
    content = json.loads(result.stdout)
    assert result.exit_code == content["exit_code"] == 3
    assert {d["name"] for d in content["differing"]} == {"recording 0", "recording 3"}
    assert not (tmp_path / "out" / "vignette.png").exists()


def test_errors_against_a_truth(states, tmp_path):
    truth = Calibration(SIZE, Response.gamma(1.7), PolynomialVignette(SIZE, (-0.3,)))
    truth.save(tmp_path / "truth.json")
    result = run(*states[:3], "-o", tmp_path / "out", "--json", "--truth", tmp_path / "truth.json")
    assert json.loads(result.stdout)["errors"]["response_shape_rmse"] < 0.01
    assert "errors against" in run(*states[:3], "-o", tmp_path / "out", "--truth", tmp_path / "truth.json").stdout


def test_wrong_input_is_a_one_line_error_and_writes_nothing(states, tmp_path):
    assert run("-o", tmp_path / "out").exit_code == 2
    assert isinstance(run(tmp_path / "none", "-o", tmp_path / "out").exception, FormatError)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    assert isinstance(run(states[0], "-o", tmp_path / "full").exception, SettingError)
    assert not (tmp_path / "out").exists()


def test_the_folder_of_a_state_to_merge_is_refused_as_output(tmp_path):
    for number, place in enumerate((tmp_path / "a", tmp_path / "b")):
        place.mkdir()
        Pool.of([summary(CAMERA, number)]).save(place / "state.ospc")
    before = (tmp_path / "a" / "state.ospc").read_bytes()
    for given in (tmp_path / "a", tmp_path / "a" / "state.ospc"):
        result = run(given, tmp_path / "b", "-o", tmp_path / "b" / ".." / "a", "--force")
        assert isinstance(result.exception, SettingError)
        assert f"contains a state to merge, {given}; choose another folder" in str(result.exception)
    assert (tmp_path / "a" / "state.ospc").read_bytes() == before
    assert not (tmp_path / "a" / "calibration.json").exists()


def test_recordings_of_the_same_name_are_distinguished_by_their_paths(tmp_path):
    folders = [tmp_path / day / "out" for day in ("monday", "tuesday", "friday")]
    for number, (folder, camera) in enumerate(zip(folders, (CAMERA, CAMERA, OTHER_LENS), strict=True)):
        folder.mkdir(parents=True)
        Pool.of([replace(summary(camera, number), name="seq")]).save(folder / "state.ospc")
    result = run(*folders, "-o", tmp_path / "merged")
    assert f"warning: seq ({folders[2]}) differs from the others" in result.stderr
    names = [recording["name"] for recording in Calibration.load(tmp_path / "merged").source["recordings"]]
    assert sorted(names) == sorted(f"seq ({folder})" for folder in folders)
    again = run(folders[0], folders[0] / "state.ospc", "-o", tmp_path / "again")
    assert again.exit_code in (0, 3)
    assert Calibration.load(tmp_path / "again").source["name"] == "seq"


def test_the_frames_of_an_unfinished_run_count(tmp_path):
    settings = SimulationSettings(size=(160, 120), frames=24, exposure="cycle", exposures_ms=(3.0, 6.0, 12.0, 24.0))
    simulate(tmp_path / "r", settings)
    calibrator = OnlineCalibrator()
    for frame in islice(open_recording(tmp_path / "r"), 20):
        calibrator.push(frame)
    calibrator.save_state(tmp_path / "checkpoint.ospc")
    calibrator.save_state(tmp_path / "finished.ospc", complete=True)
    for name in ("checkpoint", "finished"):
        result = run(tmp_path / f"{name}.ospc", "-o", tmp_path / name)
        assert result.exit_code in (0, 3), result.output
        assert "from 1 recording, 20 frames" in result.stdout
    checkpoint, finished = (Pool.load(tmp_path / name).summaries[0] for name in ("checkpoint", "finished"))
    assert checkpoint.key == finished.key
    assert np.allclose(checkpoint.vector, finished.vector)
