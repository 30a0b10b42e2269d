"""Atomic writing: the old content or the new, whatever happens."""

from __future__ import annotations

import os

import pytest

from ospc.atomic import write_atomically


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


def test_a_missing_folder_is_an_os_error(tmp_path):
    with pytest.raises(FileNotFoundError):
        write_atomically(tmp_path / "none" / "a.txt", b"")
