"""The check of exposures before a calibration, as commands show it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from ospc.diagnosis.before_calibrating import Examined, LagChoice
    from ospc.photometry.calibration import Calibration
    from ospc.recording import Recording

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


def examined(recording: Recording, correct_lag: LagChoice) -> Examined:
    """Return the recording to calibrate, and what to say about its exposures.

    Raises
    ------
    SettingError
        If so large a lag leaves no frames.
    """
    from ospc.diagnosis.before_calibrating import Examined, examine
    from ospc.errors import SettingError, said_by

    try:
        return examine(recording, correct_lag)
    except SettingError:
        raise
    except Exception as error:  # whatever it is: calibrating may still go well, and says what is wrong if not
        return Examined(recording, None, 0, (f"exposures were not checked: {said_by(error)}",))


def say_examined(found: Examined, *, notes: bool) -> None:
    """Print on standard error what was found, and loudly what speaks against the exposures."""
    for note in found.notes if notes else ():
        click.echo(f"note: {note}", err=True)
    for warning in found.warnings:
        click.echo(f"{click.style('WARNING', fg='red', bold=True)}: {warning}", err=True)
    if found.warnings:
        click.echo(f"  response and vignette are marginal at best; {found.remedy}", err=True)


def judged(calibration: Calibration, found: Examined) -> Calibration:
    """Return a calibration with verdicts as the exposures allow, and the lag it was corrected by."""
    from dataclasses import replace

    if found.warnings:
        verdicts = found.judged(calibration.verdicts)
        advice = tuple(dict.fromkeys(filter(None, (found.remedy, *calibration.advice))))
        calibration = replace(calibration, verdicts=verdicts, converged=False, advice=advice)
    if found.corrected_frames:
        source = {**calibration.source, "exposure_lag_corrected_frames": found.corrected_frames}
        calibration = replace(calibration, source=source)
    return calibration


def as_json(found: Examined) -> dict[str, Any]:
    """Return what was found as JSON-compatible values."""
    return {
        "exposure_lag_frames": found.lag_frames,
        "exposure_lag_corrected_frames": found.corrected_frames,
        "warnings": list(found.warnings),
    }
