"""Recordings with one folder of images per exposure."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from image_samples import encoded, grey

from ospc.errors import FrameError, RecordingError
from ospc.recording import open_recording

NS = 1_695_668_703_000_000_000


@pytest.fixture
def folders(tmp_path: Path) -> Callable[..., Path]:
    """Make the given image files, each with different noise."""

    def make(*names: str) -> Path:
        for i, name in enumerate(names):
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_bytes(encoded(grey(i)))
        return tmp_path

    return make


def test_frames_come_in_the_order_of_their_stamps(folders: Callable[..., Path]) -> None:
    place = folders(
        f"1.0/{NS}.png", f"1.0/{NS + 3 * 10**8}.png", f"16.0/{NS + 10**8}.png", f"2.0/{NS + 2 * 10**8}.png"
    )
    (place / "readme").mkdir()
    recording = open_recording(place)
    assert (recording.kind, len(recording)) == ("exposure_folders", 4)
    assert recording.exposures_ms.tolist() == [1, 16, 2, 1]
    assert recording.stamps_s - NS / 1e9 == pytest.approx([0, 0.1, 0.2, 0.3], abs=1e-5)
    assert [frame.name.split("/")[0] for frame in recording] == ["1.0", "16.0", "2.0", "1.0"]
    np.testing.assert_array_equal([frame.image for frame in recording], [grey(i) for i in (0, 2, 3, 1)])
    assert any("assumed to be exposures in ms" in note for note in recording.notes)


def test_units_may_be_part_of_the_names(folders: Callable[..., Path]) -> None:
    recording = open_recording(folders("500us/1.0.png", "2ms/2.0.png", "0.5 s/3.0.png"))
    assert recording.exposures_ms == pytest.approx([0.5, 2, 500])
    assert not any("assumed to be exposures" in note for note in recording.notes)


def test_numbered_folders_with_lists_of_exposures_are_recordings_and_not_named_by_exposure(
    folders: Callable[..., Path],
) -> None:
    place = folders("1/1.png", "2/2.png")
    for name in "12":
        (place / name / "times.txt").write_text(f"{name} 0.1 8.0\n")
    assert open_recording(place / "2").exposures_ms.tolist() == [8]
    with pytest.raises(RecordingError, match=r"give one of them: 1, 2$"):
        open_recording(place)


BROKEN = {
    "named by number in both": (["1.0/1.png", "2.0/1.png"], r"1\.0/1\.png, 2\.0/1\.png: the same time stamp"),
    "named otherwise": (["1.0/1.png", "2.0/left.png"], r"2\.0/left\.png: is not named by its time stamp"),
    "no number": (["1.0/nan.png", "2.0/1.png"], r"1\.0/nan\.png: is not named by its time stamp"),
    "no exposures": (["left/1.png", "right/1.png"], "has images only in subfolders"),
    "several recordings": (["left/images/1.png", "right/images/1.png"], "give one of them: left, right$"),
    "exposure zero": (["0/1.png", "0.0/2.png"], "has images only in subfolders"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_other_folders_are_one_error(folders: Callable[..., Path], case: str) -> None:
    names, message = BROKEN[case]
    with pytest.raises(RecordingError, match=message):
        open_recording(folders(*names))


def test_one_unreadable_frame_stops_nothing(folders: Callable[..., Path]) -> None:
    place = folders("1/1.png", "2/2.png", "4/3.png")
    (place / "2" / "2.png").write_bytes(b"")
    frames = list(open_recording(place))
    with pytest.raises(FrameError, match=r"2/2\.png: the file is empty"):
        _ = frames[1].image
    np.testing.assert_array_equal(frames[2].image, grey(2))


def test_the_kind_given_by_name_takes_a_single_folder(folders: Callable[..., Path]) -> None:
    place = folders("1.0/1.png")
    with pytest.raises(RecordingError, match="has images only in subfolders"):
        open_recording(place)
    assert len(open_recording(place, "exposure_folders")) == 1


def test_a_real_mosaic_of_twelve_bits_gives_the_green_image_its_makers_published(real_data: Path) -> None:
    recording = open_recording(real_data / "borealhdr_left_raw12")
    assert (recording.size, recording.max_grey) == ((960, 600), 4095)
    assert recording.exposures_ms.tolist() == [2, 4, 8, 16, 32, 1]
    published = open_recording(real_data / "borealhdr_left")
    for frame, other in zip(recording, published, strict=False):
        assert frame.exposure_ms == other.exposure_ms
        assert np.abs(frame.image / 16 - other.image).max() < 1
