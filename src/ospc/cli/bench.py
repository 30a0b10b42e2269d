"""``ospc bench``: accuracy of the methods on recordings with known truth, and their speed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ospc.cli.options import STUDY_SIZE, json_option
from ospc.cli.studies import data_option, jobs_option, presets_option, run_study, study_out_option
from ospc.cli.terminal import say

if TYPE_CHECKING:
    from ospc.research.runner import Finished
    from ospc.research.tables import StudyReport


@click.group()
def command() -> None:
    """Measure the accuracy and speed of the methods."""


@command.command()
@study_out_option("ospc-accuracy")
@presets_option("default,paper")
@data_option
@jobs_option
@click.option("--only", metavar="PATTERN", help="Recordings whose name matches, such as 'srgb-*' or 'chart'.")
@click.option("--frames", type=click.IntRange(2, 100_000), default=500, help="Frames simulated.")
@json_option
def accuracy(
    out: Path, presets: tuple[str, ...], data: Path | None, *, jobs: int, only: str | None, frames: int, as_json: bool
) -> None:
    """Calibrate a fixed set of recordings with every method, and compare with the truth.

    Most recordings are simulated; real ones are added from the folder of real data. OUT gets results.json,
    results.csv, table.md and errors.png. Finished results are kept in OUT/cache: the same command continues an
    interrupted run, and computes again only what has changed.
    """
    from ospc.research.accuracy.design import PresetMethods, accuracy_sources, select
    from ospc.research.accuracy.report import accuracy_report
    from ospc.research.source import MeasuringTask, measured

    def report(finished: Sequence[Finished]) -> StudyReport:
        return accuracy_report([row for one in finished for row in measured(one.result)], presets, notes)

    sources, notes = accuracy_sources(data, frames)
    tasks = [MeasuringTask(source, PresetMethods(name)) for name in presets for source in select(sources, only)]
    run_study(tasks, out, jobs, report, as_json=as_json)


@command.command()
@study_out_option("ospc-faults")
@data_option
@jobs_option
@click.option("--only", metavar="PATTERN", help="Faults whose name matches, such as 'glare' or '*flicker'.")
@click.option(
    "--strength",
    "strengths",
    type=click.Choice(["weak", "medium", "strong"]),
    multiple=True,
    help="Strength of the faults; repeatable. [all three]",
)
@click.option("--recordings", type=click.IntRange(1, 28), default=5, help="Simulated recordings, of as many cameras.")
@click.option("--frames", type=click.IntRange(2, 100_000), default=500, help="Frames simulated.")
@click.option("--list", "only_list", is_flag=True, help="Print the faults, and do nothing else.")
@json_option
def faults(
    out: Path,
    data: Path | None,
    *,
    jobs: int,
    only: str | None,
    strengths: tuple[str, ...],
    recordings: int,
    frames: int,
    only_list: bool,
    as_json: bool,
) -> None:
    """Put faults on good recordings, and see whether calibrations notice, cope, or are confident and wrong.

    Every fault is put on simulated recordings of several cameras, and on the real video from the folder of real data.
    OUT gets results.json, results.csv and table.md. Finished runs are kept in OUT/cache: the same command continues
    an interrupted run, and computes again only what has changed.
    """
    from ospc.research.faults.footage import STRENGTHS, good_sources
    from ospc.research.faults.judging import Run
    from ospc.research.faults.study import chosen_faults, fault_tasks, faults_report

    chosen = chosen_faults(only)
    if only_list:
        for fault in chosen:
            say(f"{fault.name:20} {', '.join(f'{s:g}' for s in fault.strengths):20} {fault.text.format('…')}")
        return
    sources, notes = good_sources(recordings, frames, data)
    tasks = fault_tasks(sources, chosen, strengths or STRENGTHS)

    def report(finished: Sequence[Finished]) -> StudyReport:
        return faults_report([Run(**one.result) for one in finished], notes)

    run_study(tasks, out, jobs, report, as_json=as_json)


@command.command()
@study_out_option("ospc-speed")
@presets_option("default,fast,paper")
@click.option(
    "--size",
    "sizes",
    multiple=True,
    type=STUDY_SIZE,
    metavar="WxH",
    help="Size of the frames; repeatable. [640x480, 1280x1024]",
)
@click.option("--frames", type=click.IntRange(2, 1_000_000), default=1500, help="Frames at most.")
@click.option("--live", "live_s", type=click.FloatRange(0, 3600), default=30, help="Seconds live.")
@click.option("--rate", "rate_hz", type=click.FloatRange(0.1, 1000), default=30, help="Frames/s live.")
@json_option
def speed(
    out: Path,
    presets: tuple[str, ...],
    sizes: tuple[tuple[int, int], ...],
    *,
    frames: int,
    live_s: float,
    rate_hz: float,
    as_json: bool,
) -> None:
    """Measure speed: of whole commands, presets, a live camera, and corrections, with the goals of this project.

    Simulated JPEG frames are decoded, or copied, in the same run just before. OUT gets speed.json, speed.md and
    speed.png, which shows the time of each stage. Finished measurements are kept in OUT/cache: the same command
    continues an interrupted run; remove it to measure again. Preset "paper" gets 30 frames.
    """
    from ospc.research.speed.lines import SIZES, row_of, speed_report, speed_tasks

    tasks = speed_tasks(presets, sizes or SIZES, frames, live_s, rate_hz)
    run_study(tasks, out, 1, lambda finished: speed_report([row_of(one.result) for one in finished]), as_json=as_json)
