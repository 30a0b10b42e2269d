"""Atomic writing leaves either the old or the new content."""

from __future__ import annotations

import errno
import os

import pytest

from ospc.errors import FormatError, os_error_as
from ospc.system.atomic import write_atomically


def test_content_is_what_was_given(tmp_path):
    place = write_atomically(tmp_path / "a.bin", b"\0\r\n\xff")
    assert place.read_bytes() == b"\0\r\n\xff"
    assert list(tmp_path.iterdir()) == [place]


@pytest.mark.parametrize("event", [KeyboardInterrupt(), OSError(28, "No space left on device"), MemoryError()])
@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_old_content_survives_any_end(tmp_path, monkeypatch, event, step):
    place = tmp_path / "a.txt"
    place.write_text("old")

    def fail(*_arguments):
        raise event

    monkeypatch.setattr(*((os, "fsync") if step == "fsync" else (type(place), "replace")), fail)
    with pytest.raises(type(event)):
        write_atomically(place, b"new")
    monkeypatch.undo()
    assert place.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_a_full_disk_is_named_by_every_writer():
    with (
        pytest.raises(FormatError, match=r"^a: cannot be written \(No space left on device\); free some space$"),
        os_error_as(FormatError, "a: cannot be written", "choose another folder"),
    ):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_missing_folder_is_an_os_error(tmp_path):
    with pytest.raises(FileNotFoundError):
        write_atomically(tmp_path / "none" / "a.txt", b"")


def test_unfinished_files_are_new_and_their_names_cannot_be_guessed(tmp_path, monkeypatch):
    opened = []
    before = os.open

    def noting(path, flags, mode=0o777):
        opened.append((path.name, flags))
        return before(path, flags, mode)

    monkeypatch.setattr(os, "open", noting)
    for _ in range(2):
        write_atomically(tmp_path / "a.txt", b"")
    names = {name for name, _ in opened}
    assert len(names) == 2
    assert not any(str(os.getpid()) == name.split(".")[-2] for name in names)
    for _, flags in opened:
        assert flags & os.O_EXCL
        assert flags & os.O_NOFOLLOW


def test_a_link_at_the_place_is_replaced_and_not_followed(tmp_path):
    (tmp_path / "precious.txt").write_text("precious")
    (tmp_path / "a.txt").symlink_to(tmp_path / "precious.txt")
    write_atomically(tmp_path / "a.txt", b"new")
    assert (tmp_path / "precious.txt").read_text() == "precious"
    assert (tmp_path / "a.txt").read_text() == "new"


def test_files_have_the_permissions_of_any_new_file(tmp_path):
    (tmp_path / "plain.txt").write_bytes(b"")
    place = write_atomically(tmp_path / "a.txt", b"")
    assert place.stat().st_mode == (tmp_path / "plain.txt").stat().st_mode
