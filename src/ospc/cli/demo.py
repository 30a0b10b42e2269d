"""``ospc demo``: simulate a short recording, calibrate it, and compare with the truth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ospc.cli.interruption import leaving
from ospc.cli.options import QUIET, declared, option, out_option
from ospc.cli.terminal import progress_of, say

if TYPE_CHECKING:
    from ospc.simulation.settings import SimulationSettings

_PERIOD_FRAMES = 50
"""Period of the exposure in frames: slow enough that neighbouring frames overlap in exposure."""
_MEAN_EXPOSURE_MS, _EXPOSURE_FACTOR = 9.0, 2.8
"""The exposure varies between mean / factor and mean × factor, a range of about eight to one."""


@declared("demo")
def command(
    *,
    out: Path = out_option(
        "Folder for the recording and its calibration; those of an earlier demo are replaced.",
        default=Path("ospc-demo"),
    ),
    frames: int = option("Number of frames.", type=click.IntRange(1, 10_000), default=200),
    seed: int = option("Seed of scene, motion and noise.", type=click.IntRange(0), default=0),
    quiet: bool = QUIET,
) -> int:
    """Simulate a short recording, calibrate it, and compare with the truth.

    The simulated camera is hand-held, with a film-like response and a vignette, and its exposure varies by a factor
    of eight. OUT gets the recording with its truth, and the calibration as written by 'ospc calibrate', with
    pictures that compare the estimate with the truth. The exit codes are those of 'ospc calibrate'.
    """
    from ospc.cli.calibrate import command as calibrate
    from ospc.report.output_folder import OutputFolder
    from ospc.simulation import simulate

    recording, result, settings = out / "recording", out / "calibration", _settings(frames, seed)
    OutputFolder.at(result)  # refused before the simulation
    if not quiet:
        say(f"simulating {settings.frames} frames of {settings.size[0]}×{settings.size[1]} pixels in {recording}")
    with leaving("no result was written"), progress_of("simulating", quiet=quiet) as step:
        simulate(recording, settings, overwrite=True, progress=step)
    if not quiet:
        say(f"running: ospc calibrate {recording} -o {result} --truth {recording}")
    here = click.get_current_context()
    code: int = here.invoke(calibrate, path=recording, out=result, truth=str(recording), quiet=quiet)
    picture = result / "figure.png"
    if not quiet and picture.exists():
        say()
        say(f"estimate compared with the truth: {picture}")
    return code


def _settings(frames: int, seed: int) -> SimulationSettings:
    """Return settings that determine response and vignette: strong exposure changes and radial motion."""
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
