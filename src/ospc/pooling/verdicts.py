"""The verdicts on a calibration that several recordings give together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ospc.arrays import ImageSize
from ospc.errors import counted, listed
from ospc.estimation.fit import Fit
from ospc.methods.identifiability import response_verdict_of_fit, vignette_verdict
from ospc.photometry.verdict import Verdict
from ospc.pooling.agreement import Agreement, Part
from ospc.pooling.summary import Summary, joint_range

_NEEDED: dict[Part, tuple[Part, ...]] = {"response": ("response",), "vignette": ("response", "vignette")}
"""Parts on which recordings must agree to determine each part: a recording of another response is left out."""


def response_verdict_of(fit: Fit, used: Sequence[Summary]) -> Verdict:
    """Return the verdict on the response from the recordings that agree on it."""
    if not used:
        return Verdict("not identifiable", "")
    range_ms = joint_range(s.exposure_range_ms for s in used)
    return response_verdict_of_fit(fit, range_ms, float(np.median([s.unexplained for s in used])))


def vignette_verdict_of(fit: Fit, used: Sequence[Summary], size: ImageSize) -> Verdict:
    """Return the verdict on the vignette from the recordings that agree on it."""
    stationary = bool(used) and all(s.stationary for s in used)
    unexplained = float(np.median([s.unexplained for s in used])) if used else 0.0
    radial_motion = max((s.radial_motion for s in used), default=0.0)
    return vignette_verdict(fit, radial_motion, stationary, unexplained, size=size)


def judged(agreed: Agreement, part: Part, verdict: Verdict, *, recordings: int, counts: bool) -> Verdict:
    """Return the verdict, taking into account how many recordings agree; with ``counts``, it says how many."""
    for needed in _NEEDED[part]:
        if not agreed.majority[needed]:
            differing = _differing(agreed, needed)
            return Verdict(
                "not identifiable",
                f"{len(differing)} of {recordings} recordings contradict the others in the {needed} "
                f"({listed(differing)}), and no majority agrees",
                "merge only recordings of one camera with unchanged lens, focus and aperture",
            )
    if not counts:
        return verdict
    left_out = _differing(agreed, *_NEEDED[part])
    reason = f"{verdict.reason}, based on {recordings - len(left_out)} of {counted(recordings, 'recording')}"
    if left_out:
        reason += f"; {listed(left_out)} left out" + (" because it differs" if len(left_out) == 1 else "")
    return replace(verdict, reason=reason)


def _differing(agreed: Agreement, *parts: Part) -> list[str]:
    """Return the names of the recordings that differ in any of these parts."""
    return sorted(found.name for found in agreed.differing.values() if set(parts) & set(found.parts))


def used_of(used: int, given: int) -> str:
    """Return how many of the given recordings are used, in words."""
    return counted(given, "recording") if used == given else f"{used} of {counted(given, 'recording')}"
