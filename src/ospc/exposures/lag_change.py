"""Has the lag changed? The latest changes of brightness are compared with the lag that all before them showed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.exposures.brightness import BrightnessChange
from ospc.exposures.brightness_changes import BrightnessChanges
from ospc.exposures.lag import MIN_PAIRS
from ospc.exposures.lag_decision import MIN_LEAD, USUAL_LAG
from ospc.exposures.lag_likelihood import fit_exposures
from ospc.exposures.table import filled

_WATCHED_FRAMES = 400
"""Latest frames in which a change is looked for: twenty seconds at 20 frames/s, in which a few bursts of frames are
compared even late in a run."""

_FEWEST_BEFORE = 100
"""Pairs of frames before a change: fewer can all be of one passing cloud, which an exposure control follows, so that
the lag was not known as well as it seemed."""

_EARLIER_LEAD = 1.0
"""Log likelihood that may be given away for a later beginning: pairs that tell nothing do not count as changed."""

_SUSPICIOUS_LEAD = 4.0
"""Log likelihood by which another lag must lead for more frames to be compared. One look in ten at unchanged film
finds as much; without the additional frames it took up to half a minute to prove a change."""

_LATE_LEAD, _EARLY_LEAD = 25.0, 50.0
"""The same for a proof that exposures come later or earlier than before. Light that a smooth exposure control follows
looks like earlier ones. In ten hours of unchanged film, the largest false leads were 21 and 32."""

_FASTEST_LIGHT_FRAMES = 48
"""Shortest period of light that is told from exposures: a second at 50 frames/s. While light drifts, an exposure that
changes its pace seems to be late or early; unless this is allowed for, leads of 60 are false."""

_LATER = np.arange(-USUAL_LAG, USUAL_LAG + 1)
"""By how many frames later than before exposures may be written."""


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

    A lag that fits all pairs since some frame better than the known one raises a suspicion. It is proven if all pairs
    together, with any slow change of light, are much more likely with another lag since then than with the known one
    throughout, and if all lags that are nearly as likely are on its side.

    ``log_exposure`` is ln of the exposure written beside every frame, NaN where there is none, shape (frames,), and
    ``known`` the lag that was certain before, in frames.
    """
    first = max(0, len(log_exposure) - _WATCHED_FRAMES)
    watched = BrightnessChanges.of([c for c in changes if c.frame0 >= first])
    latest = replace(watched, frame=watched.frame - first).within(len(log_exposure) - first, *(known + _LATER))
    if len(latest.driven) < MIN_PAIRS:
        return None
    exposures = filled(log_exposure[first:])
    change = np.stack([latest.log_change(exposures, lag) for lag in (known + _LATER).tolist()])
    best, begins, lead = _beginning(_leads(latest, change), latest.frame[latest.driven])
    suspected = LagChange(first + begins, int(_LATER[best]))
    if lead < _SUSPICIOUS_LEAD or sum(c.frame0 < suspected.frame for c in changes) < _FEWEST_BEFORE:
        return None
    since = np.where(latest.frame < begins, change[USUAL_LAG], change)
    leads = _leads(latest, since, _slow_light(latest.frame)).sum(axis=1)
    likely = _LATER[leads > leads.max() - MIN_LEAD]
    late, early = leads.max() > _LATE_LEAD and likely.min() > 0, leads.max() > _EARLY_LEAD and likely.max() < 0
    return LagChange(suspected.frame, int(_LATER[leads.argmax()]), proven=True) if late or early else suspected


def _leads(latest: BrightnessChanges, change: FloatArray, light: FloatArray | None = None) -> FloatArray:
    """Return by how much each row of changes of exposure makes driven pairs likelier than the known lag's does.

    Shape (lags, pairs).
    """
    log_likelihood = np.array([fit_exposures(latest, row, light).log_likelihood for row in change])
    return np.asarray(log_likelihood - log_likelihood[USUAL_LAG])


def _beginning(leads: FloatArray, frame: IntArray) -> tuple[int, int, float]:
    """Return the lag that leads most since some pair, the first frame of that pair, and the lead."""
    since = np.cumsum(leads[:, ::-1], axis=1)[:, ::-1]
    best = int(np.argmax(since.max(axis=1)))
    begins = int(np.flatnonzero(since[best] > since[best].max() - _EARLIER_LEAD)[-1])
    return best, int(frame[begins]), float(since[best, begins])


def _slow_light(frame: IntArray) -> FloatArray:
    """Return cosines of which any change of brightness that is slow enough is a sum, shape (pairs, cosines)."""
    frames = frame[-1] + 1 - frame[0]
    halves = np.arange(2 * frames // _FASTEST_LIGHT_FRAMES + 1)
    return np.asarray(np.cos(np.pi * np.outer(frame - frame[0] + 0.5, halves) / frames))
