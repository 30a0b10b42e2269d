"""Recordings × conditions × runs of odometry."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ospc.errors import OspcError, SettingError
from ospc.evaluation.trajectory import Trajectory, read_trajectory
from ospc.recording import Recording
from ospc.research.odometry.calibrations import Calibrations
from ospc.research.odometry.conditions import Condition
from ospc.research.odometry.inputs import CAMERA, TRUTH, OdometryInput, images_of, needed
from ospc.research.odometry.judging import Odometry, RunResult, Tracked, judged
from ospc.research.runner import OnProgress, OnShare, run
from ospc.research.store import ResultStore

_FEWEST_POSES = 3
"""Poses at either end that an alignment needs."""


@dataclass(frozen=True)
class Experiment:
    """Recordings by name, each with camera.txt and groundtruthSync.txt, to be run under conditions.

    ``end_share`` is the share of the true trajectory used at either end, where the data set knows no more; None for
    all.
    """

    recordings: dict[str, Recording]
    conditions: tuple[Condition, ...]
    runs: int
    calibrations: Calibrations
    folder: Path
    end_share: float | None = None

    def __post_init__(self) -> None:
        """Refuse what cannot be run, before hours are spent."""
        if self.runs < 1 or not self.recordings or not self.conditions:
            raise SettingError("an experiment needs at least one recording, one condition and one run")
        if self.end_share is not None and not 0 < self.end_share <= 0.5:
            raise SettingError(f"the share of the truth at either end is {self.end_share}; choose one up to 0.5")
        for recording in self.recordings.values():
            needed(recording.path, CAMERA)
            self.truth_of(recording)

    def truth_of(self, recording: Recording) -> Trajectory:
        """Return the true trajectory of a recording."""
        known = read_trajectory(needed(recording.path, TRUTH))
        return known if self.end_share is None else end_segments(known, self.end_share)


@dataclass(frozen=True)
class RunTask:
    """One run of odometry."""

    recording: str
    source: OdometryInput = field(repr=False)
    odometry: Odometry
    number: int

    @property
    def name(self) -> str:
        """Recording and number; conditions with the same files share their runs."""
        return f"{self.recording} (run {self.number})"

    def describe(self) -> dict[str, Any]:
        """Return images, parameters, program and number."""
        return {"input": self.source.describe(), "odometry": self.odometry.describe(), "run": self.number}

    def run(self, _progress: OnProgress) -> dict[str, Any]:
        """Run odometry once."""
        return self.odometry.track(self.source, self.number).as_dict()


@dataclass
class Outcome:
    """All runs by recording, condition and number, and notes on why conditions could not be run."""

    results: dict[tuple[str, str, int], RunResult] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def of(self, recording: str, condition: Condition) -> list[RunResult]:
        """Return the runs of a recording under a condition, by number."""
        return [r for key, r in sorted(self.results.items()) if key[:2] == (recording, condition.name)]

    def add(self, result: RunResult) -> None:
        """Add a run."""
        self.results[result.recording, result.condition, result.run] = result


def tasks_of(experiment: Experiment, odometry: Odometry, outcome: Outcome) -> list[RunTask]:
    """Return all runs, the first of everything before the second, so that an interruption leaves a fair table.

    A calibration that cannot be made is a result: its runs are recorded as failed.
    """
    tasks: list[RunTask] = []
    for name, recording in experiment.recordings.items():
        images = images_of(recording, experiment.folder / "images")
        for condition in experiment.conditions:
            try:
                photometry = experiment.calibrations.of(recording, condition)
            except OspcError as error:
                outcome.notes.append(f"{name}, {condition.title}: {error}")
                for number in range(experiment.runs):
                    outcome.add(RunResult(name, condition.name, number, Tracked(None), "failed", str(error)))
                continue
            source = OdometryInput.of(recording, images, condition, photometry)
            tasks += [RunTask(name, source, odometry, number) for number in range(experiment.runs)]
    return sorted(tasks, key=lambda task: task.number)


def run_experiment(
    experiment: Experiment,
    odometry: Odometry,
    outcome: Outcome,
    jobs: int = 1,
    on_share: OnShare = lambda _task, _share: None,
) -> Iterator[bool]:
    """Run what has not been run before, add to the outcome, and say of every run whether it was stored already.

    ``jobs`` and ``on_share`` are those of :func:`ospc.research.runner.run`.
    """
    tasks = tasks_of(experiment, odometry, outcome)
    for finished in run(tasks, ResultStore(experiment.folder / "runs"), jobs, on_share):
        task = finished.task
        result = judged(
            Tracked.from_dict(finished.result),
            experiment.truth_of(experiment.recordings[task.recording]),
            task.source.stamps_s,
            recording=task.recording,
            condition=task.source.condition.name,
            run=task.number,
        )
        outcome.add(result)
        yield finished.stored


def end_segments(truth: Trajectory, share: float) -> Trajectory:
    """Return a truth of which only this share, at most 0.5, is known at either end, as in the monocular data set."""
    keep = max(_FEWEST_POSES, round(share * len(truth)))
    positions, quaternions = truth.positions.copy(), truth.quaternions.copy()
    positions[keep : len(truth) - keep] = np.nan
    quaternions[keep : len(truth) - keep] = np.nan
    return Trajectory(truth.stamps_s, positions, quaternions)
