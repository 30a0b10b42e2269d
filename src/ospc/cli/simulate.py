"""``ospc simulate``: simulate a recording with known truth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ospc.cli.options import PATH, SIZE, force_option, reserving_out
from ospc.cli.progress import progress_of
from ospc.cli.terminal import say
from ospc.errors import SettingError

if TYPE_CHECKING:
    from ospc.simulation import SimulationSettings


def _numbers(_context: click.Context, _parameter: click.Parameter, value: str | None) -> tuple[float, ...] | None:
    if value is None:
        return None
    try:
        return tuple(float(part) for part in value.replace(",", " ").split())
    except ValueError:
        raise click.BadParameter(f"'{value}' is not a list of numbers") from None


@click.command()
@click.argument("out", type=PATH)
@click.option("--frames", default=500, help="Number of images.")
@click.option("--size", default="640x480", type=SIZE, help="Width x height in pixels.")
@click.option("--fps", default=20.0, help="Images per second.")
@click.option("--seed", default=0, help="Seed of scene, motion and noise.")
@click.option(
    "--response", default="gamma2.2", help="linear, srgb, gamma2.2, log, filmic, tum_narrow, or a pcalib.txt."
)
@click.option("--vignette", default="polynomial", help="none, polynomial, cos4, decentred, or a vignette.png.")
@click.option(
    "--vignette-coefficients",
    metavar="V1,V2,V3",
    callback=_numbers,
    help="1 + V1 R² + V2 R⁴ + V3 R⁶, R = 1 at the corner.",
)
@click.option("--noise", type=click.Choice(["none", "low", "high"]), default="low")
@click.option(
    "--exposure",
    type=click.Choice(["auto", "sweep", "cycle", "file", "constant"]),
    default="auto",
    help="How the exposures are set.",
)
@click.option("--exposure-range", nargs=2, type=float, metavar="MIN MAX", help="Limits of auto and sweep, in ms.")
@click.option("--exposures", metavar="MS,MS,…", callback=_numbers, help="Exposures in ms of cycle; one for constant.")
@click.option(
    "--exposure-file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="For file: exposures in ms, the last column of a text file such as times.txt.",
)
@click.option("--motion", type=click.Choice(["handheld", "static", "pan", "forward"]), default="handheld")
@click.option("--speed", default=1.0, help="Factor on the speed of the motion.")
@click.option("--lag", default=0, help="Number of frames by which the metadata are late.")
@click.option("--metadata-error", default=0.0, help="Relative standard deviation of errors in the metadata.")
@click.option("--flicker", default=0.0, help="Relative amplitude of flicker of the light.")
@click.option("--moving-objects", default=0, help="Number of patches that move in front of the scene.")
@click.option("--motion-blur", "motion_blur_samples", default=1, help="Instants averaged per frame.")
@click.option("--bit-depth", default=8, help="Bits per grey value, 8 to 16.")
@click.option("--jpg", is_flag=True, help="Store JPEG instead of PNG.")
@click.option("--archive", is_flag=True, help="Store images.zip instead of the folder images.")
@force_option("Replace an earlier simulated recording at OUT.")
@reserving_out
def command(out: Path, force: bool, **options: Any) -> None:
    """Simulate a recording with known truth in the folder OUT.

    The folder contains images, times.txt and camera.txt like a real recording, and the truth in pcalib.txt,
    vignette.png, groundtruthSync.txt and truth.json.
    """
    from ospc.simulation import simulate

    settings = _settings(options)
    with progress_of("simulating") as step:
        made = simulate(out, settings, overwrite=force, progress=step)
    exposures = made.exposures_ms
    say(
        f"{out}: {settings.frames} frames {settings.size[0]}×{settings.size[1]}, exposures {exposures.min():.3g} to "
        f"{exposures.max():.3g} ms; truth in {out / 'truth.json'}, pcalib.txt and vignette.png"
    )


def _settings(options: dict[str, Any]) -> SimulationSettings:
    """Return the settings of the simulation from the options of the command."""
    from ospc.recording.text_file import exposures_in
    from ospc.simulation import SimulationSettings

    limits, listed, source = (options.pop(name) for name in ("exposure_range", "exposures", "exposure_file"))
    coefficients = options.pop("vignette_coefficients")
    options["image_format"] = "jpg" if options.pop("jpg") else "png"
    if limits:
        options["exposure_min_ms"], options["exposure_max_ms"] = limits
    if listed:
        if options["exposure"] not in ("cycle", "constant"):
            raise SettingError("--exposures goes with --exposure cycle or constant; add one of them")
        if options["exposure"] == "constant" and len(listed) > 1:
            raise SettingError(
                f"--exposure constant takes one of --exposures, not {len(listed)}; give one, or use cycle"
            )
        options["exposures_ms"], options["exposure_ms"] = listed, listed[0]
    if options["exposure"] == "file":
        if source is None:
            raise SettingError("--exposure file needs --exposure-file with one exposure for each frame")
        options["exposures_ms"] = tuple(exposures_in(source)[: options["frames"]])
    if coefficients:
        options["vignette_coefficients"] = coefficients
    return SimulationSettings(**options)
