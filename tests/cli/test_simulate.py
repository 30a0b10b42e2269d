from __future__ import annotations

import json
from functools import partial

import numpy as np
import pytest

from command_line import ospc
from ospc.errors import OspcError, SettingError
from ospc.recording import open_recording

SMALL = ["--frames", "4", "--size", "64x48"]

run = partial(ospc, "simulate")


def test_it_writes_a_recording_and_names_the_files_of_the_truth(tmp_path):
    result = run(tmp_path / "r", *SMALL, "--response", "srgb", "--lag", "1", "--noise", "high")
    assert result.exit_code == 0, result.output
    lines = result.output.strip().splitlines()
    assert "4 frames of 64×48 pixels" in lines[-1]
    assert "truth.json" in lines[-1]
    assert len(open_recording(tmp_path / "r")) == 4
    settings = json.loads((tmp_path / "r" / "truth.json").read_text())["settings"]
    assert (settings["response"], settings["lag"], settings["noise"]) == ("srgb", 1, "high")


def test_it_replaces_only_with_force(tmp_path):
    assert run(tmp_path / "r", *SMALL).exit_code == 0
    before = (tmp_path / "r" / "images" / "00000.png").read_bytes()
    refused = run(tmp_path / "r", *SMALL, "--noise", "high")
    assert isinstance(refused.exception, SettingError)
    assert (tmp_path / "r" / "images" / "00000.png").read_bytes() == before
    assert run(tmp_path / "r", *SMALL, "--noise", "high", "--force").exit_code == 0
    assert (tmp_path / "r" / "images" / "00000.png").read_bytes() != before


def test_exposures_come_from_a_list_a_range_or_a_file(tmp_path):
    def exposures(name, *options):
        result = run(tmp_path / name, *SMALL, *options)
        assert result.exit_code == 0, result.output
        return open_recording(tmp_path / name).exposures_ms

    np.testing.assert_allclose(exposures("a", "--exposure", "cycle", "--exposures", "1,3"), [1, 3, 1, 3])
    np.testing.assert_allclose(exposures("b", "--exposure", "constant", "--exposures", "2.5"), 2.5)
    np.testing.assert_allclose(exposures("c", "--exposure", "sweep", "--exposure-range", 1, 8), [1, 2, 4, 8])
    again = exposures("d", "--exposure", "file", "--exposure-file", tmp_path / "c" / "times.txt")
    np.testing.assert_allclose(again, [1, 2, 4, 8])


@pytest.mark.parametrize(
    ("options", "needed"),
    [
        (["--exposure-file", "times.txt"], "--exposure-file requires --exposure file"),
        (["--exposures", "1,2"], "--exposures requires --exposure cycle or constant"),
        (
            ["--exposure", "cycle", "--exposures", "1,2", "--exposure-range", "1", "2"],
            "--exposure-range requires --exposure auto or sweep",
        ),
        (
            ["--vignette", "cos4", "--vignette-coefficients", "0.1,0,0"],
            "--vignette-coefficients requires --vignette polynomial or decentred",
        ),
    ],
)
def test_an_option_that_the_others_leave_unused_is_an_error(tmp_path, options, needed):
    result = run(tmp_path / "r", *SMALL, *options)
    assert isinstance(result.exception, SettingError)
    assert needed in str(result.exception)
    assert not (tmp_path / "r").exists()


@pytest.mark.parametrize("options", [["--size", "big"], ["--exposures", "1,x"], ["--motion", "flying"]])
def test_wrong_usage_is_explained(tmp_path, options):
    result = run(tmp_path / "r", *options)
    assert result.exit_code == 2
    assert not (tmp_path / "r").exists()


@pytest.mark.parametrize(
    "options",
    [
        ["--frames", "0"],
        ["--response", "nothing"],
        ["--vignette", "nothing"],
        ["--exposure", "file"],
        ["--exposure", "constant", "--exposures", "1,2"],
    ],
)
def test_impossible_settings_are_an_error_and_write_nothing(tmp_path, options):
    result = run(tmp_path / "r", *options)
    assert isinstance(result.exception, SettingError)
    assert not (tmp_path / "r").exists()


def test_wrong_usage_with_force_keeps_the_old_recording(tmp_path):
    run(tmp_path / "r", *SMALL)
    assert isinstance(run(tmp_path / "r", "--response", "nothing", "--force").exception, SettingError)
    assert len(open_recording(tmp_path / "r")) == 4


@pytest.mark.parametrize("content", ["frame,exposure\n0,1.5\n", ",,\n", "", "1\n2\n", "1\n-2\n3\n4\n"])
def test_an_invalid_exposure_file_is_refused(tmp_path, content):
    listed = tmp_path / "exposures.csv"
    listed.write_text(content)
    result = run(tmp_path / "r", *SMALL, "--exposure", "file", "--exposure-file", listed)
    assert isinstance(result.exception, OspcError)
    assert not (tmp_path / "r").exists()
