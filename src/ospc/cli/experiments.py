"""``ospc experiments``: the paper's figures and tables anew."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ospc.cli.progress import progress_bar

if TYPE_CHECKING:
    from ospc.experiments.measuring import Others
    from ospc.experiments.reports import Report
    from ospc.experiments.sources import Source

_SLOW = 0.5
"""Speed of stand-ins that features are matched on over 30 frames, as in the paper's recordings."""

_WIDTH = 400
"""Wide enough for every table: cells that were cut short would be lost."""


@click.group("experiments")
def command() -> None:
    """Make the paper's figures and tables anew, on given recordings or on simulated stand-ins.

    RECORDINGS are folders in the layout of the TUM monocular data set; their pcalib.txt and vignette.png are the
    truth. Without any, recordings are simulated: with the data set's narrow camera and real exposures where --data
    (or OSPC_DATA) names a folder that holds them, with an analytic camera otherwise.
    """


def _options(function: Callable[..., None]) -> Callable[..., None]:
    """Add what all experiments take."""
    for decorate in reversed(
        [
            click.argument("recordings", nargs=-1, type=click.Path(path_type=Path)),
            click.option("-o", "--out", type=click.Path(path_type=Path), default=Path("ospc-experiments")),
            click.option("--data", type=click.Path(path_type=Path), envvar="OSPC_DATA", help="Reference data."),
            click.option("--count", type=click.IntRange(1, 1000), help="Recordings simulated."),
            click.option("--frames", type=click.IntRange(2, 1_000_000), help="Frames used of each."),
            click.option("--size", default="320x240", show_default=True, help="Of simulated images."),
            click.option("--speed", type=float, help="Factor on the speed of the simulated motion."),
            click.option(
                "--calibration",
                "given",
                multiple=True,
                metavar="NAME=FILES",
                help="Calibration by another program, to be compared too; pcalib.txt,vignette.png or alike.",
            ),
            click.option(
                "--exposures",
                "estimated",
                multiple=True,
                metavar="NAME=FILE",
                help="Exposures by another program: the last number of each line, one line a frame.",
            ),
        ]
    ):
        function = decorate(function)
    return function


@command.command("parameters")
@_options
def parameters(**options: Any) -> None:
    """Response, vignette and exposure ratios against the truth (figure 3)."""
    _experiment("parameters", 1, 600, options)


@command.command("joint")
@_options
def joint(**options: Any) -> None:
    """Joint estimation with and without a point of the truth, and others, against ours (figure 4)."""
    _experiment("joint", 8, 400, options)


@command.command("solvers")
@_options
def solvers(**options: Any) -> None:
    """Solvers of the vignette: L2, L1, M-estimator, ours (section 5)."""
    _experiment("solvers", 4, 500, options, _SLOW)


@command.command("features")
@_options
def features(**options: Any) -> None:
    """Features behind the response: SIFT, SURF, ORB, ours (section 5); SURF needs the extra 'surf'."""
    _experiment("features", 4, 300, options, _SLOW)


@command.command("offsets")
@_options
def offsets(**options: Any) -> None:
    """Offset between the frames that the vignette is estimated from, 10 to 50 (section 5)."""
    _experiment("offsets", 4, 500, options, _SLOW)


@command.command("thresholds")
@_options
def thresholds(**options: Any) -> None:
    """Least exposure ratio of pairs that the response is estimated from (section 5)."""
    _experiment("thresholds", 4, 300, options, _SLOW)


@command.command("static")
@_options
def static(**options: Any) -> None:
    """Methods for a camera that stands still, on sweeps of the exposure; simulated unless recordings are given."""
    from ospc.experiments.design import Experiment
    from ospc.experiments.reports import make_experiment
    from ospc.experiments.sources import given
    from ospc.experiments.static import static_methods, sweeps

    places, frames = options["recordings"], options["frames"] or 60
    sources = (
        [given(place, options["frames"]) for place in places]
        if places
        else sweeps(options["count"] or 6, frames, _size(options["size"]))
    )
    experiment = Experiment(
        "static", "Responses from a camera that stands still", "response_rmse", lambda _s: static_methods(), {}
    )
    others = _others(options)
    _report(
        _with_progress(sources, lambda report: make_experiment(experiment, sources, options["out"], report, others))
    )


