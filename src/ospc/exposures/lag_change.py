"""Has the lag changed? The latest changes of brightness are compared with the lag that all before them showed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ospc.arrays import FloatArray, IntArray
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

_SUSPICIOUS_LEAD = 4.0
"""Log likelihood by which another lag must lead for more frames to be compared. One look in ten at unchanged film
finds as much; without the additional frames it took up to half a minute to prove a change."""

_EVENT_FRAMES = 48
"""Frames within which what happens is one event: a second at 50 frames/s. Light that fades for half a second, while
the exposure changes ever faster, looks like a lag. So the lead must be large enough without its best event: half of
that made three false changes in ten hours of simulated film."""


@dataclass(frozen=True)
class LagChange:
    """A change of the lag that is suspected, or ``proven``.

    ``frame`` is the first one after it, as nearly as it can be told. Exposures are written ``later_frames`` later
    than before, or earlier if that is negative.
    """

    frame: int
    later_frames: int
    proven: bool = False


def lag_change(changes: Sequence[BrightnessChange], log_exposure: FloatArray, known: int) -> LagChange | None:
    """Return the change of the lag that the latest changes of brightness show; None if they show none.

    A lag that fits all pairs since some frame better than the known one raises a suspicion. It is proven if that lag
    fits much better, and not during one event only, and if the lags that the pairs since then allow, as estimated on
    their own, are few and on the same side of the known one.

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
    lag, frame, lead = _best_rival(latest, exposures, known)
    suspected = LagChange(first + int(frame[0]), lag - known)
    if lead.sum() < _SUSPICIOUS_LEAD or sum(c.frame0 < suspected.frame for c in changes) < _FEWEST_BEFORE:
        return None
    if _beside_best_event(frame, lead) < MIN_LEAD:
        return suspected
    found = estimate_lag(latest.where(latest.frame >= frame[0]), exposures, reach)
    later = [lag - known for lag in found.candidates]
    usual = [lag for lag in later if abs(lag) <= USUAL_LAG]
    if found.state not in ("determined", "ambiguous") or not usual or len(later) > _MOST_CANDIDATES:
        return suspected
    late, early = (all(lag * sign > 0 for lag in usual) for sign in (1, -1))
    much_better = found.score[found.lags == known + usual[0]] - found.score[found.lags == known] > _EARLY_LEAD
    return replace(suspected, later_frames=usual[0], proven=late or (early and bool(much_better.item())))


def _best_rival(latest: BrightnessChanges, log_exposure: FloatArray, known: int) -> tuple[int, IntArray, FloatArray]:
    """Return the lag that fits better than the known one since some frame, and the pairs since then with its lead.

    Lags of usual size are tried; the pairs are given by their first frames.
    """
    held = fit_exposures(latest, latest.log_change(log_exposure, known)).log_likelihood
    rivals = [known + step for step in range(-USUAL_LAG, USUAL_LAG + 1) if step]
    leads = [fit_exposures(latest, latest.log_change(log_exposure, lag)).log_likelihood - held for lag in rivals]
    since = np.cumsum(np.array(leads)[:, ::-1], axis=1)[:, ::-1]
    best = int(np.argmax(since.max(axis=1)))
    begins = int(np.flatnonzero(since[best] > since[best].max() - _EARLIER_LEAD)[-1])
    return rivals[best], latest.frame[latest.driven[begins:]], leads[best][begins:]


def _beside_best_event(frame: IntArray, lead: FloatArray) -> float:
    """Return the lead without that within the best :data:`_EVENT_FRAMES` frames."""
    summed = np.concatenate([[0.0], np.cumsum(lead)])
    event = summed[np.searchsorted(frame, frame + _EVENT_FRAMES)] - summed[:-1]
    return float(summed[-1] - event.max())
