"""``ospc batch``: calibrate many recordings of many cameras, on this machine or on a cluster."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ospc.cli.interruption import Interruption, leaving
from ospc.cli.options import AS_JSON, QUIET, argument, declared, option, out_option, parse_assignments
from ospc.cli.terminal import COMPLETE, INTERRUPTED, UNDETERMINED, print_json, progress_line, say, say_notes
from ospc.errors import SettingError, counted

if TYPE_CHECKING:
    from ospc.batch.cameras import Camera
    from ospc.batch.run import BatchOutcome
    from ospc.batch.work import Answer, Task

_SOME_FAILED = 4
"""Exit code if some recordings failed."""
_MOST_LISTED = 10
"""Most failures, ignored folders, and contradictions of one camera that are listed; the table has all recordings."""


@declared(
    "batch",
    exits={
        COMPLETE: "every recording was processed, and response and vignette of every camera are identifiable",
        UNDETERMINED: "every recording was processed, but response or vignette of a camera is marginal or not "
        "identifiable",
        _SOME_FAILED: "some recordings failed; the messages and OUT show which and why",
        INTERRUPTED: "interrupted; run the same command again to continue",
    },
)
def command(
    interruption: Interruption,
    *,
    manifest: str = argument(),
    out: Path = out_option("Folder to write the results to."),
    jobs: int | None = option(
        "Processes on this machine; by default one per core.", "-j", "--jobs", type=click.IntRange(1)
    ),
    scheduler: str | None = option(
        "Run on the Dask cluster with this scheduler, such as tcp://host:8786.", metavar="ADDRESS"
    ),
    retries: int = option(
        "Number of retries for failed recordings, after all others.", type=click.IntRange(0, 100), default=1
    ),
    camera: str | None = option("Name of the camera for all recordings, instead of that in MANIFEST."),
    options: tuple[str, ...] = option(
        "Setting of the method or of reading (exposure_unit=us, kind=euroc); those in MANIFEST take precedence.",
        "--set",
        metavar="NAME=VALUE",
    ),
    force: bool = option("Write into OUT even if it contains other files."),
    quiet: bool = QUIET,
    as_json: bool = AS_JSON,
) -> int:
    """Calibrate all recordings in MANIFEST, and merge those of each camera.

    MANIFEST is a folder with recordings, a pattern such as 'data/*/cam0', or a .csv table with the columns
    recording, camera and options. Recordings may be in object stores (s3://…; extra 'objects').

    OUT gets the page index.html, batch.csv with a row per recording, and cameras/NAME with the calibration of
    each camera. Run the command again to process new, changed or failed recordings only.
    """
    from ospc.batch.cluster import on_cluster
    from ospc.batch.manifest import Entry, read_manifest
    from ospc.batch.run import run_batch
    from ospc.batch.work import cores, on_this_machine

    if jobs is not None and scheduler is not None:
        raise click.UsageError("--jobs applies to this machine and --scheduler to a cluster; use only one of them")
    left_out: list[str] = []
    found = read_manifest(manifest, camera, left_out.append)
    defaults = parse_assignments(options, "rounds=4")
    try:
        Entry("--set", options=tuple(defaults.items())).checked()
    except SettingError as error:
        raise click.UsageError(str(error)) from None
    entries = [entry.with_defaults(defaults).checked() for entry in found]
    if not quiet:
        say_notes(_shortened(left_out, "folders"), "left out")
    here = partial(on_this_machine, processes=jobs or cores())
    run = here if scheduler is None else partial(on_cluster, address=scheduler)
    with leaving("no result was written"), interruption.deferred(), progress_line(quiet=quiet) as show:

        def progress(stage: str, done: int, total: int, failed: int) -> None:
            show(stage, done, total, f"{failed} failed" if failed else "")
            interruption.check()

        def interruptible(tasks: Iterable[Task]) -> Generator[Answer, None, None]:
            # Waiting for the next answer may take minutes.
            yield from interruption.until_requested(run(tasks))
            interruption.check()

        outcome = run_batch(entries, out, interruptible, retries=retries, force=force, progress=progress)
    code = _exit_code(outcome)
    if as_json:
        print_json({"exit_code": code, **_as_json(outcome, out), "left_out": left_out})
    else:
        _warn(outcome, out)
        if not quiet:
            _say(outcome, out)
    return code


def _exit_code(outcome: BatchOutcome) -> int:
    if outcome.interrupted:
        return INTERRUPTED
    if outcome.failed:
        return _SOME_FAILED
    return COMPLETE if all(camera.is_complete for camera in outcome.cameras) else UNDETERMINED


def _shortened(lines: list[str], what: str) -> list[str]:
    more = len(lines) - _MOST_LISTED
    return [*lines[:_MOST_LISTED], f"… and {more} more {what}"] if more > 0 else lines


def _warn(outcome: BatchOutcome, out: Path) -> None:
    failed = [f"{row.recording}: {row.error} (tried {counted(row.attempts, 'time')})" for row in outcome.failed]
    say_notes(_shortened(failed, f"in {out / 'batch.csv'}"), "failed")
    for camera in outcome.cameras:
        contradicting = camera.differing[:_MOST_LISTED]
        warnings = [f"{camera.name}: {camera.error}"] if camera.error else []
        warnings += [f"{other.name} contradicts others of {camera.name}: {other.text}" for other in contradicting]
        say_notes(warnings, "warning")


def _say(outcome: BatchOutcome, out: Path) -> None:
    done = [row for row in outcome.rows if row.status == "done"]
    earlier = sum(row.attempts == 0 for row in done)
    known = sum(camera.is_complete for camera in outcome.cameras)
    say(
        f"{len(done)} of {counted(len(outcome.rows), 'recording')} processed ({earlier} of them before), "
        f"{len(outcome.failed)} failed"
    )
    if outcome.cameras:
        say(f"{known} of {counted(len(outcome.cameras), 'camera')} fully calibrated")
    say_notes(_shortened(list(_incomplete(outcome.cameras)), "cameras"), "incomplete")
    if outcome.interrupted:
        say("interrupted; run the same command again to continue")
    say(f"written to {out}: {', '.join(file.name for file in outcome.files)}")


def _incomplete(cameras: Iterable[Camera]) -> Iterator[str]:
    """Yield a line with the reasons for each camera whose calibration is not complete."""
    for camera in cameras:
        if camera.calibration is not None and not camera.is_complete:
            verdicts = camera.calibration.verdicts.items()
            doubts = [f"{what} is {v.state}: {v.reason}" for what, v in verdicts if v.state != "identifiable"]
            yield f"{camera.name}: {'; '.join([*doubts, *camera.calibration.warnings])}"


def _as_json(outcome: BatchOutcome, out: Path) -> dict[str, Any]:
    return {
        "out": str(out),
        "recordings": len(outcome.rows),
        "done": sum(row.status == "done" for row in outcome.rows),
        "failed": [{"recording": row.recording, "error": row.error} for row in outcome.failed],
        "cameras": {
            camera.name: {
                "recordings": camera.recordings,
                "failed": camera.failed,
                "differing": [d.name for d in camera.differing],
                "complete": camera.is_complete,
                "error": camera.error or None,
            }
            for camera in outcome.cameras
        },
        "interrupted": outcome.interrupted,
        "files": [str(file) for file in outcome.files],
    }
