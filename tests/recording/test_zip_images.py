"""Archives of images: hostile and damaged ones are refused, and nothing is written to disk."""

from __future__ import annotations

import stat
import threading
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from image_samples import encoded, grey

from ospc.errors import FrameError, RecordingError
from ospc.recording import image_source, open_recording
from ospc.recording.image_source import ZipImages

Make = Callable[..., Path]
PNG = encoded(grey())


def link(name: str) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo(name)
    info.create_system = 3
    info.external_attr = (stat.S_IFLNK | 0o777) << 16
    return info


def lzma_member(name: str) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo(name)
    info.compress_type = zipfile.ZIP_LZMA
    return info


HOSTILE: dict[str, tuple[dict[str | zipfile.ZipInfo, bytes], str]] = {
    "parent": ({"../00000.png": PNG}, "leads out of the archive"),
    "parent below": ({"a/../../00000.png": PNG}, "leads out of the archive"),
    "absolute": ({"/etc/00000.png": PNG}, "leads out of the archive"),
    "drive": ({"C:/00000.png": PNG}, "leads out of the archive"),
    "backslashes": ({"..\\..\\00000.png": PNG}, "leads out of the archive"),
    "link": ({link("00000.png"): b"/etc/passwd"}, "is a link"),
    "unusual compression": ({lzma_member("00000.png"): PNG}, "unsupported compression"),
    "several folders": ({"left/0.png": PNG, "right/0.png": PNG}, "folders 'left' and 'right'"),
    "no images": ({"readme.txt": b"hello"}, "has no images"),
    "hidden twins only": ({"__MACOSX/._0.png": PNG, ".0.png": PNG}, "has no images"),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_a_hostile_archive_is_one_error_that_names_it(tum_archive: Make, case: str) -> None:
    members, message = HOSTILE[case]
    with pytest.raises(RecordingError, match=message) as caught:
        open_recording(tum_archive(members))
    assert "images.zip" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_hidden_twins_of_images_are_ignored(tum_archive: Make) -> None:
    members = {"00000.png": PNG, "__MACOSX/._00000.png": b"x", "notes.txt": b"x"}
    assert len(open_recording(tum_archive(members, "00000 1 1\n"))) == 1


def test_a_member_twice_is_refused(tum_archive: Make) -> None:
    with pytest.warns(UserWarning, match="Duplicate"):
        place = tum_archive({"0.png": PNG, zipfile.ZipInfo("0.png"): PNG})
    with pytest.raises(RecordingError, match="appears twice"):
        open_recording(place)


def test_a_bomb_is_refused_unread(tum_archive: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(image_source, "FREE_EXPANSION_BYTES", 1000)
    with pytest.raises(RecordingError, match="expands to more than"):
        open_recording(tum_archive({"0.png": bytes(1_000_000)}, method=zipfile.ZIP_DEFLATED))


def test_a_large_member_is_refused_unread(tum_archive: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(image_source, "MAX_FILE_BYTES", 100)
    with pytest.raises(RecordingError, match="more than the 100 bytes"):
        open_recording(tum_archive())


def test_too_many_members_are_refused(tum_archive: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(image_source, "MAX_MEMBERS", 2)
    with pytest.raises(RecordingError, match="more than the 2 members"):
        open_recording(tum_archive())


def test_a_member_that_lies_about_its_size_is_an_unreadable_frame(tum_archive: Make) -> None:
    place = tum_archive({"00000.png": PNG, "00001.png": bytes(5_000_000)}, "00000 1 1\n00001 2 1\n", 8)
    archive = place / "images.zip"
    # Both headers of the second member state a small size; only its checksum reveals the error.
    archive.write_bytes(archive.read_bytes().replace((5_000_000).to_bytes(4, "little"), (500).to_bytes(4, "little")))
    frames = list(open_recording(place))
    with pytest.raises(FrameError, match=r"images\.zip/00001\.png"):
        _ = frames[1].image
    np.testing.assert_array_equal(frames[0].image, grey())


def test_an_encrypted_member_is_refused(tum_archive: Make) -> None:
    place = tum_archive({"0.png": PNG}, "0 1 1\n")
    archive = place / "images.zip"
    data = bytearray(archive.read_bytes())
    data[data.index(b"PK\x01\x02") + 8] |= 1
    archive.write_bytes(data)
    with pytest.raises(RecordingError, match="is encrypted"):
        open_recording(place)


@pytest.mark.parametrize("damage", ["empty", "text", "half", "end missing"])
def test_a_damaged_archive_is_one_error_that_names_it(tum_archive: Make, damage: str) -> None:
    place = tum_archive()
    whole = (place / "images.zip").read_bytes()
    damaged = {"empty": b"", "text": b"hello", "half": whole[: len(whole) // 2], "end missing": whole[:-10]}
    (place / "images.zip").write_bytes(damaged[damage])
    with pytest.raises(RecordingError, match=r"images\.zip: not a zip archive, or damaged"):
        open_recording(place)


def test_one_damaged_member_stops_nothing(tum_archive: Make) -> None:
    place = tum_archive()
    data = bytearray((place / "images.zip").read_bytes())
    start = data.index(encoded(grey(1)))
    data[start + 60 : start + 70] = bytes(10)
    (place / "images.zip").write_bytes(data)
    frames = list(open_recording(place))
    with pytest.raises(FrameError, match=r"images\.zip/00001\.png: cannot be read from the archive"):
        _ = frames[1].image
    np.testing.assert_array_equal(frames[2].image, grey(2))


def test_nothing_is_written_next_to_the_archive(tum_archive: Make) -> None:
    place = tum_archive()
    before = sorted(place.rglob("*"))
    for frame in open_recording(place):
        _ = frame.image
    assert sorted(place.rglob("*")) == before


def test_threads_read_the_same_bytes(tum_archive: Make) -> None:
    members = {f"{i:03d}.png": encoded(grey(i, (100, 80))) for i in range(20)}
    images = ZipImages.of(tum_archive(members) / "images.zip")
    wrong: list[str] = []

    def read_all() -> None:
        wrong.extend(name for name in images.names if images.read(name) != members[name])

    threads = [threading.Thread(target=read_all) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []
