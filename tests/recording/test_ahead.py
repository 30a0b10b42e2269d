"""Decoding ahead is bounded and gives the same frames and errors, whichever frames are predicted."""

import threading
from dataclasses import replace
from time import sleep

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ospc.errors import FrameError
from ospc.recording import stream
from ospc.recording.frame import Frame
from ospc.recording.stream import decoded_ahead


class Counted:
    """Frames that record when and by which threads they are decoded and verified."""

    def __init__(self, count, *, threads=True, broken=()):
        self.decoded, self.verified, self.by = [], [], set()
        self.count, self.threads, self.broken = count, threads, set(broken)

    def __iter__(self):
        for index in range(self.count):
            yield Frame(
                index, float(index), 1.0, f"frame {index}", self._load(index), 255, self._verify(index),
                threads=self.threads,
            )  # fmt: skip

    def _load(self, index):
        def load():
            self.by.add(threading.current_thread())
            self.decoded.append(index)
            if index in self.broken:
                raise FrameError(f"frame {index}: broken")
            return np.full((4, 4), index % 256, np.uint8)

        return load

    def _verify(self, index):
        def verify():
            self.verified.append(index)
            if index in self.broken:
                raise FrameError(f"frame {index}: broken")

        return verify


def outcome(frame):
    try:
        if frame.verify is not None:
            frame.verify()
        return int(frame.image[0, 0])
    except FrameError as error:
        return str(error)


@given(st.integers(0, 40), st.sets(st.integers(0, 39)), st.sets(st.integers(0, 39)), st.sets(st.integers(0, 39)))
def test_frames_and_errors_are_the_same_whatever_is_foreseen(count, foreseen, read, broken):
    given_last = -1

    def wanted(places):
        return given_last + places in foreseen

    found = {}
    for frame in decoded_ahead(Counted(count, broken=broken), wanted):
        given_last = frame.index
        found[frame.index] = outcome(frame) if frame.index in read else None
    plain = {f.index: outcome(f) if f.index in read else None for f in Counted(count, broken=broken)}
    assert found == plain
    assert list(found) == list(plain)


@pytest.mark.parametrize("wanted", [True, False])
def test_frames_may_be_read_after_the_last(wanted):
    def slow(call):
        return lambda: (sleep(0.002), call())[1]

    slowly = [replace(f, load=slow(f.load), verify=slow(f.verify)) for f in Counted(20)]
    frames = list(decoded_ahead(slowly, lambda _places: wanted))
    assert [outcome(frame) for frame in frames] == list(range(20))


def test_wanted_images_are_decoded_once_and_by_another_thread():
    frames = Counted(30)
    for frame in decoded_ahead(frames, lambda _places: True):
        assert frame.image[0, 0] == frame.index
    assert sorted(frames.decoded) == list(range(30))
    assert threading.main_thread() in frames.by  # the first frame, which could not be predicted
    assert len(frames.by) == 2


def test_only_so_many_images_are_decoded_ahead(monkeypatch):
    monkeypatch.setattr(stream, "_DECODED", 2)
    frames = Counted(100)
    for frame in decoded_ahead(frames, lambda _places: True):
        _ = frame.image
        assert len(frames.decoded) <= frame.index + 1 + 2


def test_images_nobody_foresees_are_not_decoded_but_looked_for(monkeypatch):
    monkeypatch.setattr(stream, "_VERIFIED", 8)
    frames = Counted(100)
    for frame in decoded_ahead(frames, lambda _places: False):
        frame.verify()
        assert len(frames.verified) <= frame.index + 1 + 8
    assert frames.decoded == []
    assert sorted(frames.verified) == list(range(100))


def test_frames_of_one_thread_are_left_to_it():
    frames = Counted(10, threads=False)
    assert [int(f.image[0, 0]) for f in decoded_ahead(frames, lambda _places: True)] == list(range(10))
    assert frames.by == {threading.current_thread()}


def test_giving_up_early_ends_the_thread():
    before = threading.active_count()
    ahead = decoded_ahead(Counted(50), lambda _places: True)
    for _ in range(5):
        next(ahead)
    ahead.close()
    assert threading.active_count() == before


def test_errors_unrelated_to_frames_are_raised_after_the_frames_before_them():
    def failing():
        yield from Counted(5)
        raise OSError("gone")

    ahead = decoded_ahead(failing(), lambda _places: True)
    assert [next(ahead).index for _ in range(5)] == list(range(5))
    with pytest.raises(OSError, match="gone"):
        next(ahead)


def test_other_parts_of_a_frame_stay_as_they_are():
    plain = [replace(f, mask=np.ones((4, 4), bool)) for f in Counted(5)]
    for frame, before in zip(decoded_ahead(plain, lambda _places: True), plain, strict=True):
        assert (frame.index, frame.stamp_s, frame.exposure_ms, frame.name) == (
            before.index, before.stamp_s, before.exposure_ms, before.name,
        )  # fmt: skip
        assert frame.mask is before.mask
