"""Guided capture in the terminal: the display is correct and does not change the result."""

from __future__ import annotations

import io
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace

import pytest
from rich.console import Console

from command_line import leave_out, ospc
from ospc import OnlineCalibrator, open_recording
from ospc.cli.calibration_run import figures
from ospc.cli.terminal import ProgressLine
from ospc.errors import FormatError, OspcError, RecordingError
from ospc.live import LiveCalibrator
from ospc.recording import Frame
from ospc.simulation import SimulationSettings, simulate
from ospc.system import throttle
from ospc.system.throttle import Throttle

needs_main_thread = pytest.mark.skipif(
    threading.current_thread() is not threading.main_thread(), reason="signals reach only the main thread"
)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    place = tmp_path_factory.mktemp("simulated") / "r"
    settings = SimulationSettings(size=(160, 120), frames=24, exposure="sweep", exposure_min_ms=3, exposure_max_ms=12)
    simulate(place, settings)
    return open_recording(place)


@pytest.fixture
def terminal():
    return Console(file=io.StringIO(), width=80, height=30, force_terminal=True, color_system=None)


def test_a_stage_of_unknown_length_shows_no_full_bar(terminal):
    line = ProgressLine(terminal)
    line.show("comparing", 24, 24)
    line.show("estimating", 0, 0)
    assert line.bar.tasks[0].total is None
    terminal.print(line.bar)
    assert "24/24" not in terminal.file.getvalue()
    line.show("comparing", 6, 24)
    assert (line.bar.tasks[0].completed, line.bar.tasks[0].total) == (6, 24)


def test_without_a_page_advice_is_printed_and_the_output_is_that_of_calibrate(recording, tmp_path, monkeypatch):
    leave_out(monkeypatch, "draw", "report")
    done = ospc("live", recording.path, "-o", tmp_path / "live", "--no-page", "--pace", "0")
    assert done.exit_code in (0, 3), done.output
    assert "→ Film something with texture" in done.stderr
    assert "certainty" in done.stderr
    # Without a terminal, nothing is computed for the display.
    monkeypatch.setattr(OnlineCalibrator, "status", property(lambda _: pytest.fail("asked for the status")))
    assert ospc("calibrate", recording.path, "-o", tmp_path / "command").exit_code == done.exit_code
    for file in (tmp_path / "command").iterdir():
        assert (tmp_path / "live" / file.name).read_bytes() == file.read_bytes(), file.name


class FakeCamera:
    """A camera that delivers the frames of a recording, and optionally fails at the end."""

    name, notes = "fake", ("fake: a camera",)

    def __init__(self, recording, failure=None):
        self._recording, self._failure = recording, failure

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def __iter__(self):
        for frame in self._recording:
            yield Frame.of_array(frame.image, frame.exposure_ms, index=frame.index, stamp_s=frame.stamp_s)
        if self._failure is not None:
            raise self._failure


@pytest.mark.parametrize("failure", [None, RecordingError("the cable was pulled")])
def test_the_result_of_a_camera_is_written_whatever_happens(recording, tmp_path, monkeypatch, failure):
    leave_out(monkeypatch, "draw", "report")
    monkeypatch.setattr("ospc.recording.live.open_camera", lambda *_: FakeCamera(recording, failure))
    done = ospc("live", "opencv:0", "-o", tmp_path / "out", "--no-page", "-q")
    known = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert known["counts"]["frames"] == len(recording)
    assert len((tmp_path / "out" / "times.txt").read_text().splitlines()) == len(recording)
    assert known["partial"] == (failure is not None)
    if failure is None:
        assert done.exit_code in (0, 3)
    else:
        assert "the cable was pulled" in str(done.exception)


def test_the_result_of_a_camera_is_written_even_if_the_state_does_not_fit(recording, tmp_path, monkeypatch):
    def fails(_live, path):
        raise FormatError(f"{path}: cannot be written (No space left on device); free some space")

    leave_out(monkeypatch, "draw", "report")
    monkeypatch.setattr("ospc.recording.live.open_camera", lambda *_: FakeCamera(recording))
    monkeypatch.setattr(LiveCalibrator, "save_state", fails)
    done = ospc("live", "opencv:0", "-o", tmp_path / "out", "--no-page")
    assert "no state was saved: " in done.stderr
    assert json.loads((tmp_path / "out" / "calibration.json").read_text())["counts"]["frames"] == len(recording)


