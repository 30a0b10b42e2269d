from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from command_line import ospc
from ospc.cli.interruption import Interruption
from ospc.cli.terminal import INTERRUPTED
from ospc.errors import FrameError, OspcError
from ospc.recording import ArrayRecording, open_recording
from ospc.recording.writing.conversion import convert_recording

COUNT = 5


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    images = [np.full((16, 24), 40 * i, np.uint8) for i in range(COUNT)]
    place = tmp_path / "recording"
    convert_recording(ArrayRecording(images, 1.0 + np.arange(COUNT), np.arange(COUNT) / 10), place)
    return place


convert = partial(ospc, "convert")


def test_it_prints_what_it_wrote(recording: Path, tmp_path: Path) -> None:
    result = convert(recording, "-o", tmp_path / "out", "--zip")
    assert result.exit_code == 0, result.output
    assert result.stdout == f"{tmp_path / 'out'}: {COUNT} images ({COUNT} of them copied) and times.txt\n"
    assert len(open_recording(tmp_path / "out")) == COUNT


def test_quiet_prints_nothing(recording: Path, tmp_path: Path) -> None:
    assert convert(recording, "-o", tmp_path / "out", "-q").output == ""


def test_a_lag_is_corrected(recording: Path, tmp_path: Path) -> None:
    result = convert(recording, "-o", tmp_path / "out", "--lag", "-1", "--format", "jpg")
    assert result.exit_code == 0, result.output
    assert "lag of -1" in result.stderr
    back = open_recording(tmp_path / "out")
    # The exposure of image i was recorded with image i − 1, so that of the first image is unknown.
    assert back.exposures_ms.tolist() == [1, 2, 3, 4]
    assert [round(float(np.median(frame.image))) for frame in back] == [40, 80, 120, 160]


@pytest.mark.parametrize(
    "arguments",
    [("nowhere", "-o", "out"), ("recording", "-o", "recording", "--force"), ("recording", "-o", "out", "--lag", "9")],
)
def test_impossible_requests_are_one_line_errors(
    arguments: tuple[str, ...], recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = convert(*arguments)
    assert result.exit_code == 1
    assert isinstance(result.exception, OspcError)
    assert "\n" not in str(result.exception)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("options", [("--mask", "mask.png"), ("--roi", "0,0,8,8"), ("--channel", "each")])
def test_whole_images_of_one_channel_are_written(options: tuple[str, str], recording: Path, tmp_path: Path) -> None:
    assert convert(recording, "-o", tmp_path / "out", *options).exit_code == 2
    assert not (tmp_path / "out").exists()


def test_an_interrupted_conversion_leaves_nothing(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Interruption, "requested", True)
    result = convert(recording, "-o", tmp_path / "out")
    assert result.exit_code == INTERRUPTED
    assert "nothing was written" in result.stderr
    assert not (tmp_path / "out").exists()


def test_omitted_frames_are_reported(recording: Path, tmp_path: Path) -> None:
    image = recording / "images" / "00002.png"
    image.write_bytes(image.read_bytes()[:40])
    with pytest.raises(FrameError):
        _ = list(open_recording(recording))[2].image
    result = convert(recording, "-o", tmp_path / "out")
    assert result.exit_code == 0
    assert "1 frame left out" in result.stderr
    assert open_recording(tmp_path / "out").exposures_ms.tolist() == [1, 2, 4, 5]
