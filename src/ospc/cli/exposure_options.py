"""The option that says what to do about a lag of the exposures, and what is printed about them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from ospc.exposures.findings import LagChoice
    from ospc.photometry.calibration import Calibration

_LARGEST = 1000


class _LagType(click.ParamType[Any]):
    name = "lag"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> LagChoice:
        """Return ``"auto"``, ``"never"``, or a number of frames."""
        if isinstance(value, int):
            return value
        text = str(value).strip().lower()
        if text == "auto":
            return "auto"
        if text == "never":
            return "never"
        try:
            frames = int(text)
        except ValueError:
            frames = _LARGEST + 1
        if abs(frames) > _LARGEST:
            self.fail(f"{value!r} is neither auto nor never nor a number of frames such as 2 or -1", param, ctx)
        return frames


correct_lag_option = click.option(
    "--correct-lag",
    metavar="auto|never|N",
    type=_LagType(),
    default="auto",
    show_default=True,
    help="What to do where exposures are written beside other frames than theirs: correct that if the images show by "
    "how many frames (auto), never, or correct it by N frames; positive if exposures come late.",
)


def say_exposures(calibration: Calibration) -> None:
    """Print loudly on standard error what speaks against the exposures."""
    for warning in calibration.warnings:
        click.echo(f"{click.style('WARNING', fg='red', bold=True)}: {warning}", err=True)
    if calibration.warnings:
        remedy = calibration.verdicts["exposures"].remedy
        click.echo(f"  response and vignette are marginal at best; {remedy}", err=True)
