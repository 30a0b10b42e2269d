"""``ospc batch``: many recordings of many cameras, on this machine or on a cluster."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ospc.cli.interruption import Interruption

if TYPE_CHECKING:
    from ospc.batch.entries import Entry
    from ospc.batch.local import Runner
    from ospc.batch.run import Outcome, Stage

COMPLETE, SOME_FAILED, INTERRUPTED = 0, 4, 130
"""Exit codes; 130 is that of a shell for a program that Ctrl-C ended."""

_MOST_LISTED = 10
"""Failures, and contradictions of one camera, that are listed; the table has all."""


@dataclass(frozen=True)
class _Request:
    """The options as given."""

    manifest: str
    out: Path
    jobs: int | None
    scheduler: str | None
    retries: int
    camera: str | None
    options: tuple[str, ...]
    force: bool
    quiet: bool
    as_json: bool


@click.command("batch")
@click.argument("manifest")
@click.option("-o", "--out", type=click.Path(path_type=Path), required=True, help="Folder to write the results to.")
@click.option("-j", "--jobs", type=click.IntRange(1), help="Processes on this machine; by default one per core.")
@click.option(
    "--scheduler", metavar="ADDRESS", help="Run on the Dask cluster of this scheduler, such as tcp://host:8786."
)
@click.option(
    "--retries",
    type=click.IntRange(0, 100),
    default=1,
    show_default=True,
    help="How often a recording that failed is tried again, after all others.",
)
@click.option("--camera", help="Name of the camera of all recordings, in place of what MANIFEST says.")
@click.option(
    "--set",
    "options",
    metavar="NAME=VALUE",
    multiple=True,
    help="A setting of the method or of reading (exposure_unit=us, kind=euroc); those in MANIFEST take precedence.",
)
@click.option("--force", is_flag=True, help="Write into OUT even if it holds other files.")
@click.option("-q", "--quiet", is_flag=True, help="Print only errors.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON summary on standard output.")
def command(**options: Any) -> None:
    """Calibrate all recordings that MANIFEST names, and merge those of each camera.

    MANIFEST is a folder with recordings, a pattern such as 'data/*/cam0', or a .csv or .parquet table with the
    columns recording, camera and options. Recordings may be in object stores (s3://…; extra 'objects').

    OUT gets the page index.html, batch.csv and batch.parquet with a row per recording, and cameras/NAME with the
    calibration of each camera. Run again, the command does only what is new, changed or failed.

    \b
    Exit codes:
      0    every recording was calibrated
      1    error
      2    wrong usage
      4    some recordings failed; the messages and OUT say which and why
      130  interrupted; run the same command again to go on
    """  # noqa: D301 (click reads the escaped character as "do not rewrap")
    from ospc.cli.calibrate import one_line

    with Interruption() as interruption:
        sys.exit(one_line(lambda: _batch(_Request(**options), interruption)))


def _batch(request: _Request, interruption: Interruption) -> int:
    from ospc.batch.run import run_batch

    if request.jobs is not None and request.scheduler is not None:
        raise click.UsageError("--jobs is for this machine and --scheduler for a cluster; give only one of them")
    entries = _entries(request)
    visible = not request.quiet and sys.stderr.isatty()
    with interruption.deferred(), _progress(interruption, visible=visible) as show:
        outcome = run_batch(
            entries, request.out, _runner(request), retries=request.retries, force=request.force, progress=show
        )
    if request.as_json:
        click.echo(json.dumps(_as_json(outcome, request.out), indent=1))
    elif not request.quiet:
        _say(outcome, request.out)
    return _exit_code(outcome)


def _entries(request: _Request) -> list[Entry]:
    from ospc.batch.entries import options_of
    from ospc.batch.manifest import read_manifest
    from ospc.errors import SettingError

    try:
        defaults = options_of(" ".join(option.replace(" ", "") for option in request.options))
    except SettingError as error:
        raise click.UsageError(str(error)) from None
    return [entry.with_defaults(defaults).checked() for entry in read_manifest(request.manifest, request.camera)]


def _runner(request: _Request) -> Runner:
    from ospc.batch.cluster import Cluster
    from ospc.batch.local import Processes, cores

    return Processes(request.jobs or cores()) if request.scheduler is None else Cluster(request.scheduler)


def _exit_code(outcome: Outcome) -> int:
    if outcome.interrupted:
        return INTERRUPTED
    return SOME_FAILED if outcome.failed else COMPLETE


def _say(outcome: Outcome, out: Path) -> None:
    for note in outcome.notes:
        click.echo(f"note: {note}", err=True)
    for row in outcome.failed[:_MOST_LISTED]:
        click.echo(f"failed: {row.recording}: {row.error} (tried {row.attempts} times)", err=True)
    if len(outcome.failed) > _MOST_LISTED:
        click.echo(f"failed: … and {len(outcome.failed) - _MOST_LISTED} more, see {out / 'batch.csv'}", err=True)
    for camera in outcome.cameras:
        for difference in camera.differing[:_MOST_LISTED]:
            click.echo(f"warning: {difference.name} contradicts others of {camera.name}: {difference.text}", err=True)
    done = [row for row in outcome.rows if row.status == "done"]
    earlier = sum(row.attempts == 0 for row in done)
    known = sum(camera.calibration is not None and camera.calibration.complete for camera in outcome.cameras)
    click.echo(
        f"{len(done)} of {len(outcome.rows)} recordings calibrated ({earlier} of them before), "
        f"{len(outcome.failed)} failed"
    )
    click.echo(f"{known} of {len(outcome.cameras)} cameras fully calibrated")
    if outcome.interrupted:
        click.echo("interrupted; run the same command again to go on")
    click.echo(f"written to {out}: {', '.join(file.name for file in outcome.files)}")


def _as_json(outcome: Outcome, out: Path) -> dict[str, Any]:
    return {
        "exit_code": _exit_code(outcome),
        "out": str(out),
        "recordings": len(outcome.rows),
        "done": sum(row.status == "done" for row in outcome.rows),
        "failed": [{"recording": row.recording, "error": row.error} for row in outcome.failed],
        "cameras": {
            camera.name: {
                "recordings": camera.recordings,
                "failed": camera.failed,
                "differing": [d.name for d in camera.differing],
                "complete": camera.calibration is not None and camera.calibration.complete,
                "error": camera.error or None,
            }
            for camera in outcome.cameras
        },
        "interrupted": outcome.interrupted,
        "files": [str(file) for file in outcome.files],
        "notes": list(outcome.notes),
    }


@contextmanager
def _progress(interruption: Interruption, *, visible: bool) -> Iterator[Callable[[Stage], None]]:
    """Give a function that shows how far the batch has come, and stops it when the user asked for that."""

    def stop_if_asked() -> None:
        if interruption.requested:
            raise KeyboardInterrupt

    if not visible:
        yield lambda _stage: stop_if_asked()
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description:14}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TextColumn("{task.fields[failed]}"),
        TimeRemainingColumn(compact=True),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        shown: dict[str, Any] = {}

        def show(stage: Stage) -> None:
            if stage.name not in shown:
                shown[stage.name] = bar.add_task(stage.name, total=stage.total, failed="")
            failed = f"{stage.failed} failed" if stage.failed else ""
            bar.update(shown[stage.name], completed=stage.done, failed=failed)
            stop_if_asked()

        yield show
