"""The relative irradiance scale of a rig's cameras, written beside their calibrations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ospc.cli.terminal import say
from ospc.errors import NotObservableError
from ospc.recording import Recording

RIG_NAME = "rig.json"
"""Name of the file with the relative scales of a rig's cameras."""
_LARGE_MISFIT = 4.0
"""Contradiction between overlaps, in standard deviations, above which the user is warned."""


def add_rig_scale(out: Path, cameras: Mapping[str, Callable[[], Recording]], *, prints_text: bool) -> dict[str, Any]:
    """Estimate the relative irradiance scale of a rig's cameras, write it, and return it as JSON-compatible values.

    ``out`` contains the folder of each camera.
    """
    from ospc.photometry.calibration import Calibration
    from ospc.pooling.rig import rig_scale

    recordings, calibrations = {}, {}
    for name, opened in cameras.items():
        if (out / name / "calibration.json").is_file():
            recordings[name], calibrations[name] = opened(), Calibration.load(out / name)
    try:
        found = rig_scale(recordings, calibrations)
    except NotObservableError as error:
        if prints_text:
            say(f"no relative irradiance scale: {error}")
        return {"error": str(error)}
    found.save(out / RIG_NAME)
    if prints_text:
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
