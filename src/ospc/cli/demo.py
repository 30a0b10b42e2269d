"""``ospc demo``: simulate a short recording, calibrate it, and compare with the truth."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ospc.cli.calibrate import one_line
from ospc.cli.interruption import Interruption

if TYPE_CHECKING:
    from ospc.simulation.settings import SimulationSettings

_FRAMES = 200
_PERIOD_FRAMES = 50
"""Frames in which the exposure swings up and down once: slow enough that neighbours overlap."""

_MEAN_EXPOSURE_MS, _EXPOSURE_FACTOR = 9.0, 2.8
"""The exposure swings between the mean times and divided by the factor, a range of about eight to one."""


@click.command("demo")
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path),
    default=Path("ospc-demo"),
    show_default=True,
    help="Folder for the recording and its calibration; those of an earlier demo are replaced.",
)
@click.option(
    "--frames", type=click.IntRange(1, 10_000), default=_FRAMES, show_default=True, help="Number of frames."
)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Seeds scene, motion and noise.")
@click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
def command(*, out: Path, frames: int, seed: int, quiet: bool) -> None:
    """Simulate a short recording, calibrate it, and compare with the truth.

    The camera is hand-held, has a film-like response, and darkens towards the corners; its exposure swings by a
    factor of eight. OUT gets the recording with its truth, and the calibration as 'ospc calibrate' writes it, with
    pictures that compare the estimate with the truth. The exit codes are those of 'ospc calibrate'.
    """
    with Interruption() as interruption:
        sys.exit(one_line(lambda: _demonstrate(out, _settings(frames, seed), interruption, quiet=quiet)))


def _settings(frames: int, seed: int) -> SimulationSettings:
    """Return a simulation that determines everything: the exposure changes strongly, and things cross the image."""
    import numpy as np

    from ospc.simulation import SimulationSettings

    swing = np.sin(2 * np.pi * np.arange(frames) / _PERIOD_FRAMES)
    exposures_ms = _MEAN_EXPOSURE_MS * _EXPOSURE_FACTOR**swing
    return SimulationSettings(
        frames=frames,
        seed=seed,
        response="filmic",
        vignette="polynomial",
        exposure="file",
        exposures_ms=tuple(exposures_ms.tolist()),
    )


def _demonstrate(out: Path, settings: SimulationSettings, interruption: Interruption, *, quiet: bool) -> int:
    from ospc.cli.calibration_run import Options, calibrate_into
    from ospc.formats.opening import open_photometry
    from ospc.output import OutputFolder
    from ospc.recording import open_recording
    from ospc.settings import preset

    recording, result = out / "recording", out / "calibration"
    folder = OutputFolder.at(result)
    if not quiet:
        click.echo(f"simulating {settings.frames} frames {settings.size[0]}×{settings.size[1]} in {recording}")
    _simulate(recording, settings, visible=not quiet and sys.stderr.isatty())
    if not quiet:
        click.echo(f"calibrating, as would: ospc calibrate {recording} -o {result} --truth {recording}")
    options = Options(quiet=quiet, truth=open_photometry(recording))
    code = calibrate_into(folder, open_recording(recording), preset("default"), interruption, options)
    picture = result / "figure.png"
    if not quiet and picture.exists():
        click.echo(f"\nestimate compared with the truth: {picture}")
    return code


def _simulate(place: Path, settings: SimulationSettings, *, visible: bool) -> None:
    from rich.console import Console
    from rich.progress import Progress

    from ospc.simulation import simulate

    with Progress(console=Console(stderr=True), transient=True, disable=not visible) as bar:
        task = bar.add_task("simulating", total=settings.frames)
        simulate(place, settings, overwrite=True, progress=lambda done, _total: bar.update(task, completed=done))
