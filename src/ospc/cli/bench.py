"""``ospc bench``: how accurate the methods are, on recordings whose truth is known, and how fast."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ospc.errors import SettingError

if TYPE_CHECKING:
    from rich.table import Table as RichTable

    from ospc.benchmark.case import Case, Row
    from ospc.benchmark.summary import CaseResult
    from ospc.benchmark.tables import Table
    from ospc.benchmark.tasks import Task

_INTERRUPTED = 130
_WIDTH = 400


@click.group()
def command() -> None:
    """Measure the methods."""


@command.command()
@click.option("-o", "--out", type=click.Path(path_type=Path), default=Path("ospc-accuracy"), show_default=True)
@click.option("--presets", default="default,paper", show_default=True, help="Presets to run, separated by commas.")
@click.option("--data", type=click.Path(path_type=Path), envvar="OSPC_DATA", help="Folder of real data.")
@click.option("--jobs", type=click.IntRange(1, 256), default=1, show_default=True, help="Processes.")
@click.option("--only", metavar="PATTERN", help="Cases whose name matches, such as 'srgb-*' or 'chart'.")
@click.option("--frames", type=click.IntRange(2, 100_000), default=500, show_default=True, help="Frames simulated.")
@click.option("--json", "as_json", is_flag=True, help="Print results.json instead of tables.")
def accuracy(
    out: Path,
    *,
    presets: str,
    data: Path | None,
    jobs: int,
    only: str | None,
    frames: int,
    as_json: bool,
) -> None:
    """Calibrate a fixed set of recordings with every method, and compare with the truth.

    Simulated recordings need nothing; real ones are added from the folder of real data. OUT gets results.json,
    results.csv, table.md and errors.png. What is finished is kept in OUT/cache: an interrupted run is resumed by the
    same command, and only what has changed is computed again.
    """
    from ospc.benchmark.design import accuracy_cases
    from ospc.benchmark.files import as_json as everything
    from ospc.benchmark.files import write_results
    from ospc.benchmark.tasks import choose
    from ospc.settings import preset

    names = [name.strip() for name in presets.split(",") if name.strip()]
    if not names:
        raise SettingError("--presets names no preset; give default, paper, or both")
    for name in names:
        preset(name)
    if data is not None and not data.is_dir():
        raise SettingError(f"{data}: is not a folder; give the folder of real data, or leave --data out")
    cases, notes = accuracy_cases(data, frames)
    cases = choose(cases, only)
    results, complete = _run(cases, names, out / "cache", jobs)
    files, problems = write_results(out, results, names, notes) if results else ([], [])
    if as_json:
        click.echo(json.dumps(everything(results, names, notes), indent=1))
    else:
        _print(results)
    for line in (*notes, *problems, *(str(path) for path in files)):
        click.echo(line, err=as_json)
    if not complete:
        click.echo("interrupted: run the same command again to go on where it stopped", err=True)
        sys.exit(_INTERRUPTED)


@command.command()
@click.option("-o", "--out", type=click.Path(path_type=Path), default=Path("ospc-speed"), show_default=True)
@click.option("--presets", default="default,fast,paper", show_default=True, help="Presets, separated by commas.")
@click.option(
    "--size", "sizes", multiple=True, metavar="WxH", help="Size of the frames; repeatable. [640x480, 1280x1024]"
)
@click.option("--frames", type=click.IntRange(2, 1_000_000), default=1500, show_default=True, help="Frames pushed.")
@click.option("--live", "live_s", type=click.FloatRange(0, 3600), default=10, show_default=True, help="Seconds live.")
@click.option(
    "--rate", "rate_hz", type=click.FloatRange(0.1, 1000), default=50, show_default=True, help="Frames/s live."
)
@click.option("--json", "as_json", is_flag=True, help="Print speed.json instead of a table.")
def speed(
    out: Path, *, presets: str, sizes: tuple[str, ...], frames: int, live_s: float, rate_hz: float, as_json: bool
) -> None:
    """Measure how fast the presets are, against merely decoding the same frames.

    Simulated JPEG frames are calibrated and, in the same process, merely decoded. Afterwards a camera is played live.
    OUT gets speed.json and speed.png, which shows where the time goes. Preset "paper" is measured with 30 frames.
    """
    from rich.console import Console

    from ospc.benchmark.speed import SIZES, SLOW_FRAMES, measured
    from ospc.benchmark.speed_files import as_json as everything
    from ospc.benchmark.speed_files import table_of, write
    from ospc.settings import preset

    names = tuple(name.strip() for name in presets.split(",") if name.strip())
    for name in names:
        preset(name)
    wanted = tuple(_size(text) for text in sizes) or SIZES
    rows = list(measured(names, wanted, frames, live_s, rate_hz))
    files, problems = write(out, rows)
    if as_json:
        click.echo(json.dumps(everything(rows), indent=1))
    else:
        Console(highlight=False, width=_WIDTH).print(_rich(table_of(rows)), soft_wrap=True)
        click.echo(
            f"× decoding: time over that of decoding the same frames in one thread; paper: {SLOW_FRAMES} frames"
        )
    for line in (*problems, *(str(path) for path in files)):
        click.echo(line, err=as_json)


def _size(text: str) -> tuple[int, int]:
    width, found, height = text.lower().replace("×", "x").partition("x")
    if not (
        found and width.isdecimal() and height.isdecimal() and 64 <= int(width) <= 8192 and 64 <= int(height) <= 8192
    ):
        raise SettingError(f"'{text}' is no size such as 640x480, of 64 to 8192 pixels a side")
    return int(width), int(height)


def _run(cases: Sequence[Case], presets: Sequence[str], cache: Path, jobs: int) -> tuple[list[CaseResult], bool]:
    """Run everything that is not in the cache; return what is finished, and whether that is all."""
    from rich.console import Console
    from rich.progress import Progress

    from ospc.benchmark.store import Store
    from ospc.benchmark.summary import CaseResult
    from ospc.benchmark.tasks import Task, run

    tasks = [Task(case, preset) for preset in presets for case in cases]
    found: dict[tuple[str, str], list[Row]] = {}
    complete = False
    try:
        with Progress(console=Console(stderr=True), transient=True) as bar:
            line = bar.add_task("starting", total=len(tasks))

            def show(task: Task, share: float) -> None:
                bar.update(line, completed=len(found) + share, description=f"{task.case.name} ({task.preset})")

            for result in run(tasks, Store(cache), jobs, show):
                found[result.task.case.name, result.task.preset] = result.rows
                bar.update(line, completed=len(found))
        complete = True
    except KeyboardInterrupt:
        pass
    rows = [(case, tuple(row for p in presets for row in found.get((case.name, p), []))) for case in cases]
    return [CaseResult(case, these) for case, these in rows if these], complete


def _print(results: Sequence[CaseResult]) -> None:
    from rich.console import Console

    from ospc.benchmark.tables import all_tables

    # The terminal wraps lines that are longer; cells that were cut short would be lost.
    console = Console(highlight=False, width=_WIDTH)
    for table in all_tables(results):
        console.print(_rich(table), soft_wrap=True)
        console.print()


def _rich(table: Table) -> RichTable:
    from rich.markup import escape
    from rich.table import Table as RichTable

    shown = RichTable(title=escape(table.title), title_justify="left")
    for number, head in enumerate(table.header):
        shown.add_column(escape(head), justify="left" if number < table.names else "right", no_wrap=True)
    for row in table.rows:
        shown.add_row(*(escape(text) for text in row))
    return shown
