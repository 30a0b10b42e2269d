"""Where the list of exposures of a folder of images may be, and what is said if it cannot be used."""

from __future__ import annotations

import errno
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from image_samples import encoded, grey

from ospc.errors import ExposureError, RecordingError
from ospc.recording import cameras_of, list_columns, open_recording
from ospc.recording.list_search import lists_in
from ospc.recording.options import ReadingOptions

LISTS = {
    "times.txt": "0 0.5 2\n1 1.0 4\n2 1.5 8\n",
    "exposures.csv": "file,timestamp_s,exposure_ms\n2.png,0.5,8\n0.png,1,2\n1.png,1.5,4\n",
    "exp.csv": "SourceFile,exposure [\u00b5s]\n0.png,2000\n1.png,4000\n2.png,8000\n",
    "exposures.txt": "2\n4\n8\n",
    "image_list.txt": "0.png 0.002 500\n1.png 0.004 250\n2.png 0.008 125\n",
}
UNKNOWN = ReadingOptions(unknown_exposures=True)

Make = Callable[..., Path]


@pytest.fixture
def folder(tmp_path: Path) -> Make:
    """Make a folder with three images in each of some folders, and files."""

    def make(files: dict[str, str | bytes], *images: str) -> Path:
        for inner in images:
            (tmp_path / "rec" / inner).mkdir(parents=True, exist_ok=True)
            for i in range(3):
                (tmp_path / "rec" / inner / f"{i}.png").write_bytes(encoded(grey(i)))
        for name, content in files.items():
            data = content if isinstance(content, bytes) else content.encode()
            (tmp_path / "rec" / name).write_bytes(data)
        return tmp_path / "rec"

    return make


@pytest.mark.parametrize("name", LISTS)
@pytest.mark.parametrize("images", ["images", "rgb", "image_0", "data"])
@pytest.mark.parametrize("given", [".", "inner"])
def test_a_list_beside_the_only_folder_of_images_belongs_to_them(
    folder: Make, name: str, images: str, given: str
) -> None:
    place = folder({name: LISTS[name]}, images)
    (place / "notes").mkdir()
    recording = open_recording(place / images if given == "inner" else place)
    exposures = {frame.name: frame.exposure_ms for frame in recording}
    assert exposures == pytest.approx({"0.png": 2, "1.png": 4, "2.png": 8})


def test_folders_are_relative_and_the_list_is_named_in_a_note(folder: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder({"exp.csv": LISTS["exp.csv"]}, "rgb") / "rgb")
    recording = open_recording(".")
    assert recording.exposures_ms.tolist() == [2, 4, 8]
    assert any(note.endswith("exp.csv: exposures are read from this list") for note in recording.notes)


def test_a_folder_stands_for_its_only_folder_of_images(folder: Make) -> None:
    place = folder({"times.txt": LISTS["times.txt"]}, "rgb")
    assert (open_recording(place).kind, open_recording(place).path) == ("image_folder", place / "rgb")
    assert cameras_of(place) == {"rgb": (place / "rgb", ReadingOptions())}
    with pytest.raises(RecordingError, match="has no bag"):
        open_recording(place, "rosbag")


@pytest.mark.parametrize(("given", "said"), [("", "give one of them: depth, rgb"), ("rgb", "add times.txt")])
def test_a_list_beside_several_folders_of_images_belongs_to_none(folder: Make, given: str, said: str) -> None:
    place = folder({"times.txt": LISTS["times.txt"]}, "rgb", "depth")
    with pytest.raises(RecordingError, match=said):
        open_recording(place / given)


def test_a_list_beside_images_belongs_to_these_even_if_there_are_others(folder: Make) -> None:
    place = folder({"exp.csv": LISTS["exp.csv"]}, "images", "depth")
    for given in (place, place / "images"):
        assert open_recording(given).exposures_ms.tolist() == [2, 4, 8]


def test_a_list_in_the_folder_of_images_goes_before_those_beside_it(folder: Make) -> None:
    place = folder({"times.txt": "0 1 9\n", "rgb/exp.csv": LISTS["exp.csv"]}, "rgb")
    assert open_recording(place / "rgb").exposures_ms.tolist() == [2, 4, 8]


@pytest.mark.parametrize("images", ["images", "rgb"])
@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("exp.csv", "file,exposure_ms\n0.png,1\n1.png,2\n", "exp.csv: lists 2 frames but there are 3 images in"),
        ("exp.csv", "file,exposure_ms\n0.png,1\n1.png,x\n2.png,3\n", "exp.csv, line 3: the exposure must be"),
        ("exposures.csv", "a,b\n1,2\n", "exposures.csv: it is unclear which of the 2 columns"),
    ],
)
def test_a_list_beside_images_that_does_not_fit_is_named_and_not_needed(
    folder: Make, images: str, name: str, text: str, said: str
) -> None:
    place = folder({name: text}, images)
    for given in (place, place / images):
        with pytest.raises(ExposureError, match=said):
            open_recording(given)
        assert open_recording(given, options=UNKNOWN).exposures_ms.tolist() == [1, 1, 1]


def test_several_lists_beside_images_are_named(folder: Make) -> None:
    place = folder({"exp.csv": LISTS["exp.csv"], "other.csv": LISTS["exp.csv"]}, "images")
    for given in (place, place / "images"):
        with pytest.raises(ExposureError, match=r"several lists of exposures \(exp\.csv, other\.csv\); keep only"):
            open_recording(given)


@pytest.mark.parametrize(("images", "given"), [(".", "."), ("images", "."), ("rgb", "rgb")])
def test_a_list_in_an_unknown_encoding_is_named(folder: Make, images: str, given: str) -> None:
    place = folder({"exp.csv": LISTS["exp.csv"].encode("utf-16-le")}, images)
    if given == "rgb":
        (place / "exp.csv").rename(place / "rgb" / "exp.csv")
    with pytest.raises(ExposureError, match=r"exp\.csv: not a text file in UTF-8.*; save it as UTF-8"):
        open_recording(place / given)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
def test_lists_are_found_in_every_encoding_that_spreadsheets_write(folder: Make, encoding: str) -> None:
    place = folder({"exp.csv": LISTS["exp.csv"].encode(encoding)}, ".")
    assert open_recording(place).exposures_ms.tolist() == [2, 4, 8]


def test_a_folder_above_that_cannot_be_listed_has_no_list(folder: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    place, before = folder({"times.txt": LISTS["times.txt"]}, "rgb"), Path.iterdir

    def denied(path: Path) -> Iterator[Path]:
        if path == place:
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return before(path)

    monkeypatch.setattr(Path, "iterdir", denied)
    with pytest.raises(ExposureError, match="has no list of exposures"):
        open_recording(place / "rgb")


def test_of_other_tables_in_the_folder_only_the_beginning_is_looked_at(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    split, real = [], list_columns._fields
    monkeypatch.setattr(list_columns, "_fields", lambda *line: split.append(line) or real(*line))
    (tmp_path / "imu.csv").write_text("timestamp,ax,ay,az\n" + "1695668703000000000,0.1,0.2,9.81\n" * 20_000)
    (tmp_path / "list.csv").write_text(
        "# of a run\nfile,exposure_ms\n" + "a_long_name_of_an_image.png,1.5\n" * 20_000
    )
    assert lists_in(tmp_path) == [tmp_path / "list.csv"]
    assert len(split) < 5000