@command.command("ambiguity")
@_options
def ambiguity(**options: Any) -> None:
    """Show the exponential ambiguity: every exponent explains a recording until its exposures are known."""
    from ospc.experiments.reports import make_ambiguity

    sources = _sources(options, 1, 300)[:1]
    _report(_with_progress(sources, lambda report: make_ambiguity(sources[0], options["out"], report)))


def _experiment(name: str, count: int, frames: int, options: dict[str, Any], speed: float = 1.0) -> None:
    from ospc.experiments.design import EXPERIMENTS
    from ospc.experiments.reports import make_experiment

    sources, experiment = _sources(options, count, frames, speed), EXPERIMENTS[name]()
    others = _others(options)
    _report(
        _with_progress(sources, lambda report: make_experiment(experiment, sources, options["out"], report, others))
    )


def _sources(options: dict[str, Any], count: int, frames: int, speed: float = 1.0) -> list[Source]:
    from ospc.errors import SettingError
    from ospc.experiments.sources import given, stand_ins

    data = options["data"]
    if data is not None and not data.is_dir():
        raise SettingError(f"{data}: is not a folder; give the folder of reference data, or leave --data out")
    if options["recordings"]:
        return [given(place, options["frames"]) for place in options["recordings"]]
    size, speed = _size(options["size"]), options["speed"] or speed
    return stand_ins(options["count"] or count, options["frames"] or frames, size, data, speed=speed)


def _size(text: str) -> tuple[int, int]:
    from ospc.errors import SettingError

    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise SettingError(f"'{text}' is not WIDTHxHEIGHT in pixels, like 320x240")
    return int(width), int(height)


def _others(options: dict[str, Any]) -> Others:
    from dataclasses import replace

    from ospc.experiments.measuring import Others, read_exposures
    from ospc.formats.opening import open_photometry

    return Others(
        tuple(replace(open_photometry(files), name=name) for name, files in map(_named, options["given"])),
        {name: read_exposures(file) for name, file in map(_named, options["estimated"])},
    )


def _named(entry: str) -> tuple[str, str]:
    from ospc.errors import SettingError

    name, equals, files = entry.partition("=")
    if not (name and equals and files):
        raise SettingError(f"'{entry}' is not NAME=FILES, such as mine=pcalib.txt,vignette.png")
    return name, files


def _with_progress(sources: list[Source], make: Callable[[Callable[[str, int, int], None]], Report]) -> Report:
    total = sum(source.count for source in sources)
    with progress_bar("frames", total, visible=sys.stderr.isatty()) as progress:
        seen = 0

        def on_frame(_name: str, _done: int, _of: int) -> None:
            nonlocal seen
            seen += 1
            progress(seen, total)

        return make(on_frame)


def _report(report: Report) -> None:
    from rich.console import Console
    from rich.table import Table

    from ospc.experiments.measuring import FIGURES, TITLES, medians

    if report.rows:
        recordings = len({row.recording for row in report.rows})
        table = Table(title=f"medians over {recordings} recordings", title_justify="left")
        table.add_column("method", no_wrap=True)
        for figure in FIGURES:
            table.add_column(TITLES[figure], justify="right", no_wrap=True)
        columns = {figure: medians(report.rows, figure) for figure in FIGURES}
        for name in columns[FIGURES[0]]:
            values = [columns[figure][name] for figure in FIGURES]
            table.add_row(name, *(f"{v:.4f}" if v < float("inf") else "–" for v in values))
        Console(highlight=False, width=_WIDTH).print(table, soft_wrap=True)
    for row in report.rows:
        if row.failure:
            click.echo(f"{row.recording}, {row.method}: {row.failure}")
    for problem in report.problems:
        click.echo(problem, err=True)
    folder = report.files[0].parent
    click.echo(f"written to {folder}: " + ", ".join(path.name for path in report.files))
