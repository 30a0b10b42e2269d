"""``ospc evaluate odometry``: the effect of calibrations on direct visual odometry."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ospc.cli.options import PATH, json_option
from ospc.cli.studies import (
    calibration_option,
    finish_study,
    given_calibrations,
    jobs_option,
    print_tables,
    study_out_option,
    study_progress,
    until_interrupted,
    words,
)
from ospc.errors import SettingError, escaped

if TYPE_CHECKING:
    from ospc.recording import Recording
    from ospc.research.odometry.judging import Odometry

_CONDITIONS = "truth,paper,ours,joint-wgt,joint-wogt,none"


@click.command("odometry")
@click.argument("recordings", nargs=-1, required=True, type=PATH)
@click.option("--program", type=PATH, help="Your dso_dataset, or one with its arguments.")
@click.option("--builtin", is_flag=True, help="Use the built-in direct odometry; needs simulated recordings.")
@study_out_option("ospc-odometry")
@click.option("--runs", type=click.IntRange(1, 1000), default=10, show_default=True, help="Runs of each.")
@click.option(
    "--conditions",
    default=_CONDITIONS,
    show_default=True,
    help="Columns, separated by commas; 'affine' is a further one: no calibration, mode 1.",
)
@calibration_option
@click.option("--batch", is_flag=True, help="Joint estimation from the whole recording, not online.")
@jobs_option
@click.option("--timeout", default=3600.0, show_default=True, help="Time limit of a run in seconds.")
@click.option("--ends", type=float, metavar="SHARE", help="Use only this share of the truth at the start and end.")
@click.option("--argument", "arguments", multiple=True, help="Further argument of the program, such as preset=0.")
@json_option
def odometry(
    recordings: tuple[Path, ...],
    *,
    program: Path | None,
    builtin: bool,
    out: Path,
    runs: int,
    conditions: str,
    given: tuple[str, ...],
    batch: bool,
    jobs: int,
    timeout: float,
    ends: float | None,
    arguments: tuple[str, ...],
    as_json: bool,
) -> None:
    """Run direct visual odometry over RECORDINGS with several calibrations, and compare the drift.

    Each recording is a folder in the layout of the TUM monocular data set, with camera.txt and groundtruthSync.txt;
    'truth' uses its pcalib.txt and vignette.png. 'paper', 'ours' and the joint estimates are
    made from the recording itself.
    OUT gets table.md (medians of e_align, the lowest bold), runs.csv, results.json,
    cumulative.png and the trajectories. Every finished run is kept in OUT: the same command continues where it was
    interrupted. A calibration given under the name of a condition replaces its estimate.
    """
    from ospc.research.odometry.calibrations import Calibrations
    from ospc.research.odometry.conditions import chosen, external
    from ospc.research.odometry.experiment import Experiment, Outcome, run_experiment
    from ospc.research.odometry.report import median_table, medians_of, ordered, write_outcome

    files = given_calibrations(given)
    columns = chosen(words(conditions))
    columns += tuple(external(name) for name in files if name not in {c.name for c in columns})
    calibrations = Calibrations(out / "calibrations", files, not batch)
    experiment = Experiment(_recordings(recordings), columns, runs, calibrations, out, ends)
    tracker = _odometry(program, arguments, timeout, recordings if builtin else ())
    outcome = Outcome()
    with study_progress(len(recordings) * len(columns) * runs) as (on_step, finish):
        watched = replace(experiment, calibrations=replace(calibrations, progress=on_step))
        results = run_experiment(watched, tracker, outcome, jobs, lambda task, share: on_step(task.name, share))
        complete = until_interrupted(results, finish, lambda _stored: None)
    if not as_json:
        print_tables([median_table(experiment, outcome)])
    titles = {condition.name: condition.title for condition in columns}
    failures = [
        f"{run.recording}, {titles[run.condition]}, run {run.run}: {run.ending}; {run.reason}"
        for run in ordered(experiment, outcome)
        if run.ending != "finished"
    ]
    medians = medians_of(experiment, outcome) if as_json else None
    finish_study(write_outcome(experiment, outcome), failures, as_json=medians, complete=complete)


def _recordings(places: tuple[Path, ...]) -> dict[str, Recording]:
    from ospc.recording import open_recording

    found: dict[str, Recording] = {}
    for place in places:
        name = escaped(place.resolve().name)
        if name in found:
            raise SettingError(f"two recordings are called {name}; rename the folder of one of them")
        found[name] = open_recording(place)
    return found


def _odometry(
    program: Path | None, arguments: tuple[str, ...], timeout: float, simulated: tuple[Path, ...]
) -> Odometry:
    """Return the program, or the built-in odometry where there are simulated recordings for it."""
    if bool(simulated) == (program is not None):
        raise SettingError("give the path of your dso_dataset by --program, or --builtin; one of the two")
    if program is not None:
        from ospc.research.odometry.program import Program

        return Program(program, timeout, *([tuple(arguments)] if arguments else []))
    from ospc.research.odometry.depth import SceneDepth
    from ospc.research.odometry.direct import DirectOdometry

    for place in simulated:
        # Fails here if the depth of a scene is unknown, before hours are spent.
        SceneDepth.of(place)
    return DirectOdometry()
