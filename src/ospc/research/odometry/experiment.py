"""Recordings × conditions × runs of odometry, and the errors of each run."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import FormatError, NotObservableError, OspcError, SettingError
from ospc.evaluation.trajectory import AlignmentError, Trajectory, alignment_error, half_alignments, read_trajectory
from ospc.recording import Recording
from ospc.research.odometry.inputs import CAMERA, TRUTH, Calibrations, Condition, OdometryInput, images_of, needed
from ospc.research.runner import Finished, OnProgress, Task

Ending = Literal["finished", "lost", "diverged", "failed", "timeout"]
"""``lost``: tracking stopped before the end. ``diverged``: poses are not finite or far outside of all others.
``failed``: the program ended with an error or without a trajectory."""
LEAST_COVERED, _LARGEST_STRETCH = 0.9, 1e6
"""Share of a recording's duration that a finished run covers, and largest ratio of maximum to median distance."""
_FIGURES = ("e_align", "e_s", "e_r_deg", "rmse")
"""The reported fields of :class:`~ospc.evaluation.trajectory.AlignmentError`."""


class Odometry(Protocol):
    """A program that estimates a trajectory from a recording."""

    def describe(self) -> dict[str, Any]:
        """Return what its results depend on, as JSON-compatible values."""

    def track(self, source: OdometryInput, run: int) -> Tracked:
        """Run once; failures are results, not exceptions."""


@dataclass(frozen=True)
class Tracked:
    """The result of a run of odometry: the poses, or None, and the end of the program's output.

    ``failure`` is the reason why there are no poses or why they end early; empty if the run succeeded.
    """

    trajectory: Trajectory | None
    failure: str = ""
    timeout: bool = False
    log: str = ""
    seconds: float = 0.0

    def as_dict(self) -> dict[str, Any]:
        """Return all fields as JSON-compatible values; a pose is a row of stamp, position and quaternion."""
        known = self.trajectory
        poses = None if known is None else np.column_stack([known.stamps_s, known.positions, known.quaternions])
        return {**vars(self), "trajectory": None if poses is None else poses.tolist()}

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> Tracked:
        """Inverse of :meth:`as_dict`."""
        if content["trajectory"] is None:
            return cls(**content)
        poses = np.array(content["trajectory"], dtype=np.float64).reshape(-1, 8)
        return cls(**{**content, "trajectory": Trajectory(poses[:, 0], poses[:, 1:4], poses[:, 4:])})


@dataclass(frozen=True)
class RunResult:
    """A run compared with the truth.

    ``errors`` is None if they cannot be computed; ``covered`` is the share of the recording's duration that the poses
    cover.
    """

    recording: str
    condition: Condition
    run: int
    tracked: Tracked
    ending: Ending
    reason: str = ""
    errors: AlignmentError | None = None
    covered: float = 0.0

    @property
    def error(self) -> float:
        """The alignment error; infinite unless the run finished."""
        return self.errors.e_align if self.ending == "finished" and self.errors is not None else float("inf")

    def as_dict(self) -> dict[str, Any]:
        """Return a line of the table of runs, with JSON-compatible values."""
        about = {"recording": self.recording, "condition": self.condition.name, "run": self.run}
        errors = {name: None if self.errors is None else getattr(self.errors, name) for name in _FIGURES}
        poses = 0 if self.tracked.trajectory is None else len(self.tracked.trajectory)
        extent = {"poses": poses, "covered": self.covered, "seconds": self.tracked.seconds}
        return {**about, "outcome": self.ending, "reason": self.reason, **errors, **extent}


def judged(
    tracked: Tracked, truth: Trajectory, stamps_s: FloatArray, *, recording: str, condition: Condition, run: int
) -> RunResult:
    """Compare a run with the truth; ``stamps_s`` belong to the recording's frames."""
    covered = _covered(tracked.trajectory, stamps_s)
    ending, reason = _ending(tracked, covered, stamps_s)
    errors: AlignmentError | None = None
    if tracked.trajectory is not None and ending in ("finished", "lost"):
        try:
            errors = alignment_error(tracked.trajectory, truth)
        except (NotObservableError, FormatError) as problem:
            ending, reason = ("lost" if ending == "lost" else "diverged"), str(problem)
    if errors is not None and not all(np.isfinite(getattr(errors, name)) for name in _FIGURES):
        ending, reason, errors = "diverged", "its errors are not finite", None
    return RunResult(recording, condition, run, tracked, ending, reason, errors, covered)


