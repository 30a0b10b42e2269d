"""An external program receives the input of its mode, and every outcome, even a failure, is a result."""

from __future__ import annotations

import json
import os
import time

import numpy as np
import pytest
from fake_tasks import fake_task, sleeping_program

from ospc.errors import SettingError
from ospc.evaluation.trajectory import read_trajectory
from ospc.research.odometry.experiment import Tracked, judged
from ospc.research.odometry.program import Program
from ospc.research.runner import ResultStore, run


def judge(program, source, truth):
    tracked = program.track(source, 0)
    return judged(tracked, truth, source.stamps_s, recording="room", condition=source.condition, run=0), tracked


@pytest.fixture
def truth(simulated):
    return read_trajectory(simulated / "groundtruthSync.txt")


@pytest.mark.parametrize("name", ["truth", "none"])
def test_a_run_gets_the_files_of_its_mode_and_is_judged_up_to_a_similarity(make_program, source, truth, name):
    result, _ = judge(make_program(), source(name), truth)
    assert result.ending == "finished", result.reason
    assert len(result.tracked.trajectory) == 40
    assert result.covered == pytest.approx(1)
    assert result.error < 0.01 if name == "truth" else result.error > 0.01


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
            "far outside of all others",
        ),
    ],
)
def test_failures_are_recorded_with_their_reason(make_program, source, truth, behaviour, outcome, reason):
    result, _ = judge(make_program(behaviour), source("truth"), truth)
    assert (result.ending, result.errors) == (outcome, None)
    assert reason in result.reason
    assert result.error == float("inf")


def test_a_run_that_gives_up_early_is_lost(make_program, source, truth):
    result, _ = judge(make_program(part=":25"), source("truth"), truth)
    assert result.ending == "lost"
    assert "62%" in result.reason
    assert result.error == float("inf")


def test_a_run_that_hangs_is_ended(make_program, source, truth):
    result, tracked = judge(
        make_program("print('so far'); sys.stdout.flush(); time.sleep(60)", timeout_s=1.0), source("truth"), truth
    )
    assert result.ending == "timeout"
    assert "1 s" in result.reason
    assert "so far" in tracked.log


def test_ending_early_ends_the_programs_that_are_under_way(make_program, source, tmp_path):
    note = tmp_path / "process"
    sleeping = make_program(f"open({str(note)!r}, 'w').write(str(__import__('os').getpid())); time.sleep(600)")
    results = run(
        [fake_task("quick", wait_for=note), sleeping_program(sleeping, source("truth"))], ResultStore(tmp_path), 2
    )
    assert next(results)[0].name == "quick"
    process = int(note.read_text())
    os.kill(process, 0)
    results.close()
    for _ in range(100):
        if not alive(process):
            break
        time.sleep(0.1)
    assert not alive(process)


def alive(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def test_runs_survive_the_way_through_json(make_program, source):
    tracked = make_program().track(source("none"), 0)
    again = Tracked.from_dict(json.loads(json.dumps(tracked.as_dict())))
    np.testing.assert_array_equal(again.trajectory.positions, tracked.trajectory.positions)
    np.testing.assert_array_equal(again.trajectory.stamps_s, tracked.trajectory.stamps_s)
    assert Tracked.from_dict(Tracked(None, "x").as_dict()) == Tracked(None, "x")


def test_what_is_no_program_is_refused(tmp_path):
    with pytest.raises(SettingError, match="dso_dataset"):
        Program(tmp_path / "nothing")
    with pytest.raises(SettingError, match="dso_dataset"):
        Program(tmp_path)


def test_a_time_limit_is_positive(make_program):
    with pytest.raises(SettingError, match="positive"):
        make_program(timeout_s=0.0)
