"""Any recording can become a folder that DSO reads: the frames stay the same, and DSO's rules are met."""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from exif_segments import exif
from ospc.errors import FrameError, RecordingError, SettingError
from ospc.formats.image_header import with_metadata
from ospc.formats.validation import validate
from ospc.recording import ArrayRecording, Frame, Recording, open_recording
from ospc.recording.channel import Channel
from ospc.recording.derived import with_exposure_lag
from ospc.recording.options import ReadingOptions
from ospc.recording.writing.conversion import convert_recording
from ospc.recording.writing.images import NumberedImages

COUNT, SIZE = 7, (170, 128)
EXPOSURES = np.array([0.123456789, 1, 2.5, 1 / 3, 12, 0.02, 40])
STAMPS = 1.4e9 + np.arange(COUNT) / 29.97


def images(max_grey: int = 255) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    kind = np.uint8 if max_grey == 255 else np.uint16
    return [rng.integers(0, max_grey + 1, SIZE[::-1]).astype(kind) for _ in range(COUNT)]


def recorded(max_grey: int = 255) -> ArrayRecording:
    return ArrayRecording(images(max_grey), EXPOSURES, STAMPS, max_grey=max_grey)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder that already has this layout, with a camera file."""
    place = tmp_path / "source"
    (place / "images").mkdir(parents=True)
    for i, image in enumerate(images()):
        cv2.imwrite(str(place / "images" / f"{i:05d}.png"), image)
    lines = [f"{i:05d} {stamp:.9f} {e:.9g}\n" for i, (stamp, e) in enumerate(zip(STAMPS, EXPOSURES, strict=True))]
    (place / "times.txt").write_text("".join(lines))
    (place / "camera.txt").write_text("Pinhole 100 100 85 64 0\n170 128\ncrop\n160 128\n")
    return place


def assert_same(place: Path, expected: list[np.ndarray], first: int = 0) -> None:
    back = open_recording(place)
    assert len(back) == len(expected)
    np.testing.assert_allclose(back.exposures_ms, EXPOSURES[first : first + len(expected)], rtol=1e-8)
    np.testing.assert_allclose(back.stamps_s, STAMPS[first : first + len(expected)], atol=1e-6, rtol=0)
    for frame, image in zip(back, expected, strict=True):
        np.testing.assert_array_equal(frame.image, image)


def dso_rows(place: Path) -> list[tuple[int, float, float]]:
    """Read times.txt as sscanf with "%d %lf %f" does."""
    rows = []
    for line in (place / "times.txt").read_text().splitlines():
        fields = line.split()
        rows.append((int(fields[0]), float(fields[1]), float(np.float32(fields[2]))))
    return rows


@pytest.mark.parametrize("archive", [False, True])
def test_the_same_frames_come_back_and_dso_accepts_them(archive: bool, tmp_path: Path) -> None:
    made = convert_recording(recorded(), tmp_path / "out", archive=archive)
    assert (made.frames, made.copied, made.skipped, made.has_camera) == (COUNT, 0, 0, False)
    assert_same(tmp_path / "out", images())
    assert (tmp_path / "out" / "images.zip").exists() == archive == (not (tmp_path / "out" / "images").exists())
    rows = dso_rows(tmp_path / "out")
    assert [row[0] for row in rows] == list(range(COUNT))
    np.testing.assert_allclose([row[2] for row in rows], EXPOSURES, rtol=1e-6)
    found = validate([tmp_path / "out"], "dso", SIZE)
    assert found.valid, found.findings


def test_what_was_converted_is_converted_to_itself(folder: Path, tmp_path: Path) -> None:
    made = convert_recording(open_recording(folder), tmp_path / "out")
    assert (made.copied, made.has_camera) == (COUNT, True)
    for name in ("images/00003.png", "camera.txt"):
        assert (tmp_path / "out" / name).read_bytes() == (folder / name).read_bytes()
    assert_same(tmp_path / "out", images())
    assert validate([tmp_path / "out"], "dso").valid
    convert_recording(open_recording(tmp_path / "out"), tmp_path / "twice")
    assert (tmp_path / "twice" / "times.txt").read_bytes() == (tmp_path / "out" / "times.txt").read_bytes()


def test_a_corrected_lag_moves_exposures_and_copies_files(folder: Path, tmp_path: Path) -> None:
    made = convert_recording(with_exposure_lag(open_recording(folder), 2), tmp_path / "out")
    assert made.copied == COUNT - 2
    back = open_recording(tmp_path / "out")
    np.testing.assert_allclose(back.exposures_ms, EXPOSURES[2:], rtol=1e-8)
    np.testing.assert_allclose(back.stamps_s, STAMPS[:-2], atol=1e-6, rtol=0)
    for frame, image in zip(back, images()[:-2], strict=True):
        np.testing.assert_array_equal(frame.image, image)


def test_an_orientation_that_other_programs_would_apply_is_not_copied(folder: Path, tmp_path: Path) -> None:
    for place in (folder / "images").iterdir():
        place.write_bytes(with_metadata(place.read_bytes(), exif(orientation=6)[4:]))
    assert cv2.imread(str(place), cv2.IMREAD_GRAYSCALE).shape == SIZE
    made = convert_recording(open_recording(folder), tmp_path / "out")
    assert made.copied == 0
    back = cv2.imread(str(tmp_path / "out" / "images" / "00000.png"), cv2.IMREAD_GRAYSCALE)
    np.testing.assert_array_equal(back, images()[0])


@pytest.mark.parametrize("bits", [10, 12, 16])
def test_more_than_8_bit_are_left_aligned(bits: int, tmp_path: Path) -> None:
    made = convert_recording(recorded(2**bits - 1), tmp_path / "out")
    stored = cv2.imread(str(tmp_path / "out" / "images" / "00000.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(stored, images(2**bits - 1)[0] << (16 - bits))
    assert bool(made.notes) == (bits < 16)
    for frame, image in zip(open_recording(tmp_path / "out"), images(2**bits - 1), strict=True):
        np.testing.assert_allclose(frame.image / frame.max_grey, image / (2**bits - 1), atol=2.0**-bits)


def test_jpeg_is_near_and_says_what_it_cuts(tmp_path: Path) -> None:
    smooth = [cv2.GaussianBlur(image.astype(np.uint16) * 16, (0, 0), 4) for image in images()]
    recording = ArrayRecording(smooth, EXPOSURES, STAMPS, max_grey=4095)
    made = convert_recording(recording, tmp_path / "out", image_format="jpg")
    assert "upper 8" in made.notes[0]
    for frame, image in zip(open_recording(tmp_path / "out"), smooth, strict=True):
        assert np.abs(frame.image - image / 4095 * 255).max() < 4


@pytest.mark.parametrize("channel", [None, Channel.GREEN, Channel.LUMINANCE])
def test_of_colour_images_every_program_reads_the_channel(channel: Channel | None, tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    colour = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 256, (64, 80, 3)).astype(np.uint8), (0, 0), 3)
    for i in range(3):
        cv2.imwrite(str(tmp_path / "images" / f"{i}.jpg"), colour)
    (tmp_path / "times.txt").write_text("".join(f"{i} {i} {i + 1}\n" for i in range(3)))
    recording = open_recording(tmp_path, options=ReadingOptions(channel=channel))
    convert_recording(recording, tmp_path / "out")
    written = sorted((tmp_path / "out" / "images").iterdir())
    for frame, back, file in zip(recording, open_recording(tmp_path / "out"), written, strict=True):
        np.testing.assert_array_equal(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), frame.image)
        np.testing.assert_array_equal(back.image, frame.image)


def test_the_camera_next_to_a_euroc_folder_is_copied(folder: Path, tmp_path: Path) -> None:
    camera = tmp_path / "mav0" / "cam0"
    shutil.copytree(folder / "images", camera / "data")
    rows = [
        f"{round(stamp * 1e9)},{i:05d}.png,{ms}" for i, (stamp, ms) in enumerate(zip(STAMPS, EXPOSURES, strict=True))
    ]
    (camera / "data.csv").write_text("\n".join(["#timestamp [ns],filename,exposure [ms]", *rows]))
    (tmp_path / "dso" / "cam0").mkdir(parents=True)
    shutil.copy(folder / "camera.txt", tmp_path / "dso" / "cam0")
    assert convert_recording(open_recording(tmp_path), tmp_path / "out").has_camera
    assert (tmp_path / "out" / "camera.txt").read_text() == (folder / "camera.txt").read_text()


def test_a_camera_of_another_size_is_left_out_and_reported(folder: Path, tmp_path: Path) -> None:
    (folder / "camera.txt").write_text("Pinhole 100 100 85 64 0\n48 32\ncrop\n48 32\n")
    made = convert_recording(open_recording(folder), tmp_path / "out")
    assert not made.has_camera
    assert "another size" in made.notes[0]
    assert not (tmp_path / "out" / "camera.txt").exists()


def test_files_that_dso_rejects_are_reported(folder: Path, tmp_path: Path) -> None:
    (folder / "camera.txt").write_text("Pinhole 100 100 85 64 0\n170 128\ncrop\n170 127\n")
    made = convert_recording(open_recording(folder), tmp_path / "out")
    assert any(note.startswith("camera.txt: ") and "170×127" in note for note in made.notes)


class _Spoiled:
    """A recording with some frames that raise an exception."""

    def __init__(self, inner: ArrayRecording, fail: dict[int, BaseException]) -> None:
        self._inner, self._fail, self.alive = inner, fail, 0

    def __getattr__(self, name: str):
        return getattr(self._inner, name)

    def __len__(self) -> int:
        return len(self._inner)

    def __iter__(self) -> Iterator[Frame]:
        def raising(error: BaseException):
            raise error

        for frame in self._inner:
            error = self._fail.get(frame.index)
            yield frame if error is None else replace(frame, load=lambda error=error: raising(error))


def test_frames_that_cannot_be_read_are_left_out_with_their_times(tmp_path: Path) -> None:
    spoiled = _Spoiled(recorded(), {0: FrameError("torn")})
    made = convert_recording(spoiled, tmp_path / "out")
    assert (made.frames, made.skipped) == (COUNT - 1, 1)
    assert "torn" in made.notes[0]
    assert_same(tmp_path / "out", images()[1:], first=1)
    with pytest.raises(RecordingError, match="none of its frames"):
        convert_recording(_Spoiled(recorded(), {i: FrameError("torn") for i in range(COUNT)}), tmp_path / "none")
    assert not (tmp_path / "none").exists()


def files_in(place: Path) -> dict[Path, bytes]:
    return {p: p.read_bytes() for p in place.rglob("*") if p.is_file()}


def assert_unchanged_by(error: type[BaseException], recording: Recording, tmp_path: Path) -> None:
    before = files_in(tmp_path / "there")
    for place in ("new", "there"):
        with pytest.raises(error):
            convert_recording(recording, tmp_path / place, overwrite=True)
    assert not (tmp_path / "new").exists()
    assert files_in(tmp_path / "there") == before


@pytest.mark.parametrize("happening", [KeyboardInterrupt(), MemoryError()])
def test_an_early_end_leaves_everything_unchanged(happening: BaseException, tmp_path: Path) -> None:
    convert_recording(recorded(), tmp_path / "there")
    assert_unchanged_by(type(happening), _Spoiled(recorded(), {3: happening}), tmp_path)


def test_a_full_disk_leaves_everything_unchanged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    convert_recording(recorded(), tmp_path / "there")
    write = NumberedImages.write

    def write_until_full(images: NumberedImages, number: int, data: bytes) -> None:
        if number == 3:
            raise OSError(28, "No space left on device")
        write(images, number, data)

    monkeypatch.setattr(NumberedImages, "write", write_until_full)
    assert_unchanged_by(SettingError, recorded(), tmp_path)


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("move", range(2 + 2))
def test_an_interruption_while_the_files_are_moved_leaves_everything_unchanged(
    move: int, late: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    convert_recording(recorded(), tmp_path / "there", archive=True)
    before, rename, moves = files_in(tmp_path / "there"), Path.rename, iter(range(100))

    def interrupted(path: Path, target: Path) -> None:
        now = next(moves) == move
        if late or not now:
            rename(path, target)
        if now:
            raise KeyboardInterrupt

    monkeypatch.setattr(Path, "rename", interrupted)
    with pytest.raises(KeyboardInterrupt):
        convert_recording(recorded(), tmp_path / "there", overwrite=True)
    assert files_in(tmp_path / "there") == before


def test_a_folder_in_use_is_only_replaced_on_request_and_other_files_stay(tmp_path: Path) -> None:
    place = tmp_path / "out"
    convert_recording(recorded(), place, archive=True)
    (place / "notes.txt").write_text("mine")
    with pytest.raises(SettingError, match="not empty"):
        convert_recording(recorded(), place)
    convert_recording(recorded(), place, overwrite=True)
    assert sorted(p.name for p in place.iterdir()) == ["images", "notes.txt", "times.txt"]


@pytest.mark.parametrize("inside", [".", "images"])
def test_a_recording_is_never_converted_into_itself(inside: str, folder: Path) -> None:
    with pytest.raises(SettingError, match="contains the recording itself"):
        convert_recording(open_recording(folder), folder / inside, overwrite=True)
    assert_same(folder, images())


def test_a_recording_can_be_converted_into_a_new_folder_inside_it(folder: Path) -> None:
    convert_recording(open_recording(folder), folder / "converted")
    assert_same(folder, images())
    assert_same(folder / "converted", images())


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SettingError, match="is a file"):
        convert_recording(recorded(), tmp_path / "file")


def test_archives_of_the_same_recording_are_identical(tmp_path: Path) -> None:
    for name in ("a", "b"):
        convert_recording(recorded(), tmp_path / name, archive=True)
    assert (tmp_path / "a/images.zip").read_bytes() == (tmp_path / "b/images.zip").read_bytes()
    assert zipfile.ZipFile(tmp_path / "a/images.zip").namelist()[:2] == ["00000.png", "00001.png"]


def test_progress_counts_frames(tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    convert_recording(recorded(), tmp_path / "out", progress=lambda done, total: seen.append((done, total)))
    assert seen == [(i + 1, COUNT) for i in range(COUNT)]


@given(
    exposures=st.lists(st.floats(1e-4, 1e5), min_size=2, max_size=12),
    start=st.floats(0, 2e9),
    step=st.floats(1e-3, 100),
)
def test_times_survive_whatever_they_are(
    exposures: list[float], start: float, step: float, tmp_path_factory: pytest.TempPathFactory
) -> None:
    place = tmp_path_factory.mktemp("any") / "out"
    stamps = start + step * np.arange(len(exposures))
    still = [np.zeros((4, 4), np.uint8)] * len(exposures)
    convert_recording(ArrayRecording(still, exposures, stamps), place, archive=True)
    rows = dso_rows(place)
    np.testing.assert_allclose([row[1] for row in rows], stamps, atol=1e-6, rtol=0)
    np.testing.assert_allclose([row[2] for row in rows], exposures, rtol=1e-6)
