"""An external program gets what its mode asks for; whatever it does is a result."""

from __future__ import annotations

import time
from threading import Event, Timer

import numpy as np
import pytest

from ospc.errors import SettingError
from ospc.evaluation.trajectory import read_trajectory
from ospc.odometry.program import Program
from ospc.odometry.run import judged


def judge(program, source, truth, run=0):
    tracked = program.track(source, run, Event())
    stamps = np.asarray(source.recording.stamps_s)
    return judged(tracked, truth, stamps, recording="room", condition=source.condition.name, run=run), tracked


@pytest.fixture
def truth(simulated):
    return read_trajectory(simulated / "groundtruthSync.txt")


@pytest.mark.parametrize("name", ["truth", "none"])
def test_a_run_gets_the_files_of_its_mode_and_is_judged_up_to_a_similarity(make_program, source, truth, name):
    result, _ = judge(make_program(), source(name), truth)
    assert result.outcome == "finished", result.reason
    assert result.poses == 40
    assert result.covered == pytest.approx(1)
    assert result.e_align < 0.01 if name == "truth" else result.e_align > 0.01


@pytest.mark.parametrize(
    ("behaviour", "outcome", "reason"),
    [
        ("sys.exit(3)", "failed", "exit code 3"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "failed", "signal 11"),
        ("pass", "failed", "no result.txt"),
        ("open('result.txt', 'w').write('lost\\n')", "failed", "cannot be read"),
        (
            "open('result.txt', 'w').writelines(f'{i / 10} nan nan nan 0 0 0 1\\n' for i in range(40))",
            "diverged",
            "40 of its poses",
        ),
        (
            "open('result.txt', 'w').writelines(f'{i / 10} {1e12 if i == 39 else i % 3} {i % 2} {i % 5} 0 0 0 1\\n' "
            "for i in range(40))",
            "diverged",
            "beyond all bounds",
        ),
    ],
)
def test_failures_are_recorded_with_their_reason(make_program, source, truth, behaviour, outcome, reason):
    result, _ = judge(make_program(behaviour), source("truth"), truth)
    assert (result.outcome, result.e_align) == (outcome, None)
    assert reason in result.reason
    assert result.error == float("inf")


def test_a_run_that_gives_up_early_is_lost(make_program, source, truth):
    result, _ = judge(make_program(part=":25"), source("truth"), truth)
    assert result.outcome == "lost"
    assert "62%" in result.reason
    assert result.error == float("inf")


def test_a_run_that_hangs_is_ended(make_program, source, truth):
    result, tracked = judge(
        make_program("print('so far'); sys.stdout.flush(); time.sleep(60)", timeout_s=1.0), source("truth"), truth
    )
    assert result.outcome == "timeout"
    assert "1 s" in result.reason
    assert "so far" in tracked.log


def test_stopping_ends_the_program(make_program, source):
    stop = Event()
    Timer(0.5, stop.set).start()
    began = time.monotonic()
    assert make_program("time.sleep(60)").track(source("truth"), 0, stop).timeout
    assert time.monotonic() - began < 30


def test_what_is_no_program_is_refused(tmp_path):
    with pytest.raises(SettingError, match="dso_dataset"):
        Program(tmp_path / "nothing")
    with pytest.raises(SettingError, match="dso_dataset"):
        Program(tmp_path)


def test_a_time_limit_is_positive(make_program):
    with pytest.raises(SettingError, match="positive"):
        make_program(timeout_s=0.0)
