"""The live calibrator never blocks, queues little and loses nothing, with threads, callbacks and coroutines."""

import asyncio
import multiprocessing
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from calibrations import calibration
from ospc.calibrator import OnlineCalibrator, drive
from ospc.correspondence.frame_sampling import FrameSampler
from ospc.engine.engine import Engine
from ospc.engine.state import keeping_latest_calibrations, response_before_change
from ospc.errors import FrameError, OspcError, SettingError
from ospc.live import LiveCalibrator
from ospc.live import calibrator as live_calibrator
from ospc.photometry.verdict import Verdict
from ospc.recording import Frame
from ospc.settings import DefaultSettings
from ospc.settings.methods import MAX_EPOCH_CALIBRATIONS


class Held:
    """Blocks the processing of frames until released."""

    def __init__(self, monkeypatch):
        self.go, self.begun = threading.Event(), threading.Event()
        self.pushed = []

        def push(engine, frame):
            self.begun.set()
            assert self.go.wait(10)
            self.pushed.append(frame)
            return True

        monkeypatch.setattr(Engine, "push", push)


@pytest.fixture
def soon(monkeypatch):
    """Let advice follow soon, not after the usual pause."""
    monkeypatch.setattr(live_calibrator, "ADVICE_S", 0.01)


def grey(value=0, size=(48, 64)):
    return Frame.of_array(np.full(size, value, np.uint8), 1.0)


def test_beyond_the_queue_images_are_dropped_and_counted(monkeypatch):
    monkeypatch.setattr(live_calibrator, "QUEUE_BYTES", 3 * 48 * 64)
    held = Held(monkeypatch)
    with LiveCalibrator() as live:
        assert live.push(grey(0))
        assert held.begun.wait(10)
        taken = [live.push(grey(i)) for i in range(1, 200)]
        assert sum(taken) == 2
        assert (live.status.frames, live.status.dropped) == (200, 197)
        held.go.set()


def test_while_frames_wait_no_other_is_thought_unneeded(monkeypatch):
    """A waiting frame may raise a suspicion, after which every frame is needed."""
    held = Held(monkeypatch)
    with LiveCalibrator() as live:
        assert live.push(grey(0))
        assert held.begun.wait(10)
        monkeypatch.setattr(Engine, "may_need_image", lambda engine, number: False)
        assert live.push(grey(1))
        held.go.set()
        live.wait(1)
    assert [frame.image.max() for frame in held.pushed] == [0, 1]


def test_the_buffer_of_a_mask_may_be_filled_anew(monkeypatch):
    held = Held(monkeypatch)
    mask = np.zeros((48, 64), bool)
    with LiveCalibrator() as live:
        live.push(Frame.of_array(np.full((48, 64), 7, np.uint8), 1.0, mask=mask))
        mask[:] = True
        held.go.set()
        live.wait()
    assert not held.pushed[0].mask.any()


@pytest.mark.parametrize("most", [-1, "all", float("nan")])
def test_it_waits_for_no_impossible_number_of_frames(most):
    with LiveCalibrator() as live, pytest.raises(SettingError, match="give a number of frames"):
        live.wait(most)


def test_a_source_is_a_dictionary_and_a_prior_a_calibration_opened_for_it():
    with pytest.raises(SettingError, match="source is of type str"):
        LiveCalibrator(source="robot 1")
    for wrong in (calibration(), "camera.ospc"):
        with pytest.raises(SettingError, match=r"give PriorCalibration\.open"):
            OnlineCalibrator(prior=wrong)


def test_a_buffer_may_be_filled_anew(monkeypatch):
    held = Held(monkeypatch)
    buffer = np.full((48, 64), 7, np.uint8)
    with LiveCalibrator() as live:
        live.push(Frame.of_array(buffer, 1.0))
        buffer[:] = 99
        assert held.begun.wait(10)
        held.go.set()
    assert held.pushed[0].image.max() == 7


def at_20_frames_per_s(frames):
    return [replace(frame, index=number, stamp_s=number / 20) for number, frame in enumerate(frames)]


def push_and_await(live, frame):
    live.push(frame)
    live.wait(1)


@pytest.fixture(scope="module")
def played(cameras):
    """A recording played without dropped frames."""
    with LiveCalibrator() as live:
        for frame in at_20_frames_per_s(cameras.before):
            push_and_await(live, frame)
        return live.calibration(), live.status, live.latest


