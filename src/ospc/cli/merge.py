"""``ospc merge``: one calibration of several recordings of one camera."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ospc.cli.checkpoints import STATE_NAME

if TYPE_CHECKING:
    from ospc.formats.opening import Photometry
    from ospc.output import OutputFolder, Written
    from ospc.photometry.calibration import Calibration
    from ospc.pooling.agreement import Difference

COMPLETE, UNDETERMINED = 0, 3


@dataclass(frozen=True)
class _Request:
    """The options as given."""

    states: tuple[Path, ...]
    out: Path
    truth: str | None
    force: bool
    quiet: bool
    as_json: bool


@click.command("merge")
@click.argument("states", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("-o", "--out", type=click.Path(path_type=Path), required=True, help="Folder to write the results to.")
@click.option("--truth", metavar="PATH", help="A known calibration to compare with, as for 'ospc calibrate'.")
@click.option(
    "--force",
    is_flag=True,
    help="Write into OUT even if it holds other files; earlier results go.",
)
@click.option("-q", "--quiet", is_flag=True, help="Print only errors and warnings.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON summary on standard output.")
def command(**options: Any) -> None:
    """Merge the STATES of recordings of one camera into one calibration.

    STATES are state.ospc files that 'ospc calibrate' or 'ospc merge' wrote, or the folders that hold them, in any
    order. A recording given twice counts once. The checkpoint of an unfinished run is refused: finish the run with
    'ospc calibrate --resume' first. Recordings that contradict the others are reported and left out.

    OUT gets the files that 'ospc calibrate' writes; OUT/state.ospc can be merged again with others.

    \b
    Exit codes:
      0  complete: response and vignette are known
      1  error
      2  wrong usage
      3  written, but response or vignette could not be determined
    """  # noqa: D301 (click reads the escaped character as "do not rewrap")
    sys.exit(_merge(_Request(**options)))


def _merge(request: _Request) -> int:
    from ospc.errors import FormatError
    from ospc.formats.opening import open_photometry
    from ospc.output import OutputFolder, Written
    from ospc.pooling.pool import Pool
    from ospc.pooling.pooled_calibration import merge

    known = None if request.truth is None else open_photometry(request.truth)
    folder = OutputFolder.at(request.out, force=request.force)
    pool = Pool.of(summary for place in request.states for summary in Pool.load(place).summaries)
    merged = merge(pool)
    calibration = merged.calibration
    written = folder.write(calibration)
    written += Written((pool.save(folder.path / STATE_NAME),))
    written += folder.report(calibration, None, known)
    written += folder.draw(calibration, known)
    differing = list(merged.agreement.differing.values())
    if request.as_json:
        click.echo(json.dumps(_as_json(calibration, differing, folder, written, known), indent=1))
    else:
        _say(calibration, differing, folder, written, known, quiet=request.quiet)
    if written.problems:
        raise FormatError("; ".join(written.problems))
    return COMPLETE if calibration.complete else UNDETERMINED


def _say(
    calibration: Calibration,
    differing: list[Difference],
    folder: OutputFolder,
    written: Written,
    known: Photometry | None,
    *,
    quiet: bool,
) -> None:
    from ospc.cli.calibration_report import say_errors, say_notes, say_verdicts

    for difference in differing:
        click.echo(f"warning: {difference.name} differs from the others: {difference.text}", err=True)
    if quiet:
        return
    say_verdicts(calibration)
    counts = calibration.counts
    click.echo(f"from {counts['recordings']} recordings, {counts['frames']} frames, {counts['samples']} samples")
    click.echo(f"written to {folder.path}: {', '.join(str(f.relative_to(folder.path)) for f in written.files)}")
    say_notes(written.notes)
    if known is not None:
        say_errors(_compared(calibration, known), calibration, known.name)


def _compared(calibration: Calibration, known: Photometry) -> Any:
    from ospc.errors import FormatError
    from ospc.evaluation.comparison import compare
    from ospc.formats.opening import Photometry

    try:
        return compare(Photometry("merged", calibration.response, calibration.vignette, calibration), known)
    except FormatError:  # they have neither response nor vignette in common
        return None


def _as_json(
    calibration: Calibration,
    differing: list[Difference],
    folder: OutputFolder,
    written: Written,
    known: Photometry | None,
) -> dict[str, Any]:
    content: dict[str, Any] = {
        "exit_code": COMPLETE if calibration.complete else UNDETERMINED,
        "out": str(folder.path),
        "verdicts": {name: vars(verdict) for name, verdict in calibration.verdicts.items()},
        "counts": calibration.counts,
        "differing": [
            {"name": d.name, "parts": list(d.parts), "sigmas": d.sigmas, "text": d.text} for d in differing
        ],
        "files": [str(file) for file in written.files],
        "notes": list(written.notes),
    }
    comparison = None if known is None else _compared(calibration, known)
    if comparison is not None:
        names = ("response_rmse", "response_shape_rmse", "log_ratio_error", "vignette_rmse", "vignette_pixel_rmse")
        content["errors"] = {name: getattr(comparison, name) for name in names}
    return content
