"""``ospc evaluate odometry``: what calibrations do for direct visual odometry."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ospc.cli.progress import progress_bar

if TYPE_CHECKING:
    from ospc.formats.opening import Photometry
    from ospc.odometry.conditions import Condition
    from ospc.odometry.experiment import Experiment, Outcome
    from ospc.odometry.run import Odometry, RunResult
    from ospc.recording import Recording

_WIDTH = 400
"""Wide enough for every table: cells that were cut short would be lost."""

_CONDITIONS = "truth,ours,joint-wgt,joint-wogt,none"


@click.command("odometry")
@click.argument("recordings", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--program", type=click.Path(path_type=Path), help="Your dso_dataset, or one with its arguments.")
@click.option("--builtin", is_flag=True, help="Use the direct odometry that is built in; needs simulated recordings.")
@click.option("-o", "--out", type=click.Path(path_type=Path), default=Path("ospc-odometry"), show_default=True)
@click.option("--runs", type=click.IntRange(1, 1000), default=10, show_default=True, help="Runs of each.")
@click.option(
    "--conditions",
    default=_CONDITIONS,
    show_default=True,
    help="Columns, separated by commas; 'affine' is there besides: no calibration, mode 1.",
)
@click.option(
    "--calibration",
    "given",
    multiple=True,
    metavar="NAME=FILES",
    help="Calibration of another program as a further column, or instead of one that would be estimated.",
)
@click.option("--batch", is_flag=True, help="Joint estimation from the whole recording, not online.")
@click.option("--jobs", type=click.IntRange(1, 256), default=1, show_default=True, help="Programs at a time.")
@click.option("--timeout", default=3600.0, show_default=True, help="Seconds after which a run is ended.")
@click.option("--ends", type=float, metavar="SHARE", help="Use the truth of so much of the start and end only.")
@click.option("--argument", "arguments", multiple=True, help="Further argument of the program, such as preset=0.")
@click.option("--json", "as_json", is_flag=True, help="Print the medians as JSON.")
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
    'truth' takes its pcalib.txt and vignette.png. 'ours' and the joint estimates are made from the recording itself
    and kept in OUT, as every run is: the same command goes on where it was interrupted. OUT gets table.md (medians of
    e_align, the lowest bold), runs.csv, results.json, cumulative.png and trajectories.
    """
    experiment = _experiment(recordings, out, runs, conditions, given, batch=batch, ends=ends)
    tracker = _odometry(program, arguments, timeout, builtin=builtin)
    if builtin:
        _check_depth(experiment)
    visible = sys.stderr.isatty() and not as_json
    outcome = _run(experiment, tracker, jobs, visible=visible)
    _report(experiment, outcome, as_json=as_json)


def _experiment(
    places: tuple[Path, ...],
    out: Path,
    runs: int,
    conditions: str,
    given: tuple[str, ...],
    *,
    batch: bool,
    ends: float | None,
) -> Experiment:
    from ospc.odometry.calibrations import Calibrations
    from ospc.odometry.conditions import chosen, external
    from ospc.odometry.experiment import Experiment

    files = _given(given)
    standard = [name.strip() for name in conditions.split(",") if name.strip()]
    columns = chosen(standard)
    columns += tuple(external(name) for name in files if name not in {c.name for c in columns})
    return Experiment(
        _recordings(places), columns, runs, Calibrations(out / "calibrations", files, not batch), out, ends
    )


def _recordings(places: tuple[Path, ...]) -> dict[str, Recording]:
    from ospc.errors import SettingError
    from ospc.recording import open_recording

    found: dict[str, Recording] = {}
    for place in places:
        name = place.resolve().name
        if name in found:
            raise SettingError(f"two recordings are called {name}; rename the folder of one of them")
        found[name] = open_recording(place)
    return found


def _given(entries: tuple[str, ...]) -> dict[str, Photometry]:
    from ospc.errors import SettingError
    from ospc.formats.opening import open_photometry

    found: dict[str, Photometry] = {}
    for entry in entries:
        name, equals, files = entry.partition("=")
        if not equals or not files:
            raise SettingError(f"--calibration takes NAME=FILES, such as mine=pcalib.txt,vignette.png; not '{entry}'")
        found[name] = open_photometry(files)
    return found


def _odometry(program: Path | None, arguments: tuple[str, ...], timeout: float, *, builtin: bool) -> Odometry:
    from ospc.errors import SettingError

    if builtin == (program is not None):
        raise SettingError("give the path of your dso_dataset by --program, or --builtin; one of the two")
    if program is not None:
        from ospc.odometry.program import Program

        return Program(program, timeout, *([tuple(arguments)] if arguments else []))
    from ospc.odometry.direct import DirectOdometry

    return DirectOdometry()


def _check_depth(experiment: Experiment) -> None:
    """Look whether the depth of every scene is known, before hours are spent."""
    from ospc.odometry.depth import SceneDepth

    for recording in experiment.recordings.values():
        SceneDepth.of(recording.path)


def _run(experiment: Experiment, tracker: Odometry, jobs: int, *, visible: bool) -> Outcome:
    from dataclasses import replace

    from ospc.odometry.experiment import run_experiment

    total = len(experiment.recordings) * len(experiment.conditions) * experiment.runs
    with progress_bar("runs", total, visible=visible) as progress:
        done = 0

        def on_run(_result: RunResult, _stored: bool) -> None:
            nonlocal done
            done += 1
            progress(done, total)

        def on_frame(what: str, at: int, of: int) -> None:
            if visible and at == of:
                click.echo(f"{what}: estimated from {of} frames", err=True)

        quiet = replace(experiment, calibrations=replace(experiment.calibrations, progress=on_frame))
        return run_experiment(quiet, tracker, jobs, on_run)


def _report(experiment: Experiment, outcome: Outcome, *, as_json: bool) -> None:
    from ospc.odometry.experiment import as_figures, write_outcome
    from ospc.odometry.summary import table

    files, problems = write_outcome(experiment, outcome)
    if as_json:
        click.echo(json.dumps(as_figures(experiment, outcome), indent=1, allow_nan=False))
        return
    from rich.console import Console
    from rich.table import Table

    shown = Table(title="median e_align, in units of the truth", title_justify="left")
    shown.add_column("recording", no_wrap=True)
    for condition in experiment.conditions:
        shown.add_column(condition.title, justify="right", no_wrap=True)
    for row in table(outcome.results, experiment.conditions):
        shown.add_row(
            row.recording,
            *(f"[bold]{cell.text}[/bold]" if i == row.best else cell.text for i, cell in enumerate(row.cells)),
        )
    Console(highlight=False, width=_WIDTH).print(shown, soft_wrap=True)
    for line in _failures(outcome, experiment.conditions):
        click.echo(line)
    for problem in problems:
        click.echo(problem, err=True)
    click.echo("written: " + ", ".join(str(path) for path in files))


def _failures(outcome: Outcome, conditions: tuple[Condition, ...]) -> list[str]:
    titles = {c.name: c.title for c in conditions}
    return [
        f"{r.recording}, {titles[r.condition]}, run {r.run}: {r.outcome}; {r.reason}"
        for r in outcome.results
        if r.outcome != "finished"
    ]
