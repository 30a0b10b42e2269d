"""``ospc batch``: many recordings of many cameras, on this machine or on a cluster."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ospc.cli.calibration_report import print_json, say_notes
from ospc.cli.interruption import INTERRUPTED, Interruption, leaving
from ospc.cli.options import exit_codes, force_option, json_option, named, out_option, quiet_option
from ospc.cli.progress import progress_line
from ospc.cli.terminal import say
from ospc.errors import counted

if TYPE_CHECKING:
    from ospc.batch.manifest import Entry
    from ospc.batch.run import Outcome, Stage

COMPLETE, SOME_FAILED = 0, 4

_MOST_LISTED = 10
"""Failures, folders left out, and contradictions of one camera, that are listed; the table has all recordings."""


@click.command(
    "batch",
    epilog=exit_codes(
        {
            COMPLETE: "every recording was calibrated",
            SOME_FAILED: "some recordings failed; the messages and OUT say which and why",
            INTERRUPTED: "interrupted; run the same command again to go on",
        }
    ),
)
@click.argument("manifest")
@out_option(help="Folder to write the results to.")
@click.option("-j", "--jobs", type=click.IntRange(1), help="Processes on this machine; by default one per core.")
@click.option(
    "--scheduler", metavar="ADDRESS", help="Run on the Dask cluster of this scheduler, such as tcp://host:8786."
)
@click.option(
    "--retries",
    type=click.IntRange(0, 100),
    default=1,
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
@force_option("Write into OUT even if it holds other files.")
@quiet_option
@json_option
@click.pass_obj
def command(
    interruption: Interruption,
    /,
    *,
    manifest: str,
    out: Path,
    jobs: int | None,
    scheduler: str | None,
    retries: int,
    camera: str | None,
    options: tuple[str, ...],
    force: bool,
    quiet: bool,
    as_json: bool,
) -> int:
    """Calibrate all recordings that MANIFEST names, and merge those of each camera.

    MANIFEST is a folder with recordings, a pattern such as 'data/*/cam0', or a .csv or .parquet table with the
    columns recording, camera and options. Recordings may be in object stores (s3://…; extra 'objects').

    OUT gets the page index.html, batch.csv and batch.parquet with a row per recording, and cameras/NAME with the
    calibration of each camera. Run again, the command does only what is new, changed or failed.
    """
    from ospc.batch.cluster import Cluster
    from ospc.batch.run import run_batch
    from ospc.batch.work import Processes, cores

    if jobs is not None and scheduler is not None:
        raise click.UsageError("--jobs is for this machine and --scheduler for a cluster; give only one of them")
    entries, left_out = _entries(manifest, camera, options)
    if not quiet:
        say_notes(_shortened(left_out, "folders"), "left out")
    runner = Processes(jobs or cores()) if scheduler is None else Cluster(scheduler)
    with leaving("no result was written"), interruption.deferred(), progress_line(quiet=quiet) as show:

        def progress(stage: Stage) -> None:
            show(stage.name, stage.done, stage.total, f"{stage.failed} failed" if stage.failed else "")
            interruption.check()

        outcome = run_batch(entries, out, runner, retries=retries, force=force, progress=progress)
    if as_json:
        print_json(_as_json(outcome, out) | {"left_out": left_out})
    else:
        _warn(outcome, out)
        if not quiet:
            _say(outcome, out)
    return _exit_code(outcome)


def _entries(manifest: str, camera: str | None, options: tuple[str, ...]) -> tuple[list[Entry], list[str]]:
    """Return the recordings with the given options, and which folders hold none and why."""
    from ospc.batch.manifest import read_manifest

    left_out: list[str] = []
    found = read_manifest(manifest, camera, left_out.append)
    defaults = named(options, "rounds=4")
    return [entry.with_defaults(defaults).checked() for entry in found], left_out


def _shortened(lines: list[str], what: str) -> list[str]:
    more = len(lines) - _MOST_LISTED
    return [*lines[:_MOST_LISTED], f"… and {more} more {what}"] if more > 0 else lines


def _exit_code(outcome: Outcome) -> int:
    if outcome.interrupted:
        return INTERRUPTED
    return SOME_FAILED if outcome.failed else COMPLETE


def _warn(outcome: Outcome, out: Path) -> None:
    failed = [f"{row.recording}: {row.error} (tried {counted(row.attempts, 'time')})" for row in outcome.failed]
    say_notes(_shortened(failed, f"in {out / 'batch.csv'}"), "failed")
    for camera in outcome.cameras:
        if camera.error:
            say(f"warning: {camera.name}: {camera.error}", err=True)
        for difference in camera.differing[:_MOST_LISTED]:
            say(f"warning: {difference.name} contradicts others of {camera.name}: {difference.text}", err=True)


def _say(outcome: Outcome, out: Path) -> None:
    say_notes(outcome.notes)
    done = [row for row in outcome.rows if row.status == "done"]
    earlier = sum(row.attempts == 0 for row in done)
    known = sum(camera.calibration is not None and camera.calibration.complete for camera in outcome.cameras)
    say(
        f"{len(done)} of {counted(len(outcome.rows), 'recording')} calibrated ({earlier} of them before), "
        f"{len(outcome.failed)} failed"
    )
    say(f"{known} of {counted(len(outcome.cameras), 'camera')} fully calibrated")
    if outcome.interrupted:
        say("interrupted; run the same command again to go on")
    say(f"written to {out}: {', '.join(file.name for file in outcome.files)}")


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
