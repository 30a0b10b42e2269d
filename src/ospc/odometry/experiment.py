"""A whole experiment: recordings × conditions × runs, with its tables and pictures."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ospc.atomic import write_atomically
from ospc.errors import OspcError, RecordingError, SettingError
from ospc.evaluation.trajectory import Trajectory, read_trajectory
from ospc.odometry.batch import Finished, Task, end_segments, run_all
from ospc.odometry.calibrations import Calibrations
from ospc.odometry.conditions import Condition
from ospc.odometry.inputs import OdometryInput, camera_file, images_of
from ospc.odometry.pictures import write_cumulative, write_trajectories
from ospc.odometry.run import Odometry, RunResult
from ospc.odometry.store import RunStore
from ospc.odometry.summary import as_csv, markdown, table
from ospc.recording import Recording

TRUTH = "groundtruthSync.txt"


@dataclass(frozen=True)
class Experiment:
    """What is to be run.

    Attributes
    ----------
    recordings
        By name: the recordings; each folder has a camera.txt and a groundtruthSync.txt.
    conditions
        The columns of the table.
    runs
        Runs of each recording under each condition.
    calibrations
        Where calibrations come from.
    folder
        Where everything is kept.
    end_share
        Share of the true trajectory at either end that is used; the data set's own truth is known there only.
        None to use all that is known.
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
            raise SettingError("an experiment needs a recording, a condition and a run at least")
        if self.end_share is not None and not 0 < self.end_share <= 0.5:
            raise SettingError(f"the share of the truth at either end is {self.end_share}; choose one up to 0.5")
        for recording in self.recordings.values():
            camera_file(recording)
            self.truth_of(recording)

    def truth_of(self, recording: Recording) -> Trajectory:
        """Return the true trajectory of a recording.

        Raises
        ------
        RecordingError
            If its folder has none.
        """
        place = recording.path / TRUTH
        if not place.is_file():
            raise RecordingError(f"{recording.path}: has no {TRUTH}; errors of trajectories need the truth")
        known = read_trajectory(place)
        return known if self.end_share is None else end_segments(known, self.end_share)


@dataclass(frozen=True)
class Outcome:
    """What came of an experiment.

    Attributes
    ----------
    results
        All runs, by recording, condition and number.
    trajectories
        Those that were left behind, by the same three.
    notes
        Why conditions could not be run.
    """

    results: tuple[RunResult, ...]
    trajectories: dict[tuple[str, str, int], Trajectory]
    notes: tuple[str, ...]


def run_experiment(
    experiment: Experiment,
    odometry: Odometry,
    jobs: int = 1,
    on_run: Callable[[RunResult, bool], None] = lambda _result, _stored: None,
) -> Outcome:
    """Run what has not been run before, and return everything.

    A calibration that cannot be made is a result: its runs are recorded as failed.

    Parameters
    ----------
    experiment
        What to run.
    odometry
        What runs it.
    jobs
        Number of programs at a time.
    on_run
        Told of every run, and whether it was stored already.
    """
    tasks: list[Task] = []
    found: dict[tuple[str, str, int], RunResult] = {}
    trajectories: dict[tuple[str, str, int], Trajectory] = {}
    notes: list[str] = []
    for name, recording in experiment.recordings.items():
        truth = experiment.truth_of(recording)
        images = images_of(recording, experiment.folder / "images")
        for condition in experiment.conditions:
            try:
                photometry = experiment.calibrations.of(recording, condition)
            except OspcError as error:
                notes.append(f"{name}, {condition.title}: {error}")
                for run in range(experiment.runs):
                    found[name, condition.name, run] = _not_run(name, condition, run, str(error))
                continue
            source = OdometryInput(recording, images, condition, photometry)
            tasks += [Task(name, source, truth, run) for run in range(experiment.runs)]
    for finished in _in_turn(tasks, odometry, experiment, jobs):
        result = finished.result
        key = (result.recording, result.condition, result.run)
        found[key] = result
        if finished.trajectory is not None:
            trajectories[key] = finished.trajectory
        on_run(result, finished.stored)
    order = [
        (n, c.name, r) for n in experiment.recordings for c in experiment.conditions for r in range(experiment.runs)
    ]
    return Outcome(tuple(found[key] for key in order if key in found), trajectories, tuple(notes))


def _in_turn(tasks: Sequence[Task], odometry: Odometry, experiment: Experiment, jobs: int) -> Iterator[Finished]:
    """Run the first run of everything before the second, so that an interruption leaves a fair table."""
    ordered = sorted(tasks, key=lambda task: task.run)
    return run_all(ordered, odometry, RunStore(experiment.folder / "runs"), jobs)


def _not_run(name: str, condition: Condition, run: int, reason: str) -> RunResult:
    return RunResult(name, condition.name, run, "failed", reason, None, None, None, None, 0, 0.0, 0.0)


def write_outcome(experiment: Experiment, outcome: Outcome) -> tuple[list[Path], list[str]]:
    """Write runs.csv, results.json, table.md and the pictures; return them, and what is missing.

    Raises
    ------
    SettingError
        If they cannot be written.
    """
    folder = experiment.folder
    rows = table(outcome.results, experiment.conditions)
    content = {
        "runs": [result.as_dict() for result in outcome.results],
        "medians": as_figures(experiment, outcome),
        "notes": list(outcome.notes),
    }
    texts = {
        "runs.csv": as_csv(outcome.results),
        "results.json": json.dumps(content, indent=1, allow_nan=False) + "\n",
        "table.md": markdown(rows, experiment.conditions),
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        files = [write_atomically(folder / name, text.encode()) for name, text in texts.items()]
    except OSError as error:
        raise SettingError(f"{folder}: cannot be written ({error.strerror}); choose another folder") from None
    files.append(write_cumulative(outcome.results, experiment.conditions, folder / "cumulative.png"))
    files += [_draw_trajectories(experiment, outcome, name) for name in experiment.recordings]
    return files, []


def _draw_trajectories(experiment: Experiment, outcome: Outcome, name: str) -> Path:
    """Draw, for each condition, the run whose error is the median of its runs."""
    drawn: dict[str, tuple[Condition, Trajectory | None, RunResult]] = {}
    for condition in experiment.conditions:
        runs = sorted(
            (r for r in outcome.results if (r.recording, r.condition) == (name, condition.name)),
            key=lambda r: r.error,
        )
        if runs:
            typical = runs[(len(runs) - 1) // 2]
            drawn[condition.name] = (
                condition,
                outcome.trajectories.get((name, condition.name, typical.run)),
                typical,
            )
    truth = experiment.truth_of(experiment.recordings[name])
    return write_trajectories(drawn, truth, experiment.folder / f"trajectories-{name}.png", name)


def as_figures(experiment: Experiment, outcome: Outcome) -> dict[str, Any]:
    """Return the medians by recording and condition, as JSON-compatible values; None where they are not finite."""
    rows = table(outcome.results, experiment.conditions)
    return {
        row.recording: {c.name: cell.as_dict() for c, cell in zip(experiment.conditions, row.cells, strict=True)}
        for row in rows
    }
