"""Folders with mav0/cam0: exposures from the TUM dataset's files, or from a list of exposures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from image_samples import encoded, grey

from ospc.errors import ExposureError, RecordingError
from ospc.recording import open_recording

STAMPS = (1520531829251142058, 1520531829301144058, 1520531829351146058)
TIMES = "# filename timestamp[s] [exposuretime[ms]]\n" + "".join(
    f"{s} {s / 1e9:.9f} {i + 1}\n" for i, s in enumerate(STAMPS)
)
EXPOSURES = "#timestamp [ns],exposure_us\n" + "".join(f"{s},{i + 1}000\n" for i, s in enumerate(STAMPS))


@pytest.fixture
def euroc(tmp_path: Path) -> Callable[..., Path]:
    """Make a recording with the given files in addition to the images."""

    def make(files: dict[str, str], cameras: tuple[str, ...] = ("cam0",)) -> Path:
        for camera in cameras:
            place = tmp_path / "mav0" / camera
            (place / "data").mkdir(parents=True)
            (place / "data.csv").write_text(
                "#timestamp [ns],filename\r\n" + "".join(f"{stamp},{stamp}.png\r\n" for stamp in STAMPS)
            )
            for i, stamp in enumerate(STAMPS):
                (place / "data" / f"{stamp}.png").write_bytes(encoded(grey(i)))
        for name, text in files.items():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_text(text)
        return tmp_path

    return make


IN_UNITS = [("timestamp_us", 1e-3, "{:.0f}"), ("timestamp_s", 1e-9, "{:.4f}"), ("timestamp", 1e-9, "{:.2f}")]


def listed_in(unit: tuple[str, float, str], stamps: tuple[int, ...]) -> str:
    name, scale, text = unit
    rows = (f"{text.format(stamp * scale)},{i + 1}" for i, stamp in enumerate(stamps))
    return "\n".join([f"{name},exposure_ms", *rows])


@pytest.mark.parametrize("unit", IN_UNITS)
def test_times_in_another_unit_find_the_images_named_by_time(euroc: Callable[..., Path], unit) -> None:
    recording = open_recording(euroc({"mav0/cam0/exposures.csv": listed_in(unit, STAMPS)}))
    assert [frame.name for frame in recording] == [f"{stamp}.png" for stamp in STAMPS]
    assert recording.exposures_ms.tolist() == [1, 2, 3]
    assert any("matched by the times in their names" in note for note in recording.notes)


@pytest.mark.parametrize("unit", IN_UNITS)
def test_times_that_begin_earlier_are_never_matched_by_order(euroc: Callable[..., Path], unit) -> None:
    earlier = (2 * STAMPS[0] - STAMPS[1], *STAMPS[:2])
    with pytest.raises(RecordingError, match=f"no image for .*; no line for '?{STAMPS[2]}"):
        open_recording(euroc({"mav0/cam0/exposures.csv": listed_in(unit, earlier)}))


@pytest.mark.parametrize(
    "files",
    [
        {"dso/cam0/times.txt": TIMES},
        {"mav0/cam0/exposures.csv": EXPOSURES},
        {"mav0/cam0/camera_state.csv": EXPOSURES},
        {"mav0/cam0/data.csv": EXPOSURES},
    ],
)
@pytest.mark.parametrize("inner", [".", "mav0", "mav0/cam0"])
def test_exposures_are_found_wherever_they_are_and_the_folder_is_pointed_at(
    euroc: Callable[..., Path], files: dict[str, str], inner: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = euroc(files)
    monkeypatch.chdir(place / inner)
    for path in (place / inner, Path()):
        recording = open_recording(path)
        assert recording.kind == "euroc"
        assert recording.exposures_ms == pytest.approx([1, 2, 3])
        assert recording.stamps_s == pytest.approx(np.array(STAMPS) / 1e9, abs=1e-6)
        np.testing.assert_array_equal([frame.image for frame in recording], [grey(i) for i in range(3)])


def test_another_camera_is_opened_by_its_folder(euroc: Callable[..., Path]) -> None:
    files = {"dso/cam0/times.txt": TIMES, "dso/cam1/times.txt": TIMES.replace(" 1\n", " 9\n")}
    place = euroc(files, ("cam0", "cam1"))
    assert open_recording(place / "mav0" / "cam1").exposures_ms[0] == 9
    recording = open_recording(place)
    assert recording.exposures_ms[0] == 1
    assert "reading cam0; to read the other camera, open" in recording.notes[0]


BROKEN: dict[str, tuple[dict[str, str], type[Exception], tuple[str, ...]]] = {
    "no exposures": ({}, ExposureError, ("mav0/cam0", "no list of exposures", "exposures.csv")),
    "two lists": (
        {"dso/cam0/times.txt": TIMES, "mav0/cam0/e.csv": EXPOSURES},
        ExposureError,
        ("several lists", "e.csv", "times.txt"),
    ),
    "other stamps": (
        {"dso/cam0/times.txt": TIMES.replace("1520531829351146058 ", "1520531829351146059 ")},
        RecordingError,
        ("times.txt", "no image for 1520531829351146059", "no line for 1520531829351146058.png"),
    ),
    "too few": (
        {"mav0/cam0/exposures.csv": "".join(EXPOSURES.splitlines(keepends=True)[:-1])},
        RecordingError,
        ("exposures.csv", "2 frames", "3 images"),
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_what_does_not_belong_together_is_one_error(euroc: Callable[..., Path], case: str) -> None:
    files, error, parts = BROKEN[case]
    with pytest.raises(error) as caught:
        open_recording(euroc(files))
    assert all(part in str(caught.value) for part in parts), str(caught.value)


def test_a_camera_without_images_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "data.csv").touch()
    with pytest.raises(RecordingError, match="data: has no images"):
        open_recording(tmp_path)