@pytest.fixture(scope="module")
def commanded(cameras):
    """A calibrator driven over the same frames as by the commands."""
    calibrator = OnlineCalibrator()
    drive(calibrator, at_20_frames_per_s(cameras.before))
    return calibrator


def test_without_dropped_frames_the_result_is_that_of_the_command(played, commanded, cameras):
    found, status, latest = played
    assert (status.frames, status.dropped, status.unusable) == (len(cameras.before), 0, 0)
    other = commanded.calibration()
    assert found.verdicts == other.verdicts
    np.testing.assert_array_equal(found.response.inverse_table, other.response.inverse_table)
    np.testing.assert_array_equal(found.vignette.image(), other.vignette.image())
    assert latest is found


def test_frames_that_cannot_be_used_are_counted_and_explained_as_by_the_command(cameras, monkeypatch):
    """This includes frames that are not needed."""

    def torn():
        raise FrameError("torn.png: cannot be decoded")

    exposures_ms = [-1.0 if i % 3 == 1 else 4.0 + i for i in range(25)]
    frames = [replace(f, exposure_ms=e) for f, e in zip(cameras.before, exposures_ms, strict=False)]
    frames[0] = replace(frames[0], load=torn, threads=False)
    monkeypatch.setattr(DefaultSettings, "sampler", lambda _settings: FrameSampler(1, 99, 99, 1000, 0))
    calibrator = OnlineCalibrator(correct_lag="estimated")
    drive(calibrator, frames)
    assert calibrator.processed < len(frames) // 2
    with LiveCalibrator(correct_lag="estimated") as live:
        for frame in frames:
            push_and_await(live, frame)
        assert live.calibration().counts == calibrator.calibration().counts
        assert live.status.reasons == calibrator.status.skipped
        assert live.status.unusable == live.calibration().counts["skipped"] == 9


def test_an_unchanged_camera_is_known_and_stays_so(played):
    _, status, _ = played
    assert status.converged
    assert status.converged_after <= 110
    assert len(status.epochs) == 1
    assert ["known" in note for note in status.notes] == [True]


@pytest.fixture(scope="module")
def changed(commanded, cameras, tmp_path_factory):
    """A run that continues with another lens."""
    calibrator = OnlineCalibrator.load_state(commanded.save_state(tmp_path_factory.mktemp("halfway") / "state.ospc"))
    drive(calibrator, at_20_frames_per_s([*cameras.before, *cameras.before[::-1], *cameras.after]))
    return calibrator


def test_another_lens_is_detected_and_calibrated_again(changed, cameras):
    first, second = changed.epochs
    assert first.change.part == "vignette"
    changed_at = 2 * len(cameras.before)
    assert abs(second.first_frame - changed_at) <= 30
    assert first.change.found - changed_at <= 200  # ten seconds at 20 frames/s
    assert first.calibration.counts["frames"] == second.first_frame
    assert first.calibration.counts["pairs"] < second.first_frame
    corner = np.array([[239.0, 179.0]])
    assert first.calibration.vignette.at(corner)[0] == pytest.approx(0.85, abs=0.03)
    found = changed.calibration()
    assert found.vignette.at(corner)[0] == pytest.approx(0.45, abs=0.03)
    assert any("vignette changed" in warning for warning in found.warnings)


def test_with_another_lens_the_response_stays_known(changed):
    first, found = changed.epochs[0], changed.calibration()
    begins = f"starting from frames 0 to {first.last_frame}"
    assert begins in found.verdicts["response"].reason
    assert begins not in found.verdicts["vignette"].reason
    alone = changed._method.calibration(changed._run.exposures.findings().evidence.used(changed._run.exposures.table))
    assert np.median(found.response.log_sigma) < np.median(alone.response.log_sigma)
    # Even if no frame after the change allows a fit.
    unknown = Verdict("not identifiable", "no exposure changes")
    verdicts = {"response": unknown, "vignette": unknown}
    fitless = replace(found, response=None, vignette=None, verdicts=verdicts, warnings=())
    before = response_before_change([first], changed._run.exposures.table.log_recorded)
    continued = before.continued(fitless, None)
    assert continued.verdicts["response"].state == "marginal"
    assert "but the new frames do not check it (no exposure changes)" in continued.verdicts["response"].reason
    assert continued.verdicts["vignette"] == unknown
    steps = [np.diff(np.log(c.response.inverse([0.3, 0.7]))) for c in (continued, first.calibration)]
    np.testing.assert_allclose(*steps, rtol=0.01)


