"""Live: nothing waits, nothing queues, nothing is lost; whatever thread, callback or coroutine frames come from."""

import asyncio
import gc
import threading
import time

import numpy as np
import pytest

from ospc.errors import FrameError, OspcError, SettingError
from ospc.live import LiveCalibrator
from ospc.live.watch import Watch
from ospc.recording import Frame


class Held:
    """Looks that wait until they are let go."""

    def __init__(self, monkeypatch):
        self.go, self.begun = threading.Event(), threading.Event()
        self.seen = []

        def look(watch, frame):
            self.begun.set()
            assert self.go.wait(10)
            self.seen.append(frame)
            return True

        monkeypatch.setattr(Watch, "look", look)


def grey(value=0, size=(48, 64)):
    return Frame.of_array(np.full(size, value, np.uint8), 1.0)


def test_while_the_background_is_busy_frames_are_let_go_and_counted(monkeypatch):
    held = Held(monkeypatch)
    with LiveCalibrator() as live:
        assert live.push(grey(0))
        assert held.begun.wait(10)
        assert not any(live.push(grey(i)) for i in range(1, 200))
        assert (live.status.frames, live.status.busy, live.status.looked) == (200, 199, 0)
        held.go.set()
    assert len(held.seen) == live.status.looked == 1


def holds(frame, shape):
    """Return whether a frame, which may be of another test and broken on purpose, holds an image of this shape."""
    try:
        return frame.load().shape == shape
    except FrameError:
        return False


def test_no_more_than_one_image_is_held_however_many_are_pushed(monkeypatch):
    held = Held(monkeypatch)
    shape = (37, 53)
    with LiveCalibrator() as live:
        for i in range(300):
            live.push(grey(i % 200, shape))
        gc.collect()
        kept = [a for a in gc.get_objects() if isinstance(a, Frame) and holds(a, shape)]
        assert len(kept) <= 1
        held.go.set()


def test_every_frame_is_either_looked_at_or_counted_as_passed_over(cameras):
    with LiveCalibrator() as live:
        looked = sum(live.push(frame) for frame in cameras.before)
    status = live.status
    assert status.frames == len(cameras.before)
    assert status.looked == looked
    assert status.unusable == 0


def test_a_buffer_may_be_filled_anew(monkeypatch):
    held = Held(monkeypatch)
    buffer = np.full((48, 64), 7, np.uint8)
    with LiveCalibrator() as live:
        live.push(Frame.of_array(buffer, 1.0))
        buffer[:] = 99
        held.go.set()
    assert held.seen[0].image.max() == 7


def test_it_answers_while_frames_come_and_keeps_the_answer(cameras):
    with LiveCalibrator() as live:
        for frame in cameras.before[:40]:
            while not live.push(frame):
                time.sleep(0.002)
        found = live.calibration()
    assert found.response is not None
    assert live.latest is found
    assert live.status.looked >= 40


def test_frames_may_come_from_another_thread_or_a_coroutine(cameras):
    async def camera():
        for frame in cameras.before[:5]:
            await asyncio.sleep(0)
            yield frame

    with LiveCalibrator() as live:
        thread = threading.Thread(target=live.follow, args=(cameras.before[:5],))
        thread.start()
        asyncio.run(live.follow_async(camera()))
        thread.join()
        live.follow((f.image, f.exposure_ms) for f in cameras.before[:5])
        assert live.status.frames == 15


def test_frames_that_cannot_be_used_are_counted_with_their_reason():
    with LiveCalibrator() as live:
        live.push(Frame.of_array(np.zeros((48, 64), np.uint8), float("nan")))
        with pytest.raises(OspcError, match="no frame could be used"):
            live.calibration()
        assert live.status.unusable == 1
        assert "exposure" in live.status.reasons[-1]


def test_what_goes_wrong_in_the_background_is_said(monkeypatch):
    def look(watch, frame):
        raise RuntimeError("out of luck")

    monkeypatch.setattr(Watch, "look", look)
    live = LiveCalibrator()
    live.push(grey())
    live._worker.join(10)
    with pytest.raises(OspcError, match="out of luck"):
        live.push(grey())
    with pytest.raises(OspcError, match="out of luck"):
        live.calibration()
    live.close()


def test_closed_it_takes_no_more(cameras):
    live = LiveCalibrator()
    live.push(cameras.before[0])
    live.close()
    live.close()
    with pytest.raises(OspcError, match="closed"):
        live.push(cameras.before[1])


def test_the_slow_preset_is_refused():
    with pytest.raises(SettingError, match="paper"):
        LiveCalibrator("paper")
