"""Several cameras of one rig, each as a separate recording."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from bag_samples import floats, images, write_bag1
from click.testing import CliRunner
from image_samples import encoded, grey

from ospc.cli.main import cli
from ospc.errors import ExposureError, RecordingError
from ospc.recording import Recording, cameras_of, open_recording
from ospc.recording.kinds import safe_name
from ospc.recording.options import ReadingOptions

SIZE = (64, 48)
MS = {"cam0": [1.0, 2.0, 4.0], "cam1": [3.0, 6.0, 12.0], "cam10": [5.0, 10.0, 20.0]}


def frame(camera: str, index: int) -> np.ndarray:
    return grey(100 * list(MS).index(camera) + index, SIZE)


def euroc(place: Path) -> Path:
    for camera, ms in MS.items():
        folder = place / "mav0" / camera
        (folder / "data").mkdir(parents=True)
        for i in range(3):
            (folder / "data" / f"{10**18 + i * 10**8}.png").write_bytes(encoded(frame(camera, i)))
        rows = "".join(f"{10**18 + i * 10**8},{10**18 + i * 10**8}.png\n" for i in range(3))
        (folder / "data.csv").write_text("#timestamp [ns],filename\n" + rows)
        rows = "".join(f"{10**18 + i * 10**8},{value}\n" for i, value in enumerate(ms))
        (folder / "exposures.csv").write_text("timestamp_ns,exposure_ms\n" + rows)
    return place


def bag(place: Path) -> Path:
    sent = []
    for camera, ms in MS.items():
        sent += images([frame(camera, i) for i in range(3)], f"/{camera}/image_raw")
        sent += floats(ms, f"/{camera}/exposure_ms")
    return write_bag1(place, sent)


def folders(place: Path) -> Path:
    for camera, ms in MS.items():
        (place / camera / "images").mkdir(parents=True)
        for i in range(3):
            (place / camera / "images" / f"{i}.png").write_bytes(encoded(frame(camera, i)))
        (place / camera / "times.txt").write_text("".join(f"{i} {i} {value}\n" for i, value in enumerate(ms)))
    return place


def opened(camera: tuple[Path, ReadingOptions]) -> Recording:
    place, options = camera
    return open_recording(place, options=options)


RIGS = {"EuRoC": euroc, "bag": bag, "folders side by side": folders}


def test_a_stated_topic_of_one_camera_serves_no_other(tmp_path: Path) -> None:
    options = ReadingOptions(exposure_topic="/cam1/exposure_ms")
    found = cameras_of(bag(tmp_path / "made"), options=options)
    assert {name: opened(camera).exposures_ms.tolist() for name, camera in found.items()} == MS
    sent = [
        message for camera in MS for message in images([frame(camera, i) for i in range(3)], f"/{camera}/image_raw")
    ]
    only_one = write_bag1(tmp_path / "only", sent + floats(MS["cam0"], "/cam0/exposure_ms"))
    found = cameras_of(only_one, options=ReadingOptions(exposure_topic="/cam0/exposure_ms"))
    assert opened(found["cam0"]).exposures_ms.tolist() == MS["cam0"]
    with pytest.raises(ExposureError, match="the exposures of /cam1/image_raw"):
        opened(found["cam1"])
    shared = write_bag1(tmp_path / "shared", sent + floats(MS["cam0"], "/trigger/exposure_ms"))
    found = cameras_of(shared, options=ReadingOptions(exposure_topic="/trigger/exposure_ms"))
    assert [opened(camera).exposures_ms.tolist() for camera in found.values()] == [MS["cam0"]] * 3


@pytest.mark.parametrize("name", RIGS)
def test_every_camera_is_a_recording(name: str, tmp_path: Path) -> None:
    found = cameras_of(RIGS[name](tmp_path / "made"))
    assert set(found) == set(MS)
    for camera, place in found.items():
        recording = opened(place)
        assert recording.exposures_ms == pytest.approx(MS[camera])
        np.testing.assert_array_equal([f.image for f in recording], [frame(camera, i) for i in range(3)])


def test_a_single_camera_is_a_rig_of_one(tmp_path: Path) -> None:
    place = euroc(tmp_path / "made")
    assert list(cameras_of(place / "mav0" / "cam1")) == ["cam1"]
    assert list(cameras_of(folders(tmp_path / "walk") / "cam0")) == ["cam0"]
    assert list(cameras_of(place)) == ["cam0", "cam1", "cam10"]
    with pytest.raises(RecordingError, match="no such file"):
        cameras_of(tmp_path / "none")
    with pytest.raises(RecordingError, match="cannot be read"):
        cameras_of(tmp_path / ("x" * 300))


def test_one_camera_without_exposures_does_not_hide_the_others(tmp_path: Path) -> None:
    place = euroc(tmp_path / "made")
    (place / "mav0" / "cam1" / "exposures.csv").unlink()
    found = cameras_of(place)
    assert opened(found["cam10"]).exposures_ms == pytest.approx(MS["cam10"])
    with pytest.raises(ExposureError, match="has no list of exposures"):
        opened(found["cam1"])


@pytest.mark.parametrize(
    ("topics", "names"),
    [
        (["/left/image_raw", "/right/image_raw"], ["left", "right"]),
        (["/a/image_color", "/a/image_mono"], ["a_image_color", "a_image_mono"]),
        (["/image", "/stereo/left/image_raw"], ["image", "stereo_left"]),
        (["/a b/image", "/a-b/image"], ["a_b", "a-b"]),
    ],
)
def test_cameras_of_a_bag_are_named_by_their_topics(topics: list[str], names: list[str], tmp_path: Path) -> None:
    sent = [message for topic in topics for message in images([grey(0, SIZE)], topic)]
    assert list(cameras_of(write_bag1(tmp_path / "made", sent + floats([1.0])))) == names


@pytest.mark.parametrize("name", ["", "..", "/", "../../etc/passwd", "a\0b", "é" * 200, "CON.", "a/b\\c"])
def test_names_of_cameras_stay_in_their_folder(name: str, tmp_path: Path) -> None:
    safe = safe_name(name)
    assert (tmp_path / safe).parent == tmp_path
    assert safe not in ("", ".", "..")
    assert safe.isascii()


def test_calibrate_writes_a_folder_for_each(tmp_path: Path) -> None:
    place, out = euroc(tmp_path / "made"), tmp_path / "out"
    (place / "mav0" / "cam1" / "exposures.csv").write_text("")
    result = CliRunner().invoke(cli, ["calibrate", str(place), "-o", str(out), "--all-cameras", "--json"])
    told = json.loads(result.stdout)
    assert result.exit_code == told["exit_code"] == 1
    assert list(told["cameras"]) == list(MS)
    assert "exposures.csv" in told["cameras"]["cam1"]["error"]
    assert "ospc: error: cam1: " in result.stderr
    for camera in ("cam0", "cam10"):
        assert told["cameras"][camera]["exit_code"] == 3
        assert json.loads((out / camera / "calibration.json").read_text())["source"]["frames"] == 3
    assert open_recording(place / "mav0" / "cam0").exposures_ms[0] == 1.0


def test_a_camera_that_failed_has_no_part_in_the_scale(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its folder may contain an earlier calibration."""
    place, scaled = euroc(tmp_path / "made"), []
    (place / "mav0" / "cam1" / "exposures.csv").write_text("")
    monkeypatch.setattr("ospc.cli.calibrate.add_rig_scale", lambda _out, cameras, **_how: scaled.extend(cameras))
    CliRunner().invoke(cli, ["calibrate", str(place), "-o", str(tmp_path / "out"), "--all-cameras"])
    assert scaled == ["cam0", "cam10"]


