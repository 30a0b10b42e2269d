"""Has the lag changed? The latest changes of brightness are compared with the lag that all before them showed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ospc.arrays import FloatArray
from ospc.exposures.brightness import BrightnessChange
from ospc.exposures.brightness_changes import BrightnessChanges
from ospc.exposures.lag import MAX_LAG, MIN_PAIRS, estimate_lag
from ospc.exposures.lag_decision import MIN_LEAD, USUAL_LAG
from ospc.exposures.lag_likelihood import fit_exposures
from ospc.exposures.table import filled

_WATCHED_FRAMES = 400
"""Latest frames in which a change is looked for: twenty seconds at 20 frames/s, in which a few bursts of frames are
compared even late in a run."""

_FEWEST_BEFORE = 100
"""Pairs of frames before a change: fewer can all be of one passing cloud, which an exposure control follows, so that
the lag was not known as well as it seemed."""

_MOST_CANDIDATES = 3
"""Most lags that may be left open. Where more fit, something else changes the brightness: a passing cloud left five
and more in simulated film."""

_EARLY_LEAD = 60.0
"""Log likelihood by which exposures that come earlier must lead: light that a smooth exposure control follows looks
like them, by up to 30 in simulated film, but hardly like exposures that come later."""

_EARLIER_LEAD = 1.0
"""Log likelihood that may be given away for a later beginning: pairs that tell nothing do not count as changed."""


@dataclass(frozen=True)
class LagChange:
    """A change of the lag.

    ``frame`` is the first one after it, as nearly as it can be told. Exposures are written ``later_frames`` later
    than before, or earlier if that is negative.
    """

    frame: int
    later_frames: int


def lag_change(changes: Sequence[BrightnessChange], log_exposure: FloatArray, known: int) -> LagChange | None:
    """Return the change of the lag that the latest changes of brightness show; None if they show none.

    A lag that fits all pairs since some frame much better than the known one raises a suspicion. It is shown if the
    lags that the pairs since then allow, as estimated on their own, are few, and on the same side of the known one.

    ``log_exposure`` is ln of the exposure written beside every frame, NaN where there is none, shape (frames,), and
    ``known`` the lag that was certain before, in frames.
    """
    first = max(0, len(log_exposure) - _WATCHED_FRAMES)
    exposures = filled(log_exposure[first:])
    reach = MAX_LAG + abs(known)
    watched = BrightnessChanges.of([c for c in changes if c.frame0 >= first])
    latest = replace(watched, frame=watched.frame - first).within(len(exposures), -reach, reach)
    if len(latest.driven) < MIN_PAIRS:
        return None
    since = _suspicion(latest, exposures, known)
    if since is None or sum(change.frame0 < first + since for change in changes) < _FEWEST_BEFORE:
        return None
    found = estimate_lag(latest.where(latest.frame >= since), exposures, reach)
    later = [lag - known for lag in found.candidates]
    usual = [lag for lag in later if abs(lag) <= USUAL_LAG]
    if found.state not in ("determined", "ambiguous") or not usual or len(later) > _MOST_CANDIDATES:
        return None
    late, early = (all(lag * sign > 0 for lag in usual) for sign in (1, -1))
    lead = found.score[found.lags == known + usual[0]] - found.score[found.lags == known]
    return LagChange(first + since, usual[0]) if late or (early and lead.item() > _EARLY_LEAD) else None


def _suspicion(latest: BrightnessChanges, log_exposure: FloatArray, known: int) -> int | None:
    """Return the frame since which another lag fits much better than the known one; None without such a lag."""
    held = fit_exposures(latest, latest.log_change(log_exposure, known)).log_likelihood
    leads = []
    for lag in (known + step for step in range(-USUAL_LAG, USUAL_LAG + 1) if step):
        fitted = fit_exposures(latest, latest.log_change(log_exposure, lag)).log_likelihood
        leads.append(np.cumsum((fitted - held)[::-1])[::-1])
    lead = max(leads, key=np.max)
    if lead.max() < MIN_LEAD:
        return None
    begins = int(np.flatnonzero(lead > lead.max() - _EARLIER_LEAD)[-1])
    return int(latest.frame[latest.driven[begins]])
