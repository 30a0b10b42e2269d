"""``ospc merge`` as a user calls it."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from ospc.cli.merge import command
from ospc.errors import FormatError, SettingError
from ospc.formats.dso import read_pcalib, read_vignette
from ospc.photometry.calibration import Calibration
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette
from ospc.pooling.pool import Pool
from summaries import CAMERA, OTHER_LENS, SIZE, summary


@pytest.fixture(scope="module")
def states(tmp_path_factory):
    """Output folders of four recordings, the last of another lens."""
    place = tmp_path_factory.mktemp("states")
    folders = []
    for number, camera in enumerate((CAMERA, CAMERA, CAMERA, OTHER_LENS)):
        folder = place / str(number)
        folder.mkdir()
        Pool.of([summary(camera, number)]).save(folder / "state.ospc")
        folders.append(folder)
    return folders


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch):
    monkeypatch.setattr("ospc.output.PICTURES", ())


def run(*arguments):
    return CliRunner().invoke(command, [str(a) for a in arguments])


def test_the_output_is_that_of_a_calibration_and_can_be_merged_again(states, tmp_path):
    result = run(*states[:2], "-o", tmp_path / "two")
    assert result.exit_code == 0, result.output
    assert "from 2 recordings" in result.stdout
    assert read_pcalib(tmp_path / "two" / "pcalib.txt").inverse_table.size == 256
    assert read_vignette(tmp_path / "two" / "vignette.png").size == SIZE
    run(tmp_path / "two", states[2] / "state.ospc", states[0], "-o", tmp_path / "three")
    run(*reversed(states[:3]), "-o", tmp_path / "at_once")
    for name in ("calibration.json", "state.ospc", "vignette.png"):
        assert (tmp_path / "three" / name).read_bytes() == (tmp_path / "at_once" / name).read_bytes()


def test_another_lens_is_warned_of_even_when_quiet(states, tmp_path):
    result = run(*states, "-o", tmp_path / "out", "--quiet")
    assert result.exit_code == 0
    assert result.stdout == ""
    assert "warning: recording 3 differs from the others: V at radius" in result.stderr
    assert Calibration.load(tmp_path / "out").source["differing"][0]["name"] == "recording 3"


def test_what_is_not_agreed_on_is_exit_code_3(states, tmp_path):
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
    assert "nothing aligned" in run(*states[:3], "-o", tmp_path / "out", "--truth", tmp_path / "truth.json").stdout


def test_wrong_input_is_one_line_and_writes_nothing(states, tmp_path):
    assert run("-o", tmp_path / "out").exit_code == 2
    assert isinstance(run(tmp_path / "none", "-o", tmp_path / "out").exception, FormatError)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    assert isinstance(run(states[0], "-o", tmp_path / "full").exception, SettingError)
    assert not (tmp_path / "out").exists()
