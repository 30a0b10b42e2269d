"""``ospc bench``: accuracy of the methods on recordings with known truth, robustness to faults, and speed."""

from __future__ import annotations

from pathlib import Path

import click

from ospc.cli.options import AS_JSON, STUDY_SIZE, declared, option
from ospc.cli.studies import DATA, JOBS, presets_option, run_study, study_out_option
from ospc.cli.terminal import say

command = click.Group("bench", help="Measure accuracy, speed and robustness on recordings with known truth.")

_FRAMES = option("Frames per simulated recording.", type=click.IntRange(2, 100_000), default=500)


@declared("accuracy", command)
def accuracy(
    *,
    out: Path = study_out_option("ospc-accuracy"),
    presets: tuple[str, ...] = presets_option("default,paper"),
    data: Path | None = DATA,
    jobs: int = JOBS,
    only: str | None = option("Only recordings whose name matches, such as 'srgb-*' or 'chart'.", metavar="PATTERN"),
    frames: int = _FRAMES,
    as_json: bool = AS_JSON,
) -> None:
    """Calibrate a fixed set of recordings with every method, and compare with the truth.

    Most recordings are simulated; real ones are added from the folder of real data. OUT gets results.json,
    results.csv, table.md and errors.png. Finished results are kept in OUT/cache: the same command continues an
    interrupted run, and recomputes only what has changed.
    """
    from ospc.research.accuracy.design import PresetMethods, accuracy_sources, select
    from ospc.research.accuracy.report import accuracy_report
    from ospc.research.source import loaded, measuring_task

    sources, notes = accuracy_sources(data, frames)
    chosen = select({source.name: source for source in sources}, only)
    run_study(
        [measuring_task(source, PresetMethods(name)) for name in presets for source in chosen],
        out,
        jobs,
        lambda finished: accuracy_report([row for _, result in finished for row in loaded(result)], presets, notes),
        as_json=as_json,
    )


@declared("faults", command)
def faults(
    *,
    out: Path = study_out_option("ospc-faults"),
    data: Path | None = DATA,
    jobs: int = JOBS,
    only: str | None = option("Only faults whose name matches, such as 'glare' or '*flicker'.", metavar="PATTERN"),
    strengths: tuple[str, ...] = option(
        "Strength of the faults; repeatable. [all three]",
        "--strength",
        type=click.Choice(["weak", "medium", "strong"]),
    ),
    recordings: int = option(
        "Number of simulated recordings, each from a different camera.", type=click.IntRange(1, 28), default=5
    ),
    frames: int = _FRAMES,
    only_list: bool = option("Print the faults and exit.", "--list"),
    as_json: bool = AS_JSON,
) -> None:
    """Add faults to good recordings, to see whether calibrations detect or tolerate them, or are confident and wrong.

    Every fault is added to simulated recordings of several cameras, and to the real video from the folder of real
    data. OUT gets results.json, results.csv and table.md. Finished runs are kept in OUT/cache: the same command
    continues an interrupted run, and recomputes only what has changed.
    """
    from ospc.research.accuracy.design import select
    from ospc.research.faults.footage import STRENGTHS, good_sources
    from ospc.research.faults.judging import FAULTS, Run
    from ospc.research.faults.study import fault_tasks, faults_report

    chosen = select(FAULTS, only, "fault")
    if only_list:
        for fault in chosen:
            say(f"{fault.name:20} {', '.join(f'{s:g}' for s in fault.strengths):20} {fault.text.format('…')}")
        return
    sources, notes = good_sources(recordings, frames, data)
    run_study(
        fault_tasks(sources, chosen, strengths or STRENGTHS),
        out,
        jobs,
        lambda finished: faults_report([Run(**result) for _, result in finished], notes),
        as_json=as_json,
    )


@declared("speed", command)
def speed(
    *,
    out: Path = study_out_option("ospc-speed"),
    presets: tuple[str, ...] = presets_option("default,fast,paper"),
    sizes: tuple[tuple[int, int], ...] = option(
        "Size of the frames; repeatable. [640x480, 1280x1024]", "--size", type=STUDY_SIZE, metavar="WxH"
    ),
    frames: int = option("Maximum number of frames.", type=click.IntRange(2, 1_000_000), default=1500),
    live_s: float = option(
        "Duration of the live measurement, in seconds.", "--live", type=click.FloatRange(0, 3600), default=30
    ),
    rate_hz: float = option(
        "Frame rate of the live camera, in frames/s.", "--rate", type=click.FloatRange(0.1, 1000), default=30
    ),
    as_json: bool = AS_JSON,
) -> None:
    """Measure the speed of whole commands, presets, a live camera, and corrections, with the goals of this project.

    As a lower bound, simulated JPEG frames are decoded, or copied, in the same run just before. OUT gets
    results.json, results.csv and table.md. Finished measurements are kept in OUT/cache: the same command continues an
    interrupted run; remove the folder to measure again. Preset "paper" gets 30 frames.
    """
    from ospc.research.speed.lines import SIZES, row_of, speed_report, speed_tasks

    tasks = speed_tasks(presets, sizes or SIZES, frames, live_s, rate_hz)
    run_study(
        tasks, out, 1, lambda finished: speed_report([row_of(result) for _, result in finished]), as_json=as_json
    )
