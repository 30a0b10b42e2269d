"""What the commands of studies share: their options, their progress, and how they print tables and files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from ospc.cli.calibration_report import print_json
from ospc.cli.options import PATH, named, out_option
from ospc.cli.progress import progress_line
from ospc.cli.terminal import console, say
from ospc.errors import SettingError

if TYPE_CHECKING:
    from ospc.formats.opening import Photometry
    from ospc.research.runner import Finished, Task
    from ospc.research.tables import StudyReport, Table

_Command = TypeVar("_Command", bound=Callable[..., Any])
EXAMPLE = "theirs=pcalib.txt,vignette.png"
"""A calibration of another program, as its option takes it."""

_WIDTH = 400
"""Columns of tables: the terminal wraps lines that are longer; cells that were cut would be lost."""

study_out_option = partial(out_option, help="Folder of the results.")
jobs_option = click.option("--jobs", type=click.IntRange(1, 256), default=1, help="Number of processes.")
calibration_option = click.option(
    "--calibration",
    "given",
    multiple=True,
    metavar="NAME=FILES",
    help=f"Calibration of another program to be compared, such as {EXAMPLE}; repeatable.",
)


def presets_option(default: str) -> Callable[[_Command], _Command]:
    """Give a command the option for presets."""
    return click.option("--presets", default=default, help="Presets, separated by commas.", callback=_presets)


def _folder(_ctx: click.Context, _param: click.Parameter, value: Path | None) -> Path | None:
    if value is not None and not value.is_dir():
        raise SettingError(f"{value}: is not a folder; give the folder of real data, or leave --data out")
    return value


data_option = click.option("--data", type=PATH, envvar="OSPC_DATA", callback=_folder, help="Folder of real data.")


def _presets(_ctx: click.Context, _param: click.Parameter, value: str) -> tuple[str, ...]:
    from ospc.settings import preset

    names = words(value)
    if not names:
        raise SettingError("--presets names no preset; give default, paper, or both")
    for name in names:
        preset(name)
    return names


def words(text: str) -> tuple[str, ...]:
    """Return the words of a list that is separated by commas."""
    return tuple(word.strip() for word in text.split(",") if word.strip())


def given_calibrations(entries: Iterable[str]) -> dict[str, Photometry]:
    """Open the calibrations of other programs."""
    from ospc.formats.opening import open_photometry

    return {name: open_photometry(files) for name, files in named(entries, EXAMPLE).items()}


def run_study(
    tasks: Sequence[Task],
    out: Path,
    jobs: int,
    report: Callable[[Sequence[Finished]], StudyReport],
    *,
    as_json: bool = False,
    partly: Callable[[Sequence[Finished]], bool] = lambda _finished: False,
) -> None:
    """Run tasks with a progress bar, then write and print the report on those that finished, in their order.

    It is also written whenever ``partly`` says so of those finished so far: an interruption leaves what was there.
    """
    from ospc.research.runner import ResultStore, run

    found: dict[str, Finished] = {}

    def finished() -> list[Finished]:
        return [found[task.name] for task in tasks if task.name in found]

    interrupted = False
    with progress_line() as show:
        results = run(
            tasks,
            ResultStore(out / "cache"),
            jobs,
            lambda task, share: show(task.name, len(found) + share, len(tasks)),
        )
        try:
            for one in results:
                found[one.task.name] = one
                if len(found) < len(tasks) and partly(finished()):
                    report(finished()).write(out)
        except KeyboardInterrupt:
            interrupted = True
    if found or not tasks:
        _present(report(finished()), out, as_json=as_json)
    if interrupted:
        raise KeyboardInterrupt("the same command continues where it stopped")


def print_tables(tables: Iterable[Table]) -> None:
    """Print tables, with marked cells in bold."""
    from rich.markup import escape
    from rich.table import Table as RichTable

    shown_on = console(width=_WIDTH)
    for table in tables:
        shown = RichTable(title=escape(table.title), title_justify="left")
        for number, head in enumerate(table.header):
            shown.add_column(escape(head), justify="left" if number < table.names else "right", no_wrap=True)
        for i, row in enumerate(table.rows):
            cells = enumerate(map(escape, row))
            shown.add_row(*(f"[bold]{cell}[/bold]" if (i, j) in table.best else cell for j, cell in cells))
        shown_on.print(shown, soft_wrap=True)
        say()


def _present(report: StudyReport, out: Path, *, as_json: bool) -> None:
    """Write a report, and print it, as tables or JSON."""
    written = report.write(out)
    if as_json:
        print_json(report.content)
    else:
        print_tables(report.tables)
    for line in report.notes:
        say(line, err=as_json)
    say(f"written to {out}: {', '.join(path.name for path in written)}", err=as_json)