@pytest.fixture
def stalled(recording, tmp_path):
    """A recording with a gap of one hour after the twelfth frame."""
    shutil.copytree(recording.path, tmp_path / "stalled")
    lines = (tmp_path / "stalled" / "times.txt").read_text().splitlines()
    frames = [line.split() for line in lines if not line.startswith("#")]
    late = [[name, f"{float(stamp_s) + 3600 * (i >= 12):.6f}", ms] for i, (name, stamp_s, ms) in enumerate(frames)]
    (tmp_path / "stalled" / "times.txt").write_text("".join(" ".join(line) + "\n" for line in late))
    return tmp_path / "stalled"


def waiting_long(then):
    """Return a replacement for sleep that calls a function before a long sleep."""
    sleep = time.sleep

    def slept(duration_s):
        if duration_s > 5:
            then()
        sleep(duration_s)

    return slept


def check_kept(out):
    known = json.loads((out / "calibration.json").read_text())
    assert known["partial"]
    assert known["counts"]["frames"] == 12
    assert (out / "state.ospc").exists()


@needs_main_thread
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_end_a_waiting_capture_and_keep_the_result(stalled, tmp_path, monkeypatch, number):
    leave_out(monkeypatch, "draw", "report")
    soon = threading.Timer(0.2, os.kill, (os.getpid(), number))
    monkeypatch.setattr(time, "sleep", waiting_long(soon.start))
    # The tests themselves may run under nohup.
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    try:
        assert ospc("live", stalled, "-o", tmp_path / "out", "--no-page").exit_code == 130
    finally:
        signal.signal(signal.SIGHUP, before)
    check_kept(tmp_path / "out")


@needs_main_thread
def test_nohup_keeps_the_capture_running(recording, tmp_path, monkeypatch):
    leave_out(monkeypatch, "draw", "report")

    def hung_up(frames, _pace):
        for frame in frames:
            if frame.index == 5:
                os.kill(os.getpid(), signal.SIGHUP)
            yield frame

    monkeypatch.setattr("ospc.live.capture.replayed", hung_up)
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        assert ospc("live", recording.path, "-o", tmp_path / "out", "--no-page").exit_code in (0, 3)
    finally:
        signal.signal(signal.SIGHUP, before)
    assert json.loads((tmp_path / "out" / "calibration.json").read_text())["counts"]["frames"] == len(recording)


PROGRAM = """
import fcntl, signal, sys, termios, time
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # the tests themselves may run under nohup
sleep = time.sleep
time.sleep = lambda duration_s: (duration_s > 5 and print("waiting", flush=True), sleep(duration_s))
from ospc.cli.main import main
main()
"""


def test_a_closed_terminal_ends_the_capture_and_keeps_the_result(stalled, tmp_path):
    ours, theirs = os.openpty()
    streams = dict.fromkeys(("stdin", "stdout", "stderr"), theirs)
    words = ["live", stalled, "-o", tmp_path / "out", "--no-page"]
    running = subprocess.Popen([sys.executable, "-c", PROGRAM, *words], start_new_session=True, **streams)
    os.close(theirs)
    shown = b""
    while b"waiting" not in shown:
        shown += os.read(ours, 1000)
    time.sleep(0.5)  # a signal before the sleep starts would be handled only after it
    os.close(ours)
    assert running.wait(30) == 130
    check_kept(tmp_path / "out")
    assert (tmp_path / "out" / "report.html").exists()


@pytest.mark.parametrize("source", ["nothing/there", "a_camera"])
def test_sources_that_are_neither_recording_nor_camera_are_refused(source, tmp_path):
    done = ospc("live", source, "-o", tmp_path / "out", "--no-page")
    assert isinstance(done.exception, OspcError)
    assert "opencv:" in str(done.exception)


def test_a_mask_applies_to_recordings_only(tmp_path):
    assert ospc("live", "opencv:0", "-o", tmp_path / "out", "--no-page", "--roi", "0,0,9,9").exit_code == 2
    assert ospc("live", "opencv:0", "-o", tmp_path / "out", "--no-page", "--port", 8080).exit_code == 2


def test_slow_updates_are_rare(monkeypatch):
    now_s = [100.0]
    monkeypatch.setattr(throttle.time, "monotonic", lambda: now_s[0])
    waiting = Throttle(0.5, 0.1)
    assert waiting.due
    with waiting.timed():
        now_s[0] += 1.0
    now_s[0] += 9.9
    assert not waiting.due
    now_s[0] += 0.2
    assert waiting.due
    with waiting.timed():
        pass
    assert not waiting.due
    now_s[0] += 0.6
    assert waiting.due


def test_small_spreads_are_not_rounded_to_nothing(recording):
    status = OnlineCalibrator().status
    progress = replace(status.progress, pairs=3, response_sigma=0.00042, vignette_sigma=0.0123456)
    assert figures(replace(status, progress=progress)) == "3 pairs  g ±0.00042  V ±0.012"
