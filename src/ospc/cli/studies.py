"""Options, progress and output shared by the commands that run studies."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ospc.cli.options import option, out_option, parse_assignments
from ospc.cli.terminal import console, print_json, progress_line, say
from ospc.errors import SettingError, escaped
from ospc.formats.files import json_object, json_text, write_text
from ospc.system.folders import Content, check_usable

if TYPE_CHECKING:
    from ospc.formats.opening import Photometry
    from ospc.research.runner import Finished, Task
    from ospc.research.tables import StudyReport, Table

_EXAMPLE = "theirs=pcalib.txt,vignette.png"
"""Example of a calibration of another program."""
_CACHE = "cache"
"""Folder of finished results in the folder of a study."""
_WIDTH = 400
"""Width of tables in characters: the terminal wraps longer lines, whereas cut cells would be lost."""


def study_out_option(default: str) -> Any:
    """Declare the option for the output folder."""
    return out_option("Folder to write the results to.", default=Path(default))


def presets_option(default: str) -> Any:
    """Declare the option for presets."""
    return option("Presets, separated by commas.", default=default, multiple=False, callback=_presets)


def _presets(_ctx: click.Context, _param: click.Parameter, text: str) -> tuple[str, ...]:
    from ospc.settings import preset

    names = words(text)
    if not names:
        raise SettingError("--presets names no preset; give default, paper, or both")
    for name in names:
        preset(name)
    return names


def _folder(_ctx: click.Context, _param: click.Parameter, place: Path | None) -> Path | None:
    if place is not None and not place.is_dir():
        raise SettingError(f"{place}: is not a folder; give the folder of real data, or omit --data")
    return place


DATA = option("Folder of real data.", envvar="OSPC_DATA", callback=_folder)
JOBS = option("Number of processes.", type=click.IntRange(1, 256), default=1)
CALIBRATIONS = option(
    f"Calibration of another program to compare, such as {_EXAMPLE}; repeatable.",
    "--calibration",
    metavar="NAME=FILES",
)


def words(text: str) -> tuple[str, ...]:
    """Return the words of a comma-separated list."""
    return tuple(word.strip() for word in text.split(",") if word.strip())


def by_name(recordings: Iterable[Path]) -> dict[str, Path]:
    """Return recordings by the name of their folder, which identifies them in results."""
    found: dict[str, Path] = {}
    for place in recordings:
        name = escaped(place.resolve().name)
        if name in found:
            raise SettingError(f"two recordings are named {name}; rename the folder of one of them")
        found[name] = place
    return found


def given_calibrations(entries: Iterable[str]) -> dict[str, Photometry]:
    """Open the calibrations of other programs."""
    from ospc.formats.opening import open_photometry

    return {name: open_photometry(files) for name, files in parse_assignments(entries, _EXAMPLE).items()}


def study_cache(out: Path) -> Path:
    """Return the folder of finished results in the folder of a study, which must be new or from an earlier study."""
    check_usable(out, content_of=_content)
    return out / _CACHE


def run_study(
    tasks: Sequence[Task],
    out: Path,
    jobs: int,
    report: Callable[[Sequence[Finished]], StudyReport],
    *,
    as_json: bool = False,
) -> None:
    """Run tasks with a progress bar, then write and print the report on the finished ones, in their order."""
    from ospc.research.runner import ResultStore, run

    store = ResultStore(study_cache(out))
    found: dict[str, Finished] = {}
    interrupted = False
    with progress_line() as show:
        results = run(tasks, store, jobs, lambda task, share: show(task.name, len(found) + share, len(tasks)))
        try:
            for task, result in results:
                found[task.name] = (task, result)
        except KeyboardInterrupt:
            interrupted = True
    if found or not tasks:
        finished = [found[task.name] for task in tasks if task.name in found]
        _present(report(finished), out, as_json=as_json)
    if interrupted:
        raise KeyboardInterrupt("the same command continues where it stopped")


def _content(place: Path) -> Content:
    if (place / _CACHE).is_dir():
        return Content("contains an earlier study", "always")
    return Content("contains files that are not from an earlier study", "never")


def _present(report: StudyReport, out: Path, *, as_json: bool) -> None:
    """Write a report instead of the files that an earlier run has listed, and print it, as tables or JSON."""
    listing = out / _CACHE / "files.json"
    earlier = json_object(listing)
    written = report.write(out)
    names = dict.fromkeys(file.name for file in written)
    for name in earlier.keys() - names.keys():
        with suppress(OSError):
            (out / Path(name).name).unlink()
    if names != earlier:
        write_text(listing, json_text(names) + "\n")
    if as_json:
        print_json(report.content)
    else:
        for table in report.tables:
            _print_table(table)
    for line in report.notes:
        say(line, err=as_json)
    say(f"written to {out}: {', '.join(path.name for path in written)}", err=as_json)


def _print_table(table: Table) -> None:
    from rich.table import Table as RichTable
    from rich.text import Text

    shown = RichTable(title=Text(table.title, "table.title"), title_justify="left")
    for number, head in enumerate(table.header):
        shown.add_column(Text(head), justify="left" if number < table.names else "right", no_wrap=True)
    for i, row in enumerate(table.rows):
        shown.add_row(*(Text(cell, "bold" if (i, j) in table.best else "") for j, cell in enumerate(row)))
    console(width=_WIDTH).print(shown, soft_wrap=True)
    say()