def test_epochs_survive_a_saved_state(changed, tmp_path):
    again = OnlineCalibrator.load_state(changed.save_state(tmp_path / "state.ospc"))
    assert [e.change for e in again.epochs] == [e.change for e in changed.epochs]
    assert again.epochs[0].calibration.as_dict() == changed.epochs[0].calibration.as_dict()


def test_the_state_hardly_grows_with_the_number_of_epochs(changed, tmp_path):
    calibrator = OnlineCalibrator.load_state(changed.save_state(tmp_path / "state.ospc"))
    first, sizes = calibrator.epochs[0], []
    for count in (1, MAX_EPOCH_CALIBRATIONS, 3 * MAX_EPOCH_CALIBRATIONS):
        calibrator._run.epochs = []
        for frame in range(count):
            own = replace(
                first, first_frame=frame, last_frame=frame, corrected_lag_frames=2, wrong_exposures=(frame,)
            )
            calibrator._run.epochs = keeping_latest_calibrations([*calibrator._run.epochs, own])
        calibrator._run.exposures._first_frame = count
        sizes.append(calibrator.save_state(tmp_path / "state.ospc").stat().st_size)
    assert sizes[1] - sizes[0] > 20_000
    assert sizes[2] - sizes[1] < 5_000
    again = OnlineCalibrator.load_state(tmp_path / "state.ospc")
    for epoch, other in zip(again.epochs, calibrator.epochs, strict=True):
        assert replace(epoch, calibration=None) == replace(other, calibration=None)


def test_a_change_that_the_complete_fit_disproves_is_none_and_a_resumed_run_agrees(commanded, cameras, tmp_path):
    """The fit that raised the suspicion has a wrong vignette, as if it left out glare."""
    calibrator = OnlineCalibrator.load_state(commanded.save_state(tmp_path / "halfway.ospc"))
    frames = at_20_frames_per_s([*cameras.before, *cameras.before[::-1]])
    drive(calibrator, frames[:95])  # to the next quick fit, which would replace the wrong one
    detector, fit = calibrator._method._changes, calibrator._method._quick_fit.fit
    wrong = np.where(np.arange(len(fit.parameters)) < fit.vignette_part.start, 1, 3) * fit.parameters
    detector.reference, detector.since = replace(fit, parameters=wrong), len(cameras.before)
    detector.neighbours.errors, detector.neighbours.effects = [0.002] * 12, [0.002] * 12
    drive(calibrator, frames[:125])
    again = OnlineCalibrator.load_state(calibrator.save_state(tmp_path / "suspicious.ospc"))
    for one in (calibrator, again):
        drive(one, frames)
        assert len(one.epochs) == 1
        assert one._method._changes.complete_before >= len(cameras.before)
        assert not one._method._changes.is_suspicious
    states = [one.save_state(tmp_path / name).read_bytes() for one, name in ((calibrator, "a"), (again, "b"))]
    assert states[0] == states[1]


def test_frames_may_come_from_another_thread_or_a_coroutine(cameras):
    async def film(live):
        for frame in cameras.before[:5]:
            await asyncio.sleep(0)
            live.push(frame)

    with LiveCalibrator() as live:
        thread = threading.Thread(target=lambda: [live.push(frame) for frame in cameras.before[:5]])
        thread.start()
        asyncio.run(film(live))
        thread.join()
        assert live.status.frames == 10


def test_many_threads_may_push_into_one_calibrator(cameras):
    calibrator = OnlineCalibrator()
    frames = cameras.before[:24]
    parts = [frames[i::4] for i in range(4)]
    threads = [threading.Thread(target=lambda part: [calibrator.push(f) for f in part], args=(p,)) for p in parts]
    for thread in threads:
        thread.start()
    asked = [calibrator.calibration() for _ in range(2) if calibrator.frames]
    for thread in threads:
        thread.join(60)
    assert calibrator.frames == len(frames)
    assert calibrator.calibration().counts["skipped"] == 0
    assert all(c.counts["frames"] <= len(frames) for c in asked)


def _in_child(calibrator, live, frames, answers):
    for frame in frames:
        calibrator.push(frame)
    answers.put(calibrator.frames)
    try:
        live.push(frames[0])
    except OspcError as error:
        answers.put(str(error))


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_fork_in_mid_run_is_survived_or_refused_with_a_sentence(cameras):
    calibrator = OnlineCalibrator()
    for frame in cameras.before[:12]:
        calibrator.push(frame)
    context = multiprocessing.get_context("fork")
    answers = context.Queue()
    with LiveCalibrator() as live:
        live.push(cameras.before[0])
        child = context.Process(target=_in_child, args=(calibrator, live, cameras.before[12:18], answers))
        child.start()
        try:
            assert answers.get(timeout=60) == 18
            assert "fork" in answers.get(timeout=60)
        finally:
            child.kill()
            child.join()