def _ending(tracked: Tracked, covered: float, stamps_s: FloatArray) -> tuple[Ending, str]:
    if tracked.timeout:
        return "timeout", tracked.failure
    if tracked.trajectory is None:
        return "failed", tracked.failure or "it wrote no trajectory"
    positions = tracked.trajectory.positions
    if not np.all(np.isfinite(positions)):
        return "diverged", f"{np.count_nonzero(~tracked.trajectory.known)} of its poses are not finite"
    spread = np.linalg.norm(positions - np.median(positions, axis=0), axis=1)
    if spread.max() > _LARGEST_STRETCH * max(float(np.median(spread)), 1e-12):
        return "diverged", "a pose is far outside of all others"
    if covered < LEAST_COVERED:
        return "lost", f"its poses cover {covered:.0%} of {stamps_s[-1] - stamps_s[0]:.1f} s"
    return ("failed", tracked.failure) if tracked.failure else ("finished", "")


def _covered(trajectory: Trajectory | None, stamps_s: FloatArray) -> float:
    duration = float(stamps_s[-1] - stamps_s[0])
    if trajectory is None or len(trajectory) < 2 or duration <= 0:
        return 0.0
    return min(1.0, float(trajectory.stamps_s[-1] - trajectory.stamps_s[0]) / duration)


@dataclass(frozen=True)
class Experiment:
    """Recordings by name, each with camera.txt and groundtruthSync.txt, to be run under several conditions.

    ``folder`` gets the images of recordings in another layout.
    """

    recordings: dict[str, Recording]
    conditions: tuple[Condition, ...]
    runs: int
    calibrations: Calibrations
    folder: Path

    def __post_init__(self) -> None:
        """Check the input, before hours are spent."""
        if self.runs < 1 or not self.recordings or not self.conditions:
            raise SettingError("an experiment needs at least one recording, one condition and one run")
        for recording in self.recordings.values():
            needed(recording.path, CAMERA)
            truth = true_trajectory(recording)
            try:
                half_alignments(truth.select(truth.known), truth)
            except NotObservableError as error:
                raise NotObservableError(f"{recording.path}: {TRUTH} determines no drift: {error}") from None


def true_trajectory(recording: Recording) -> Trajectory:
    """Return the true trajectory of a recording."""
    return read_trajectory(needed(recording.path, TRUTH))


def tasks_of(experiment: Experiment, odometry: Odometry) -> tuple[list[Task], list[RunResult]]:
    """Return the tasks of all runs, and the runs that failed already because their calibration failed.

    The first runs of all recordings and conditions come before the second ones, so that an interruption leaves a fair
    table. Tasks are about the recording's name, the input, and the run number.
    """
    tasks: list[Task] = []
    failed: list[RunResult] = []
    described = odometry.describe()
    for name, recording in experiment.recordings.items():
        images = images_of(recording, experiment.folder)
        for condition in experiment.conditions:
            try:
                photometry = experiment.calibrations.of(recording, condition)
            except OspcError as error:
                failed += [
                    RunResult(name, condition, number, Tracked(None), "failed", str(error))
                    for number in range(experiment.runs)
                ]
                continue
            source = OdometryInput.of(recording, images, condition, photometry)
            depends_on = {"input": source.describe(), "odometry": described}
            for number in range(experiment.runs):
                run = partial(_run, odometry, source, number)
                title = f"{name}, {condition.name} (run {number})"
                tasks.append(Task(title, depends_on | {"run": number}, run, (name, source, number)))
    return sorted(tasks, key=lambda task: task.about[2]), failed


def _run(odometry: Odometry, source: OdometryInput, number: int, _progress: OnProgress) -> dict[str, Any]:
    return odometry.track(source, number).as_dict()


def result_of(finished: Finished, experiment: Experiment) -> RunResult:
    """Compare a finished run with the truth."""
    task, result = finished
    name, source, number = task.about
    tracked, truth = Tracked.from_dict(result), true_trajectory(experiment.recordings[name])
    return judged(tracked, truth, source.stamps_s, recording=name, condition=source.condition, run=number)
