"""What commands do with the cameras of a rig when each has been calibrated."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ospc.cli.terminal import say
from ospc.errors import NotObservableError

if TYPE_CHECKING:
    from ospc.recording import Recording

RIG_NAME = "rig.json"
"""Name of the file with the relative scales in the folder of the cameras' folders."""

_LARGE_MISFIT = 4.0
"""Standard deviations by which overlaps contradict each other before the user is warned."""


def add_rig_scale(out: Path, cameras: Mapping[str, Callable[[], Recording]], *, talkative: bool) -> dict[str, Any]:
    """Find the relative irradiance scale of a rig's cameras, write it, and return it as JSON-compatible values.

    ``out`` holds the folder of each camera.
    """
    from ospc.photometry.calibration import Calibration
    from ospc.rig import rig_scale

    (out / RIG_NAME).unlink(missing_ok=True)  # one of an earlier run would be of other calibrations
    recordings, calibrations = {}, {}
    for name, opened in cameras.items():
        if (out / name / "calibration.json").exists():
            recordings[name], calibrations[name] = opened(), Calibration.load(out / name)
    try:
        found = rig_scale(recordings, calibrations)
    except NotObservableError as error:
        if talkative:
            say(f"no relative irradiance scale: {error}")
        return {"error": str(error)}
    found.save(out / RIG_NAME)
    if talkative:
        say(f"irradiance relative to {found.reference}, where views overlap:")
        for name, scale in found.scale.items():
            if name != found.reference:
                say(f"  {name}: {scale:.4f} ± {found.sigma[name]:.4f}")
        for name, why in found.left_out.items():
            say(f"  {name}: unknown, {why}")
        if found.misfit > _LARGE_MISFIT:
            say(f"warning: overlaps contradict each other by {found.misfit:.0f} standard deviations", err=True)
        say(f"written to {out / RIG_NAME}")
    return found.as_dict()