def _all_in_child(live, answers):
    uses = (
        lambda: live.push(grey()),
        live.wait,
        live.calibration,
        lambda: live.save_state("never"),
        lambda: live.status,
    )
    for use in uses:
        with pytest.raises(OspcError, match="fork"):
            use()
    live.close()
    answers.put("refused")


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_fork_while_another_thread_holds_the_locks_is_refused_and_not_waited_for():
    context = multiprocessing.get_context("fork")
    answers, held, go = context.Queue(), threading.Event(), threading.Event()

    def hold():
        with live._changed, live._engine._lock:
            held.set()
            go.wait(60)

    with LiveCalibrator() as live:
        holding = threading.Thread(target=hold)
        holding.start()
        assert held.wait(10)
        child = context.Process(target=_all_in_child, args=(live, answers))
        child.start()
        try:
            assert answers.get(timeout=30) == "refused"
        finally:
            go.set()
            holding.join()
            child.kill()
            child.join()


@pytest.mark.parametrize("exposure_ms", [float("nan"), None])
def test_frames_that_cannot_be_used_are_counted_with_their_reason(exposure_ms):
    with LiveCalibrator() as live:
        live.push(Frame.of_array(np.zeros((48, 64), np.uint8), exposure_ms))
        with pytest.raises(OspcError, match="no frame could be used"):
            live.calibration()
        assert live.status.unusable == 1
        assert live.status.reasons[-1].startswith("frame 0: ")
        assert "exposure" in live.status.reasons[-1]


@pytest.mark.parametrize("threads", [False, True])
@pytest.mark.parametrize("error", [RuntimeError("no answer"), MemoryError()])
def test_a_loader_that_fails_in_any_way_costs_one_frame_and_not_the_run(soon, threads, error):
    def lost():
        raise error

    with LiveCalibrator() as live:
        for load in (grey().load, lost, grey().load):
            live.push(replace(grey(), load=load, threads=threads))
        live.wait(0)
        assert (live.status.frames, live.status.unusable) == (3, 1)
        assert (str(error) or "MemoryError") in live.status.reasons[-1]


def test_the_advice_says_why_most_of_the_latest_frames_cannot_be_used(soon):
    with LiveCalibrator() as live:
        live.push(grey(size=(40, 64)))
        for _ in range(20):
            live.push(grey())
        live.wait(0)
        assert live.status.instruction.kind == "unusable"
        assert "64×48 pixels, but the first frame has 64×40" in live.status.advice


def test_a_driver_that_hesitates_does_not_change_the_advice(soon):
    with LiveCalibrator() as live:
        for number in range(30):
            live.push(replace(grey(), exposure_ms=float("nan") if number % 3 == 0 else 1.0))
        live.wait(0)
        assert live.status.unusable == 10
        assert live.status.instruction.kind == "begin"


def test_both_threads_count_only_while_they_hold_the_lock():
    held = []

    class Watched(LiveCalibrator):
        def __setattr__(self, name, value):
            if name in ("_frames", "_dropped", "_unusable") and hasattr(self, "_worker"):
                held.append(self._changed._is_owned())
            super().__setattr__(name, value)

    with Watched() as live:
        live.push(Frame.of_array(np.zeros((48, 64), np.uint8), float("nan")))
        live.wait()
        assert live.status.unusable == 1
    assert len(held) >= 2
    assert all(held)


def test_errors_in_the_background_are_reported(monkeypatch):
    def push(engine, frame):
        raise RuntimeError("out of luck")

    monkeypatch.setattr(Engine, "push", push)
    live = LiveCalibrator()
    live.push(grey())
    live._worker.join(10)
    with pytest.raises(OspcError, match="out of luck"):
        live.push(grey())
    with pytest.raises(OspcError, match="out of luck"):
        live.calibration()
    live.close()


