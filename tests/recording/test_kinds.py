"""The kind of a recording is recognised from its content."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from ospc.errors import RecordingError
from ospc.recording import open_recording
from ospc.recording.kinds import kinds

Make = Callable[..., Path]

PNG = cv2.imencode(".png", np.zeros((8, 8), np.uint8))[1].tobytes()


def test_names_are_unique_and_each_says_what_it_needs(tmp_path: Path) -> None:
    names = [kind.name for kind in kinds()]
    assert len(set(names)) == len(names)
    for name in names:
        with pytest.raises(RecordingError) as caught:
            open_recording(tmp_path, name)
        assert str(tmp_path) in str(caught.value)


def test_a_kind_nobody_knows_lists_those_known(tum_folder: Make) -> None:
    with pytest.raises(RecordingError, match="'super8' is not a kind of recording; known: tum_mono, "):
        open_recording(tum_folder(), "super8")


def test_the_kind_may_be_given(tum_folder: Make) -> None:
    assert open_recording(str(tum_folder()), "tum_mono").kind == "tum_mono"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda p: p / "missing", "there is no such file or folder"),
        (lambda p: p, "the folder is empty; expected a folder with images/"),
        (lambda p: _written(p / "notes.txt", b"hello").parent, "has no images; expected a folder"),
        (lambda p: _written(p / "notes.txt", b"hello"), "a file of this kind is not a recording; expected"),
        (lambda p: _written(p / "a.mp4", b""), "is an empty file; copy or record it again"),
        (lambda p: _written(p / "a.bag", b"x"), "is damaged, or is not what its name says"),
        (lambda p: _written(p / "blob.bin", bytes(100)), "a file of this kind is not a recording; expected"),
        (lambda p: p / ("x" * 300), "cannot be read"),
        (lambda p: _written(p / "a.png", PNG), "is a single image, but a recording has many"),
        (lambda p: _written(p / "a.jpg", b"a text"), "its content is not PNG, JPEG"),
        (lambda p: _written(p / "a.png", PNG[:40]), "is truncated"),
        (
            lambda p: _written(p / "a.webp", b"photo").parent,
            "images such as a.webp are not supported .*; convert them to PNG",
        ),
        (lambda p: _written(p / "a.cr2", b"photo"), "is damaged, or from an unknown camera"),
        (
            lambda p: _written(p / "seq" / "image_00" / "data" / "0.png", b"image").parents[3],
            "subfolders; .*: seq/image_00/data",
        ),
        (lambda p: _written(p / "images" / "dslr" / "0.JPG", b"image").parents[2], "subfolders; .*: dslr"),
    ],
)
def test_something_else_than_a_recording_is_one_error_that_names_the_options(
    tmp_path: Path, make: Callable[[Path], Path], message: str
) -> None:
    path = make(tmp_path)
    with pytest.raises(RecordingError, match=message) as caught:
        open_recording(path)
    assert str(path) in str(caught.value)


def test_the_output_of_a_calibration_is_recognised(tmp_path: Path) -> None:
    for name, data in (("calibration.json", b"{}"), ("times.txt", b"0 0.0 1\n"), ("figure.png", PNG), ("a.png", PNG)):
        _written(tmp_path / name, data)
    with pytest.raises(RecordingError, match="is a calibration; give a recording instead"):
        open_recording(tmp_path)


def _written(path: Path, data: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path
