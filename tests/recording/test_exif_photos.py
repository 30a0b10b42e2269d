"""Folders of photographs with EXIF."""

from __future__ import annotations

import struct
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from image_samples import encoded, grey

from exif_segments import exif
from ospc.errors import ExposureError, OspcError, RecordingError
from ospc.recording import open_recording
from ospc.recording.image_formats import Shot, shot_of_exif

Folder = Callable[..., Path]


def photograph(seed: int, segment: bytes) -> bytes:
    data = encoded(grey(seed), ".jpg")
    return data[:2] + segment + data[2:]


def chained(entries: list[tuple[int, int, int, int]], directories: int = 1) -> bytes:
    """Return overlapping TIFF directories: each has all entries and links to the one six bytes later."""
    content = bytearray(b"II*\0" + struct.pack("<I", 8) + bytes(12 * len(entries) + 6 * directories + 6))
    for number, entry in enumerate(entries):
        struct.pack_into("<HHII", content, 10 + 12 * number, *entry)
    for start in range(8, 8 + 6 * directories, 6):
        struct.pack_into("<H", content, start, len(entries))
        if directories > 1:
            struct.pack_into("<I", content, start + 2 + 12 * len(entries), start + 6)
    return bytes(content)


@pytest.fixture
def photos(tmp_path: Path) -> Folder:
    """Make a folder with one photograph per EXIF segment."""

    def make(*segments: bytes) -> Path:
        for i, segment in enumerate(segments):
            (tmp_path / f"IMG_{i}.JPG").write_bytes(photograph(i, segment))
        return tmp_path

    return make


def test_exposure_is_time_times_iso_over_f_number_squared(photos: Folder) -> None:
    recording = open_recording(
        photos(
            exif((1, 100), (8, 1), 100, "2020:01:02 03:04:05"),
            exif((1, 50), (8, 1), 100, "2020:01:02 03:04:06"),
            exif((1, 100), (8, 1), 400, "2020:01:02 03:04:08"),
            exif((1, 100), (4, 1), 100, "2020:01:02 03:04:09"),
        )
    )
    assert recording.kind == "exif_photos"
    assert recording.exposures_ms == pytest.approx(np.array([1, 2, 4, 4]) * 10 / 64)
    assert recording.stamps_s.tolist() == [0, 1, 3, 4]
    assert any("time × ISO/100 / f-number²" in note for note in recording.notes)
    assert any("the f-number changes" in note for note in recording.notes)


def test_a_zoom_that_was_moved_is_reported(photos: Folder) -> None:
    for focal_mm, changes in ((24, False), (70, True)):
        recording = open_recording(photos(exif(focal_mm=24), exif(focal_mm=focal_mm)))
        assert any("the focal length changes" in note for note in recording.notes) is changes


def test_the_order_is_that_in_which_they_were_taken(photos: Folder) -> None:
    place = photos(exif(taken="2020:01:02 03:04:09"), exif(taken="2020:01:02 03:04:05"))
    assert [frame.name for frame in open_recording(place)] == ["IMG_1.JPG", "IMG_0.JPG"]


@pytest.mark.parametrize("taken", [None, "2020:01:02 03:04:05", "0000:00:00 00:00:00"])
def test_bursts_and_missing_times_are_ordered_by_name(photos: Folder, taken: str | None) -> None:
    recording = open_recording(photos(exif(taken=taken), exif(taken=taken)))
    assert [frame.name for frame in recording] == ["IMG_0.JPG", "IMG_1.JPG"]
    assert any("ordered by name" in note for note in recording.notes)


@pytest.mark.parametrize(("what", "segment"), [("ISO", exif(iso=None)), ("f-number", exif(f_number=(0, 1)))])
def test_what_no_photograph_states_is_taken_as_constant_with_a_note(
    photos: Folder, what: str, segment: bytes
) -> None:
    recording = open_recording(photos(segment, segment))
    assert any(f"EXIF states no {what}" in note for note in recording.notes)


