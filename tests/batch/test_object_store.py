"""Recordings in object stores, emulated by a folder and by memory."""

from __future__ import annotations

import sys

import pytest

from batch_recordings import QUICK, simulated
from ospc.batch.manifest import Entry, read_manifest
from ospc.batch.object_store import local_copy
from ospc.batch.work import Task, work
from ospc.errors import MissingExtraError, RecordingError

fsspec = pytest.importorskip("fsspec")


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return simulated(tmp_path_factory.mktemp("bucket") / "camera" / "r", 0)


@pytest.fixture
def memory(recording):
    store = fsspec.filesystem("memory")
    store.put(str(recording), "/bucket/camera/r", recursive=True)
    yield store
    store.rm("/bucket", recursive=True)


def test_a_recording_in_a_store_gives_the_same_result_under_the_same_key(recording, memory):
    here = work(Task(0, Entry(str(recording), "camera", QUICK)))
    there = work(Task(0, Entry("memory://bucket/camera/r", "camera", QUICK)))
    assert not there.error
    assert (there.key, there.result) == (here.key, here.result)
    as_file = work(Task(0, Entry(f"file://{recording}", "camera", QUICK)))
    assert as_file.result == here.result


def test_a_copy_is_complete_and_removed_afterwards(recording, memory):
    with local_copy("memory://bucket/camera/r") as place:
        names = {p.relative_to(place).as_posix() for p in place.rglob("*") if p.is_file()}
        assert names == {p.relative_to(recording).as_posix() for p in recording.rglob("*") if p.is_file()}
    assert not place.exists()


def test_a_single_file_is_a_recording_too(memory):
    memory.pipe("/bucket/clip.mp4", b"film")
    with local_copy("memory://bucket/clip.mp4") as place:
        assert (place.name, place.read_bytes()) == ("clip.mp4", b"film")


def test_a_pattern_is_expanded_in_the_store(memory):
    (entry,) = read_manifest("memory://bucket/*/r")
    assert entry.recording.endswith("/bucket/camera/r")
    assert (entry.is_remote, entry.camera) == (True, "camera")


@pytest.mark.parametrize(
    ("address", "said"),
    [
        ("memory://bucket/none", "there is no such file or folder"),
        ("papyrus://bucket/r", "unknown object store"),
        ("s3://bucket/r::zip://evil", "unknown object store"),
        ("adl://bucket/r", "needs another package|cannot be read"),
    ],
)
def test_an_unreachable_address_is_reported(memory, address, said):
    with pytest.raises(RecordingError, match=said), local_copy(address):
        pass


def test_names_that_lead_out_are_refused(monkeypatch, memory):
    with monkeypatch.context() as patch:
        patch.setattr(type(memory), "find", lambda *_a, **_k: {"/bucket/camera/r/../../x": {"size": 1}})
        with pytest.raises(RecordingError, match="leads out of"), local_copy("memory://bucket/camera/r"):
            pass


def test_without_fsspec_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "fsspec", None)
    monkeypatch.setitem(sys.modules, "fsspec.core", None)
    with pytest.raises(MissingExtraError, match=r"ospc\[objects\]"), local_copy("memory://bucket/r"):
        pass
