"""``ospc evaluate odometry``."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from ospc.cli.evaluate import command
from ospc.errors import SettingError


def run(*words):
    return CliRunner().invoke(command, ["odometry", *map(str, words)])


def test_conditions_and_given_calibrations_are_compared(tiny_room, tmp_path):
    given = f"mine={tiny_room / 'pcalib.txt'},{tiny_room / 'vignette.png'}"
    words = [
        tiny_room,
        "-o",
        tmp_path,
        "--builtin",
        "--runs",
        1,
        "--conditions",
        "truth,none",
        "--calibration",
        given,
    ]
    result = run(*words)
    assert result.exit_code == 0, result.output
    assert "mine" in result.output
    assert "Full truth" in result.output
    again = run(*words, "--json")
    content = json.loads(again.stdout)
    assert set(content["room"]) == {"truth", "none", "mine"}


def test_an_estimated_calibration_can_be_used_in_a_new_folder_but_not_in_a_foreign_one(simulated, tmp_path):
    words = ["--builtin", "--runs", 1, "--conditions", "joint-wogt"]
    result = run(simulated, "-o", tmp_path / "out", *words)
    assert result.exit_code == 0, result.output
    assert "Joint, no truth" in result.output
    (tmp_path / "notes.txt").write_text("mine")
    result = run(simulated, "-o", tmp_path, *words)
    assert "not from an earlier study" in str(result.exception)
    assert {path.name for path in tmp_path.iterdir()} == {"notes.txt", "out"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "give either the path"),
        (["--builtin", "--program", "x"], "give either the path"),
        (["--builtin", "--argument", "preset=0"], "takes no --argument"),
    ],
)
def test_it_wants_a_program_or_the_one_built_in(tiny_room, tmp_path, options, words):
    result = run(tiny_room, "-o", tmp_path / "out", *options)
    assert isinstance(result.exception, SettingError)
    assert words in str(result.exception)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("text", ["mine", "=x", "mine="])
def test_a_calibration_has_a_name_and_files(tiny_room, tmp_path, text):
    result = run(tiny_room, "-o", tmp_path, "--builtin", "--calibration", text)
    assert result.exit_code == 2
    assert "is not NAME=" in result.output
