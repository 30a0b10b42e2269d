"""Figures and settings of a report as rows of text, for every kind of report."""

from __future__ import annotations

import json
from typing import Any

from ospc.evaluation.tracking import TrackingComparison
from ospc.photometry.calibration import Calibration

_LONGEST_LIST = 24
"""Entries of a list that are shown."""


def name_of(calibration: Calibration) -> str:
    """Return the name of the recording."""
    return str(calibration.source.get("name") or "a camera")


def basis_of(calibration: Calibration) -> str:
    """Return what the calibration was made from, on one line."""
    counts = calibration.counts
    parts = [f"{calibration.size[0]}×{calibration.size[1]} pixels", f"grey levels up to {calibration.max_grey}"]
    parts += [f"{counts[name]} {name}" for name in ("frames", "pairs", "samples") if name in counts]
    if counts.get("skipped"):
        parts.append(f"{counts['skipped']} frames skipped")
    if calibration.partial:
        parts.append("partial")
    return " · ".join(parts)


def tracking_rows(tracking: TrackingComparison) -> list[tuple[str, str, str, str]]:
    """Return label, figure as recorded, figure corrected, and unit of each row."""
    both = (tracking.raw, tracking.corrected)
    life = [f"{figures.mean_life:.1f}" for figures in both]
    lost = [f"{100 * sum(figures.lost.values()) / max(figures.steps, 1):.2f} %" for figures in both]
    residual = [f"{figures.residual:.3f}" for figures in both]
    return [
        ("mean life of a track", life[0], life[1], f"frames, of at most {tracking.horizon}"),
        ("tracks lost", lost[0], lost[1], "of the steps from frame to frame"),
        ("brightness residual", residual[0], residual[1], "of the local contrast, median"),
    ]


def settings_of(calibration: Calibration) -> dict[str, dict[str, Any]]:
    """Return everything that led to the calibration, by heading."""
    noise = {} if calibration.noise is None else vars(calibration.noise)
    return {
        "Settings": calibration.settings,
        "Recording": calibration.source,
        "Noise of a grey level": noise,
        "Versions": dict(calibration.versions),
    }


def shown(value: object) -> str:
    """Return the value of a setting as short text."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        text = ", ".join(shown(item) for item in value[:_LONGEST_LIST])
        return f"{text}, … ({len(value)} in all)" if len(value) > _LONGEST_LIST else text
    return value if isinstance(value, str) else json.dumps(value, default=str)


def sentence(text: str) -> str:
    """Return a text as a sentence, with a capital letter and a full stop."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}." if text else ""