def test_a_list_of_exposures_wins_over_exif(photos: Folder) -> None:
    place = photos(exif(), exif())
    (place / "exposures.csv").write_text("file,exposure_s\nIMG_0.JPG,1\nIMG_1.JPG,2\n")
    recording = open_recording(place)
    assert (recording.kind, recording.exposures_ms.tolist()) == ("image_folder", [1000, 2000])


BROKEN = {
    "no time": ([exif(), exif(time=None)], ExposureError, "IMG_1.JPG: its EXIF has no exposure time"),
    "time is no number": ([exif(), exif(time=(1, 0))], ExposureError, "IMG_1.JPG: its EXIF has no exposure time"),
    "time is zero": ([exif(), exif(time=(0, 1))], ExposureError, "IMG_1.JPG: its EXIF has no exposure time"),
    "time is absurd": (
        [exif(time=(2**32 - 1, 1))],
        ExposureError,
        "IMG_0.JPG: the exposure must be a positive number",
    ),
    "no EXIF": ([exif(), b""], ExposureError, "IMG_1.JPG: its EXIF has no exposure time"),
    "damaged EXIF": ([exif(), exif()[:40]], ExposureError, "IMG_1.JPG: its EXIF has no exposure time"),
    "some ISO": ([exif(), exif(iso=None)], ExposureError, "EXIF states the ISO of some .* not of IMG_1.JPG"),
    "two cameras": ([exif(), exif(model="M2")], RecordingError, r"several cameras \(M1, M2\)"),
    "one unknown": ([exif(), exif(model="")], RecordingError, r"several cameras \(M1, unknown\)"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_photographs_without_a_common_exposure_are_one_error(photos: Folder, case: str) -> None:
    segments, error, message = BROKEN[case]
    with pytest.raises(error, match=message):
        open_recording(photos(*segments))


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(st.integers(10, 200), st.integers(0, 255)), min_size=1, max_size=6))
def test_changed_exif_is_read_or_refused(tmp_path: Path, changes: list[tuple[int, int]]) -> None:
    segment = bytearray(exif())
    for place, value in changes:
        segment[place % (len(segment) - 10) + 10] = value
    (tmp_path / "a.jpg").write_bytes(photograph(0, bytes(segment)))
    try:
        recording = open_recording(tmp_path, "exif_photos")
    except OspcError:
        return
    assert np.isfinite(recording.exposures_ms[0])
    assert recording.exposures_ms[0] > 0


def test_real_photographs_three_stops_apart(real_data: Path) -> None:
    recording = open_recording(real_data / "brackets" / "frobisher")
    assert recording.kind == "exif_photos"
    assert recording.exposures_ms == pytest.approx(np.array([125, 1000, 8000]) / 64)
    assert recording.size == (640, 426)


def test_real_overlapping_photographs(real_data: Path) -> None:
    recording = open_recording(real_data / "brackets" / "sceaux_exif")
    assert recording.exposures_ms == pytest.approx(800 / np.array([400, 640, 640, 400]) / 2.8**2)
    assert recording.stamps_s.tolist() == [0, 23, 44, 81]


GPS = (0x8825, 4, 1, 8)
"""An entry that links to its own directory."""

BEYOND = b"II*\0" + struct.pack("<IH", 8, 0xFFFF)
"""A directory whose entries all lie beyond the end of the data."""


@pytest.mark.parametrize("hostile", [chained([(0, 0, 0, 0)] * 2000, 3000), chained([GPS] * 2000), BEYOND])
def test_directories_that_are_read_again_and_again_are_given_up(hostile: bytes) -> None:
    begun_s = time.process_time()
    assert shot_of_exif(hostile) == Shot()
    assert time.process_time() - begun_s < 2


def test_texts_that_are_read_again_and_again_are_given_up() -> None:
    hostile = chained([(tag, 2, 50_000, 24_020) for tag in range(1, 2001)]) + b"x" * 50_000
    tracemalloc.start()
    try:
        assert shot_of_exif(hostile) == Shot()
        assert tracemalloc.get_traced_memory()[1] < 64 * 2**20
    finally:
        tracemalloc.stop()
