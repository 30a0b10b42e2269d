"""All runs of an experiment: stored ones first, then what is missing, several at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from threading import Event

import numpy as np

from ospc.evaluation.trajectory import Trajectory
from ospc.odometry.inputs import OdometryInput
from ospc.odometry.run import Odometry, RunResult, Tracked, judged
from ospc.odometry.store import RunStore


@dataclass(frozen=True)
class Task:
    """A run to make.

    Attributes
    ----------
    name
        What to call the recording.
    source
        The recording under a condition.
    truth
        Its true trajectory.
    run
        Number of the run.
    """

    name: str
    source: OdometryInput
    truth: Trajectory = field(repr=False)
    run: int


@dataclass(frozen=True)
class Finished:
    """A run that was made now or earlier."""

    task: Task
    result: RunResult
    trajectory: Trajectory | None = field(repr=False)
    stored: bool


def run_all(tasks: Sequence[Task], odometry: Odometry, store: RunStore, jobs: int = 1) -> Iterator[Finished]:
    """Give every run as it is finished; each is stored before it is given.

    Ending the iteration early, as an interruption does, ends the programs that are under way; they are not stored.

    Parameters
    ----------
    tasks
        What to run.
    odometry
        What runs it.
    store
        Where runs are kept.
    jobs
        Number of programs at a time.
    """
    missing: list[tuple[Task, str]] = []
    for task in tasks:
        key = store.key(task.source, odometry, task.run)
        known = store.get(key)
        if known is None:
            missing.append((task, key))
        else:
            yield _finished(task, known, stored=True)
    stop = Event()
    with ThreadPoolExecutor(jobs) as pool:
        waiting = {pool.submit(odometry.track, task.source, task.run, stop): (task, key) for task, key in missing}
        try:
            while waiting:
                done, _ = wait(waiting, return_when=FIRST_COMPLETED)
                for future in done:
                    task, key = waiting.pop(future)
                    tracked = future.result()
                    store.put(key, tracked)
                    yield _finished(task, tracked, stored=False)
        finally:
            stop.set()
            pool.shutdown(wait=True, cancel_futures=True)


def _finished(task: Task, tracked: Tracked, *, stored: bool) -> Finished:
    stamps = np.asarray(task.source.recording.stamps_s)
    result = judged(
        tracked, task.truth, stamps, recording=task.name, condition=task.source.condition.name, run=task.run
    )
    return Finished(task, result, tracked.trajectory, stored)


def end_segments(truth: Trajectory, share: float) -> Trajectory:
    """Return a truth that is known only at its beginning and end, as the monocular data set's is.

    Parameters
    ----------
    truth
        All or most of it known.
    share
        Share of the rows that stays known at either end, in (0, 0.5].
    """
    keep = max(3, round(share * len(truth)))
    positions, quaternions = truth.positions.copy(), truth.quaternions.copy()
    positions[keep : len(truth) - keep] = np.nan
    quaternions[keep : len(truth) - keep] = np.nan
    return Trajectory(truth.stamps_s, positions, quaternions)