@pytest.fixture
def ask_together(monkeypatch):
    """Return a function that requests calibrations from several threads while the calibrator is busy."""

    def ask(live, count):
        held, answers = Held(monkeypatch), []

        def one():
            try:
                answers.append(live.calibration())
            except OspcError as error:
                answers.append(error)

        live.push(grey())
        assert held.begun.wait(10)
        threads = [threading.Thread(target=one, daemon=True) for _ in range(count)]
        for thread in threads:
            thread.start()
        while len(live._asked) < count:
            time.sleep(0.001)
        held.go.set()
        for thread in threads:
            thread.join(10)
        return answers

    return ask


def test_all_that_ask_together_are_answered_even_if_the_next_estimate_fails(ask_together, monkeypatch):
    known = calibration()
    estimates = iter([known])
    with LiveCalibrator() as live:
        monkeypatch.setattr(live._engine, "calibration", lambda: next(estimates))
        assert ask_together(live, 3) == [known] * 3


def test_all_that_ask_learn_why_the_background_failed(ask_together, monkeypatch):
    failure = np.linalg.LinAlgError("Singular matrix")

    def fail(_pushed):
        raise failure

    with LiveCalibrator() as live:
        monkeypatch.setattr(live._found, "estimate", fail)
        answers = ask_together(live, 2)
    assert [str(answer) for answer in answers] == ["the background thread failed: Singular matrix"] * 2
    assert [answer.__cause__ for answer in answers] == [failure] * 2


def test_a_request_does_not_wait_for_later_frames(monkeypatch):
    asked, pushed = threading.Event(), []

    def push(engine, frame):
        assert asked.wait(10)
        if len(pushed) < 500:  # a camera that is always one frame ahead
            pushed.append(live.push(grey()))
        return True

    monkeypatch.setattr(Engine, "push", push)
    with LiveCalibrator() as live, ThreadPoolExecutor() as threads:
        monkeypatch.setattr(live._found, "estimate", lambda _pushed: len(pushed))
        live.push(grey())
        answer = threads.submit(live.calibration)
        while not live._asked:
            time.sleep(0.001)
        asked.set()
        assert answer.result(10) == 1


def test_closed_it_takes_no_more_and_its_thread_ends(cameras):
    live = LiveCalibrator()
    live.push(cameras.before[0])
    live.close()
    live.close()
    assert not live._worker.is_alive()
    with pytest.raises(OspcError, match="closed"):
        live.push(cameras.before[1])


def test_the_slow_preset_is_refused():
    with pytest.raises(SettingError, match="paper"):
        LiveCalibrator("paper")


def test_wait_raises_the_error_of_the_background(monkeypatch):
    held = Held(monkeypatch)

    def fails(*_arguments):
        assert held.go.wait(10)
        raise ArithmeticError("no number")

    monkeypatch.setattr(LiveCalibrator, "_process_next", fails)
    live = LiveCalibrator()
    live.push(grey())
    answers = []

    def wait():
        with pytest.raises(OspcError, match="the background thread failed: no number"):
            live.wait()
        answers.append("failed")

    waiting = threading.Thread(target=wait, daemon=True)
    waiting.start()
    time.sleep(0.05)  # by now it is waiting, and nothing else wakes it
    held.go.set()
    waiting.join(10)
    assert answers == ["failed"]
    with pytest.raises(OspcError, match="the background thread failed"):
        live.push(grey())


@pytest.mark.parametrize("goal", [0, -1, float("nan")])
def test_a_goal_that_nothing_reaches_is_refused(goal):
    with pytest.raises(SettingError, match="goal"):
        LiveCalibrator(goal=goal)


def test_closing_ends_all_threads(cameras):
    before = set(threading.enumerate())
    with LiveCalibrator() as live:
        for frame in at_20_frames_per_s(cameras.before[:6]):
            push_and_await(live, frame)
        assert len(set(threading.enumerate()) - before) > 1
    assert not set(threading.enumerate()) - before


_PROGRAM_THAT_FORGETS_TO_CLOSE = """
import threading, time
import numpy as np
from ospc import Frame, LiveCalibrator
from ospc.engine.engine import Engine

begun = threading.Event()

def push(engine, frame):
    begun.set()
    time.sleep(0.5)
    print("processed")
    return True

Engine.push = push
live = LiveCalibrator()
live.push(Frame.of_array(np.zeros((48, 64), np.uint8), 1.0))
begun.wait()
"""


def test_at_the_end_of_the_program_the_thread_completes_its_work():
    """Killed inside OpenCV, it would abort the process."""
    command = [sys.executable, "-c", _PROGRAM_THAT_FORGETS_TO_CLOSE]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert (ended.stdout, ended.stderr) == ("processed\n", "")
