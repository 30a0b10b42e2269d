"""``ospc experiments``: the paper's figures and tables, and related experiments."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from ospc.cli.options import PATH, STUDY_SIZE, named
from ospc.cli.studies import (
    calibration_option,
    data_option,
    given_calibrations,
    jobs_option,
    run_study,
    study_out_option,
    words,
)
from ospc.cli.terminal import say

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from ospc.research.method import Result
    from ospc.research.runner import Finished
    from ospc.research.source import Source
    from ospc.research.tables import StudyReport

_EXPERIMENTS = {
    "parameters": "Response, vignette and exposure ratios against the truth (figure 3).",
    "joint": "Joint estimation with and without one point of the true response, and others, against ours (figure 4).",
    "solvers": "Solvers of the vignette: L2, L1, M-estimator, ours (section 5).",
    "features": "Features for the response: SIFT, SURF, ORB, ours (section 5); SURF needs the extra 'surf'.",
    "offsets": "Offset between the two frames of a pair for the vignette, 10 to 50 (section 5).",
    "thresholds": "Least exposure ratio of a pair for the response (section 5).",
    "static": "Methods for a camera at rest, on sweeps of the exposure.",
    "ambiguity": "The exponential ambiguity: without known exposures every exponent explains a recording.",
}
_AMBIGUITY_FRAMES = 300


@click.group("experiments")
def command() -> None:
    """Reproduce the paper's figures and tables, on given recordings or on simulated stand-ins.

    RECORDINGS are folders in the layout of the TUM monocular data set; their pcalib.txt and vignette.png are the
    truth. Without any, recordings are simulated: with the data set's narrow camera and real exposures where --data
    (or OSPC_DATA) names a folder that holds them, with an analytic camera otherwise. Finished recordings are kept in
    OUT/cache: the same command continues an interrupted run, and computes again only what has changed.
    """


def _add(name: str) -> None:
    """Add the command of an experiment; all take the same options."""

    @command.command(name, help=_EXPERIMENTS[name])
    @click.argument("recordings", nargs=-1, type=PATH)
    @study_out_option("ospc-experiments")
    @data_option
    @click.option("--count", type=click.IntRange(1, 1000), help="Number of recordings simulated.")
    @click.option("--frames", type=click.IntRange(2, 1_000_000), help="Frames used of each.")
    @click.option("--size", type=STUDY_SIZE, metavar="WxH", default="320x240", help="Size of simulated images.")
    @click.option("--speed", type=float, help="Factor of the speed of the simulated motion.")
    @calibration_option
    @click.option(
        "--exposures",
        "estimated",
        multiple=True,
        metavar="NAME=FILE",
        help="Exposures of another program to be compared: the last number of each line, one line a frame.",
    )
    @jobs_option
    def experiment(**options: Any) -> None:
        if name == "ambiguity":
            _run_ambiguity(options)
        else:
            _run_experiment(name, options)


for _name in _EXPERIMENTS:
    _add(_name)


def _run_experiment(name: str, options: dict[str, Any]) -> None:
    from ospc.research.experiments.design import EXPERIMENTS, experiment_report
    from ospc.research.source import MeasuringTask, judge, measured

    experiment = EXPERIMENTS[name]
    count, frames = experiment.stand_ins
    sources = _sources(options, count, frames, speed=experiment.speed, at_rest=experiment.at_rest)
    others = _others(options)

    def report(finished: Sequence[Finished]) -> StudyReport:
        done = [one.task.source for one in finished]
        rows = [row for one in finished for row in (*measured(one.result), *judge(one.task.source, others))]
        return experiment_report(experiment, done, rows)

    tasks = [MeasuringTask(source, experiment) for source in sources]
    run_study(tasks, options["out"], options["jobs"], report, partly=bool)


@command.command("systems")
@click.argument("recordings", nargs=-1, type=PATH)
@study_out_option("ospc-experiments")
@data_option
@click.option("--count", type=click.IntRange(0, 1000), default=10, help="Recordings simulated.")
@click.option("--frames", type=click.IntRange(2, 1_000_000), default=200, help="Frames of each.")
@click.option("--size", type=STUDY_SIZE, metavar="WxH", default="320x240", help="Size of simulated images.")
@click.option(
    "--only",
    default="",
    show_default=False,
    metavar="NAMES",
    help="Systems of these names or patterns, separated by commas.",
)
@click.option(
    "--list", "only_list", is_flag=True, help="Print the systems with authors and year, and do nothing else."
)
@jobs_option
def systems(
    recordings: tuple[Path, ...],
    out: Path,
    data: Path | None,
    *,
    count: int,
    frames: int,
    size: tuple[int, int],
    only: str,
    only_list: bool,
    jobs: int,
) -> None:
    """Every system that the paper names, side by side: what it needs, what it recovers, and how well.

    Each is measured with and without the point of the truth that it may need, on simulated recordings, and with
    --data on a real video and on photographs of charts.
    """
    from ospc.research.experiments.systems import chosen_systems, system_sources, system_tasks
    from ospc.research.experiments.systems_report import systems_report
    from ospc.research.source import GivenSource, measured

    chosen = chosen_systems(words(only))
    if only_list:
        for system in chosen:
            say(str(system))
        return
    sources: list[Source] = [GivenSource.of(place, frames) for place in recordings]
    if not sources:
        sources = system_sources(count, frames, size, data)
    counts = {source.name: source.count for source in sources}

    def report(finished: Sequence[Finished]) -> StudyReport:
        return systems_report(chosen, [row for one in finished for row in measured(one.result)], counts)

    def of_whole_recordings(finished: Sequence[Finished]) -> bool:
        return len(finished) % len(chosen) == 0

    run_study(system_tasks(chosen, sources), out, jobs, report, partly=of_whole_recordings)


def _run_ambiguity(options: dict[str, Any]) -> None:
    from ospc.research.experiments.ambiguity import Ambiguity, AmbiguityTask, ambiguity_report

    source, *_ = _sources(options, 1, _AMBIGUITY_FRAMES)

    def report(finished: Sequence[Finished]) -> StudyReport:
        return ambiguity_report(Ambiguity(**finished[0].result), source.name)

    run_study([AmbiguityTask(source)], options["out"], 1, report)


def _sources(
    options: dict[str, Any], count: int, frames: int, *, speed: float = 1.0, at_rest: bool = False
) -> list[Source]:
    """Return the recordings that are given, or simulated ones, by default as many as stated."""
    from ospc.research.experiments.sources import stand_ins, sweeps
    from ospc.research.source import GivenSource

    if options["recordings"]:
        return [GivenSource.of(place, options["frames"]) for place in options["recordings"]]
    count, frames = options["count"] or count, options["frames"] or frames
    size = options["size"]
    if at_rest:
        return [*sweeps(count, frames, size)]
    return [*stand_ins(count, frames, size, options["data"], speed=options["speed"] or speed)]


def _others(options: dict[str, Any]) -> list[Result]:
    """Return the results of other programs; exposures belong to the calibration of the same name, if there is one."""
    from ospc.recording.text_file import exposures_in
    from ospc.research.method import Estimate, Result

    calibrations = given_calibrations(options["given"])
    files = named(options["estimated"], "theirs=times.txt")
    exposures = {name: dict(enumerate(exposures_in(file))) for name, file in files.items()}
    found = []
    for name in dict.fromkeys([*calibrations, *exposures]):
        curves = calibrations.get(name)
        response, vignette = (None, None) if curves is None else (curves.response, curves.vignette)
        found.append(Result(name, Estimate(response, vignette, exposures=exposures.get(name))))
    return found
