"""Commands pass reading options on to the readers."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "recording"))
from bag_samples import FLIR, floats, images, metadata, write_bag1

from command_line import leave_out, ospc
from ospc.recording import open_recording
from ospc.simulation import SimulationSettings, simulate

SIZE = (64, 48)
FRAMES = [cv2.resize(np.random.default_rng(i).integers(0, 255, (6, 8), np.uint8), SIZE) for i in range(4)]

run = ospc


@pytest.fixture(autouse=True)
def nothing_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    leave_out(monkeypatch, "draw", "report")


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    sent = metadata([{"exposure_time": 1000 * 2**i, "gain": 6.0206} for i in range(4)], FLIR, "/cam/meta")
    colour = [np.stack([frame, frame // 2, frame // 4], axis=2) for frame in FRAMES]
    return write_bag1(
        tmp_path / "made",
        images(FRAMES) + images(colour, "/other/image", encoding="bgr8") + floats([3.0] * 4, "/x/number") + sent,
    )


@pytest.mark.parametrize("command", ["calibrate", "check"])
def test_topics_are_listed_with_their_content(command: str, bag: Path) -> None:
    result = run(command, bag, "--list-topics")
    assert result.exit_code == 0, result.output
    lines = {line.split()[0]: line.split()[1:] for line in result.stdout.splitlines() if line.startswith("/")}
    assert lines["/cam/image_raw"] == ["│", "sensor_msgs/msg/Image", "│", "4", "│", "images"]
    assert lines["/cam/meta"][-1] == "exposures"
    assert lines["/x/number"][-1] == "│"


def converted(bag: Path, out: Path, *options: object) -> list[np.ndarray]:
    result = run("convert", bag, "-o", out, *options)
    assert result.exit_code == 0, (result.output, result.exception)
    return [frame.image for frame in open_recording(out)]


def test_options_that_cannot_apply_are_refused(tmp_path: Path) -> None:
    simulate(tmp_path / "r", SimulationSettings(size=(64, 48), frames=3))
    for option in ("--image-topic", "--exposure-topic", "--exposure-field", "--gain-field"):
        assert f"leave out {option}" in str(run("check", tmp_path / "r", option, "/x").exception)
    assert "has no gains" in str(run("check", tmp_path / "r", "--gain-unit", "db").exception)
    for file in (tmp_path / "r" / "images").iterdir():
        cv2.imwrite(str(file), np.full((48, 64, 3), (20, 90, 160), np.uint8))
    assert "not a Bayer mosaic" in str(run("check", tmp_path / "r", "--bayer", "rggb").exception)


def test_topic_field_unit_and_channel_reach_the_reader(bag: Path, tmp_path: Path) -> None:
    np.testing.assert_array_equal(converted(bag, tmp_path / "a"), FRAMES)
    assert open_recording(tmp_path / "a").exposures_ms == pytest.approx([2, 4, 8, 16])
    options = ("--topic", "/other/image", "--channel", "green", "--exposure-topic", "/cam/meta")
    green = converted(bag, tmp_path / "b", *options, "--exposure-field", "exposure_time", "--exposure-unit", "100us")
    np.testing.assert_array_equal(green, np.array(FRAMES) // 2)
    assert open_recording(tmp_path / "b").exposures_ms == pytest.approx([100, 200, 400, 800])
    converted(bag, tmp_path / "c", "--gain-unit", "none")
    assert open_recording(tmp_path / "c").exposures_ms == pytest.approx([1, 2, 4, 8])


def test_mask_and_region_are_recorded_in_the_result(bag: Path, tmp_path: Path) -> None:
    mask = np.full(SIZE[::-1], 255, np.uint8)
    mask[:24] = 0
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    result = run("calibrate", bag, "-o", tmp_path / "out", "--mask", tmp_path / "mask.png", "--json")
    assert any("50% of every image is masked" in note for note in json.loads(result.stdout)["notes"]), result.output
    result = run("calibrate", bag, "-o", tmp_path / "out2", "--roi", "0,0,64,12", "--json")
    assert any("75% of every image is masked" in note for note in json.loads(result.stdout)["notes"]), result.output


def test_each_channel_is_calibrated_on_its_own(bag: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    options = ("--topic", "/other/image", "--exposure-topic", "/cam/meta", "--channel", "each", "--json")
    told = json.loads(run("calibrate", bag, "-o", out, *options).stdout)
    assert set(told["cameras"]) == {"red", "green", "blue"}
    assert told["relative_scale"] is None
    assert not (out / "rig.json").exists()
    for name, cameras in told["cameras"].items():
        assert any(f"the {name} channel of colour images is used" in note for note in cameras["notes"])
        assert (out / name / "calibration.json").is_file()
    assert run("check", bag, "--channel", "each").exit_code == 2


@pytest.mark.parametrize(
    "options",
    [
        ("--roi", "1,2"),
        ("--channel", "ultraviolet"),
        ("--bayer", "abcd"),
        ("--exposure-unit", "h"),
        ("--gain-unit", "m"),
        ("--kind", "papyrus"),
    ],
)
@pytest.mark.parametrize("command", ["calibrate", "check", "convert"])
def test_wrong_usage(command: str, options: tuple[str, str], bag: Path, tmp_path: Path) -> None:
    out = () if command == "check" else ("-o", tmp_path / "out")
    assert run(command, bag, *out, *options).exit_code == 2
    assert not (tmp_path / "out").exists()


def test_a_missing_output_folder_is_wrong_usage(bag: Path) -> None:
    result = run("calibrate", bag)
    assert result.exit_code == 2
    assert "--out" in result.output


@pytest.mark.parametrize("camera", ["opencv:0", "realsense", "depthai:left"])
@pytest.mark.parametrize(
    "options", [["calibrate", "-o", "out"], ["calibrate", "-o", "out", "--all-cameras"], ["check"]]
)
def test_cameras_are_recognised_where_a_recording_is_needed(camera: str, options: list[str]) -> None:
    error = str(run(*options, camera).exception)
    assert f"{camera}: is a camera, not a recording" in error
    assert f"'ospc live {camera} -o OUT'" in error
    assert f"'ospc record {camera} -o OUT'" in error
