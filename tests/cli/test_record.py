"""``ospc record`` with a fake camera."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from command_line import ospc
from ospc.errors import ExposureError, OspcError, SettingError
from ospc.recording import Frame, open_recording
from ospc.recording.options import ReadingOptions

SIZE = (48, 64)


class Camera:
    """Delivers frames of increasing exposure; the third is repeated."""

    name = "pretended"
    notes = ("exposures are pretended",)

    def __init__(self, frames: int = 6, fails: bool = False) -> None:
        self.frames, self.fails, self.closed = frames, fails, False

    def __iter__(self) -> Iterator[Frame]:
        for i in range(self.frames):
            for _ in range(2 if i == 2 else 1):
                yield Frame.of_array(np.full(SIZE, i, np.uint8), 1.0 + i, index=i, stamp_s=i / 10)
        if self.fails:
            raise ExposureError("pretended: no exposure")

    def close(self) -> None:
        self.closed = True

    def __enter__(self) -> Camera:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    said: dict[str, Any] = {"camera": Camera()}

    def opened(text: str, options: ReadingOptions) -> Camera:
        said.update(text=text, options=options)
        return said["camera"]

    monkeypatch.setattr("ospc.recording.live.open_camera", opened)
    return said


def test_a_missing_camera_is_a_one_line_error_without_driver_output(tmp_path: Path) -> None:
    script = "import sys; from ospc.cli.main import main; sys.argv[1:] = ['record', 'opencv:97', '-o', 'out']; main()"
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("ospc: error: camera 97: cannot be opened")
    assert done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("stamps_s", [[5.0, 5.1, 5.2, 0.0, 0.1], [5.0, 5.1, 1e9, 5.3, 5.4], [5.0, 3.0, 3.1]])
def test_no_frame_is_lost_when_the_clock_is_set(stamps_s: list[float], asked: dict[str, Any], tmp_path: Path) -> None:
    frames = [Frame.of_array(np.zeros(SIZE, np.uint8), 1.0, index=i, stamp_s=s) for i, s in enumerate(stamps_s)]
    asked["camera"] = type("Set", (Camera,), {"__iter__": lambda _: iter(frames)})()
    result = ospc("record", "opencv:3", "-o", str(tmp_path / "out"))
    assert "the clock of the camera was set back 1 time; the time stamps continue" in result.stderr
    recorded_s = open_recording(tmp_path / "out").stamps_s
    assert len(recorded_s) == len(stamps_s)
    assert np.all(np.diff(recorded_s) > 0)


def test_the_output_is_a_recording(asked: dict[str, Any], tmp_path: Path) -> None:
    result = ospc("record", "opencv:3", "-o", str(tmp_path / "out"), "--gain-unit", "db")
    assert result.exit_code == 0, (result.output, result.exception)
    assert "6 frames of 1 to 6 ms, 1 repeated ones left out" in result.stdout
    assert "exposures are pretended" in result.stderr
    assert asked["text"] == "opencv:3"
    assert asked["options"].gain_unit.value == "db"
    assert asked["camera"].closed
    recording = open_recording(tmp_path / "out")
    assert recording.exposures_ms.tolist() == [1, 2, 3, 4, 5, 6]
    assert recording.stamps_s == pytest.approx(np.arange(6) / 10)
    assert [int(frame.image[0, 0]) for frame in recording] == [0, 1, 2, 3, 4, 5]


def test_recording_ends_after_the_given_number_of_frames(asked: dict[str, Any], tmp_path: Path) -> None:
    asked["camera"] = Camera(10**9)
    assert ospc("record", "realsense", "-o", str(tmp_path), "-n", "4", "-q").output == ""
    assert len(open_recording(tmp_path)) == 4


def test_frames_before_a_failure_are_complete(asked: dict[str, Any], tmp_path: Path) -> None:
    asked["camera"] = Camera(fails=True)
    result = ospc("record", "depthai", "-o", str(tmp_path))
    assert str(result.exception) == "pretended: no exposure"
    assert len(open_recording(tmp_path)) == 6


def test_frames_before_the_disk_is_full_are_complete(asked: dict[str, Any], tmp_path: Path) -> None:
    resource = pytest.importorskip("resource", reason="needs limits of file size")
    noise = np.random.default_rng(0).integers(0, 256, (64, 64), np.uint8)
    images = [noise * (i == 2) for i in range(4)]
    asked["camera"] = contextlib.nullcontext(
        [Frame.of_array(image, 1.0, index=i, stamp_s=i / 10) for i, image in enumerate(images)]
    )
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, before[1]))
    try:
        done = ospc("record", "opencv", "-o", tmp_path / "out", "-q")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert "cannot be written" in str(done.exception)
    assert len(open_recording(tmp_path / "out")) == 2


def test_nothing_is_overwritten_and_no_frames_is_an_error(asked: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "a.txt").write_text("kept")
    result = ospc("record", "opencv:0", "-o", str(tmp_path / "mine"))
    assert isinstance(result.exception, SettingError)
    assert [p.name for p in (tmp_path / "mine").iterdir()] == ["a.txt"]
    asked["camera"] = Camera(0)
    result = ospc("record", "opencv:0", "-o", str(tmp_path / "none"))
    assert isinstance(result.exception, OspcError)
    assert "delivered no frames" in str(result.exception)