def test_an_interruption_at_the_second_camera_keeps_the_first_and_removes_the_earlier_scale(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def calibrated(request: object, _opened: object) -> dict[str, object]:
        if Path(request.out).name != "cam0":  # type: ignore[attr-defined]
            raise KeyboardInterrupt
        return {"exit_code": 0, "error": None, "out": str(request.out)}  # type: ignore[attr-defined]

    monkeypatch.setattr("ospc.cli.calibrate._calibrate_one", calibrated)
    out = tmp_path / "out"
    out.mkdir()
    (out / "rig.json").write_text("{}")
    result = CliRunner().invoke(cli, ["calibrate", str(euroc(tmp_path / "made")), "-o", str(out), "--all-cameras"])
    assert result.exit_code == 130
    assert "no result was written for cam" in result.stderr
    assert not (out / "rig.json").exists()


def test_partial_results_beside_complete_ones_have_no_part_in_the_scale_and_keep_the_earlier_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def calibrated(request: object, _opened: object) -> dict[str, object]:
        return {"exit_code": 1, "error": "no", "out": str(request.out / "partial")}  # type: ignore[attr-defined]

    scaled: list[str] = []
    monkeypatch.setattr("ospc.cli.calibrate._calibrate_one", calibrated)
    monkeypatch.setattr("ospc.cli.calibrate.add_rig_scale", lambda _out, cameras, **_how: scaled.extend(cameras))
    out = tmp_path / "out"
    out.mkdir()
    (out / "rig.json").write_text("{}")
    CliRunner().invoke(cli, ["calibrate", str(euroc(tmp_path / "made")), "-o", str(out), "--all-cameras"])
    assert not scaled
    assert (out / "rig.json").exists()
