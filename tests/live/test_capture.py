"""A capture as seen by its page and its caller: it ends on request, and no frame of a recording is dropped."""

from __future__ import annotations

import json
import threading
import time
from dataclasses import replace

import cv2
import numpy as np
import pytest

from ospc.errors import FrameError
from ospc.live.calibrator import LiveCalibrator
from ospc.live.capture import WAITING_FRAMES, Capture, replayed
from ospc.recording import Frame
from ospc.simulation import SimulationSettings, frames

SETTINGS = SimulationSettings(size=(160, 120), frames=30, exposure="sweep", exposure_min_ms=3, exposure_max_ms=12)


@pytest.fixture(scope="module")
def filmed():
    return list(frames(SETTINGS))


def never():
    return False


def test_what_it_shows_is_json_and_grows(filmed):
    with LiveCalibrator() as live:
        capture = Capture(live, out="there")
        before = capture.view()
        pictures = []

        def look():
            pictures.append(capture.picture())
            return False

        capture.run(filmed, look, replayed=True)
        live.wait()
        after = capture.view()
        json.dumps([before, after], allow_nan=False)
    assert before["frames"] == 0
    assert set(before["bars"].values()) == {0.0}
    assert (after["frames"], after["dropped"], after["out"]) == (30, 0, "there")
    assert after["instruction"]["text"] == live.status.advice
    for picture, frame in zip(pictures, filmed, strict=True):
        shown = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_GRAYSCALE)
        assert np.mean(np.abs(shown.astype(float) - frame.image)) < 6


def test_it_ends_where_it_is_asked_to(filmed):
    with LiveCalibrator() as live:
        asked = iter([False, False, True])
        Capture(live).run(filmed, lambda: next(asked), replayed=False)
        assert live.status.frames == 3
        capture = Capture(live)
        capture.finish()
        capture.run(filmed, never, replayed=False)
        assert live.status.frames == 4


def test_frames_of_a_recording_wait_for_the_background(filmed):
    with LiveCalibrator() as live:
        longest = 0

        def watch():
            nonlocal longest
            longest = max(longest, len(live._queue))
            return False

        Capture(live).run(filmed, watch, replayed=True)
        assert longest <= WAITING_FRAMES


def test_a_recording_is_replayed_at_its_pace(filmed):
    begun_s = time.monotonic()
    assert [f.index for f in replayed(filmed[:9], 2.0)] == list(range(9))
    assert 8 / 20 / 2 <= time.monotonic() - begun_s < 2.0
    begun_s = time.monotonic()
    list(replayed(filmed, 0))
    assert time.monotonic() - begun_s < 0.2


def test_a_replay_does_not_wait_for_gaps_between_stamps(filmed, monkeypatch):
    slept_s, clock_s = [], [100.0]

    def sleep(seconds):
        slept_s.append(seconds)
        clock_s[0] += seconds

    monkeypatch.setattr("ospc.live.capture.time.sleep", sleep)
    monkeypatch.setattr("ospc.live.capture.time.monotonic", lambda: clock_s[0])
    stamps_s = (5.0, 6.0, 1.7e9, 1.7e9 + 1, 3.0, 5.0)
    list(replayed([replace(filmed[0], stamp_s=stamp_s) for stamp_s in stamps_s], 1.0))
    assert slept_s == pytest.approx([0, 1, 10, 1, 0, 2])


@pytest.mark.parametrize("looked", [True, False])
def test_only_the_capturing_thread_reads_frames_that_no_other_may_and_few_of_them(filmed, looked, monkeypatch):
    readers = []

    def only_here(frame):
        return replace(frame, load=lambda: readers.append(threading.current_thread()) or frame.image, threads=False)

    def look():
        page = threading.Thread(target=capture.picture)
        if looked:
            page.start()
            page.join()
        return False

    with LiveCalibrator() as live:
        monkeypatch.setattr(live, "push", lambda _frame: None)  # as if no image were needed
        capture = Capture(live)
        capture.run(map(only_here, filmed), look, replayed=True)
    assert readers == [threading.main_thread()] * (len(filmed) if looked else 1)


@pytest.mark.parametrize("threads", [True, False])
def test_a_loader_that_fails_in_any_way_does_not_end_the_capture(filmed, threads):
    def fail():
        raise RuntimeError("the driver has gone")

    with LiveCalibrator() as live:
        capture, pictures = Capture(live), []
        capture.run(
            [replace(filmed[0], load=fail, threads=threads)],
            lambda: pictures.append(capture.picture()),
            replayed=True,
        )
        live.wait()
        assert (pictures, live.status.unusable) == ([None], 1)


def test_a_frame_that_cannot_be_read_shows_nothing():
    def torn():
        raise FrameError("torn")

    with LiveCalibrator() as live:
        capture = Capture(live)
        assert capture.picture() is None
        capture.run([Frame(0, 0.0, 1.0, "torn", torn)], never, replayed=True)
        assert capture.picture() is None
