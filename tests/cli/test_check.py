from __future__ import annotations

import json
import shutil
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "diagnosis"))
from filmed import LARGE, Film, wandering

from command_line import ospc
from ospc.errors import ExposureError, OspcError
from ospc.methods.maximum_likelihood import MaximumLikelihoodMethod
from ospc.recording.writing.conversion import convert_recording
from ospc.settings import DefaultSettings, presets

FRAMES = 60
SIZE = (192, 144)  # large enough to determine the vignette
STATES = ("identifiable", "marginal", "not identifiable")


@pytest.fixture(scope="module", autouse=True)
def pictures() -> None:
    """Render pictures in full."""


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("checked") / "late"
    convert_recording(Film(wandering(FRAMES), lag=2, size=SIZE, speed_px=2.5).recording(), place)
    return place


check = partial(ospc, "check")


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Use fewer points, with which fits take a fraction of the time."""
    monkeypatch.setitem(
        presets.PRESETS, "default", replace(DefaultSettings(), points_per_pair=150, response_intervals=16)
    )


@pytest.mark.usefixtures("quick")
def test_json_is_one_object_and_the_plot_is_written(late: Path, tmp_path: Path) -> None:
    result = check(late, "--json", "--plot", tmp_path / "seen.png")
    assert (result.exit_code, result.stderr) == (0, "")
    said = json.loads(result.stdout)
    assert said["exposure_lag_frames"] == 2
    assert any("2 frames late" in note for note in said["notes"])
    assert list(said["verdicts"]) == ["response", "vignette", "exposures"] == list(said["reasons"])
    assert set(said["verdicts"].values()) <= set(STATES)
    assert (said["recording"]["frames"], said["recording"]["width_px"]) == (FRAMES, SIZE[0])
    picture = cv2.imread(str(tmp_path / "seen.png"))
    assert picture.std() > 10


def test_the_text_has_every_verdict_and_remedy(late: Path) -> None:
    result = check(late, "--frames", 8)
    assert result.exit_code == 3
    words = " ".join(result.stdout.split())
    parts = ("response", "vignette", "exposures", "exposure lag", "8 of them processed", "20 per second", "→", "•")
    for part in parts:
        assert part in words, part


def test_one_frame_has_no_share_of_points_found_again(tmp_path: Path) -> None:
    convert_recording(Film(wandering(1), size=SIZE).recording(), tmp_path / "one")
    assert "nan" not in check(tmp_path / "one").stdout


def test_lags_are_listed_as_in_the_verdict(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # The verdict comes from the brightness of whole frames; comparing points takes most of the time.
    monkeypatch.setattr(MaximumLikelihoodMethod, "push", lambda *_: None)
    steady = Film(np.linspace(-0.6, 0.6, FRAMES), speed_px=0.0)
    convert_recording(steady.recording(), tmp_path / "steady")
    said = " ".join(check(tmp_path / "steady").stdout.split())
    assert "(lags of -5 to 5)" in said, said


@pytest.mark.parametrize("path", ["nowhere", "text.txt", "empty"])
def test_a_path_without_recording_is_a_one_line_error(
    path: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("text.txt").write_text("hello")
    Path("empty").mkdir()
    result = check(path, "--json")
    assert (result.exit_code, result.output) == (1, "")
    assert isinstance(result.exception, OspcError)
    assert str(result.exception).startswith(path)
    assert "\n" not in str(result.exception)


def test_a_plot_that_cannot_be_written_is_a_one_line_error(late: Path, tmp_path: Path) -> None:
    result = check(late, "--frames", 3, "--plot", tmp_path / "no" / "folder.png")
    assert result.exit_code == 1
    assert isinstance(result.exception, OspcError)
    assert f"the folder {tmp_path / 'no'} does not exist; make it" in str(result.exception)
    assert "is a folder; name a file" in str(check(late, "--frames", 3, "--plot", tmp_path).exception)


@pytest.mark.usefixtures("quick")
def test_real_recordings_give_the_expected_result(real_data: Path) -> None:
    # The verdicts are far from their limits, even with fewer points and frames.
    said = json.loads(check(real_data / "borealhdr_left", "--json", "--frames", 48).stdout)
    assert said["exposure_lag_frames"] == 0
    assert said["verdicts"] == {
        "response": "identifiable",
        "vignette": "not identifiable",
        "exposures": "identifiable",
    }
    assert said["exposure"]["cycle_frames"] == 6


def test_missing_exposures_suggest_unknown_exposures(late: Path, tmp_path: Path) -> None:
    shutil.copytree(late, tmp_path / "bare")
    lines = (tmp_path / "bare" / "times.txt").read_text().splitlines()
    for times in ("\n".join(" ".join(line.split()[:2]) for line in lines), None):
        place = tmp_path / "bare" / "times.txt"
        place.unlink() if times is None else place.write_text(times)
        for words in (["check"], ["calibrate", "-o", tmp_path / "out"]):
            result = ospc(words[0], tmp_path / "bare", *words[1:])
            assert isinstance(result.exception, ExposureError)
            assert "'ospc calibrate --unknown-exposures'" in str(result.exception)
    (tmp_path / "bare" / "times.txt").write_text(lines[0])
    assert "--unknown-exposures" not in str(check(tmp_path / "bare").exception)  # it cannot help here


def test_unknown_exposures_are_estimated_and_the_result_is_labelled(tmp_path: Path) -> None:
    # With 60 or 70 frames of this size, V is on the verge of not being identifiable.
    film = Film(wandering(100, step=0.15), size=LARGE, speed_px=2.5)
    convert_recording(film.recording(), tmp_path / "film")
    (tmp_path / "film" / "times.txt").unlink()
    assert "--unknown-exposures" in str(check(tmp_path / "film" / "images").exception)
    result = check(tmp_path / "film" / "images", "--unknown-exposures", "--json")
    assert result.exit_code == 3, result.output
    said = json.loads(result.stdout)
    for name, reason in said["reasons"].items():
        assert said["verdicts"][name] == "marginal"
        assert f"raising {name}, " in reason
