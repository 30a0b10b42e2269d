"""Has the lag changed? The latest changes of brightness are compared with the lag that all before them showed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.exposures.brightness import BrightnessChange
from ospc.exposures.brightness_changes import BrightnessChanges
from ospc.exposures.lag_likelihood import fit_exposures
from ospc.exposures.table import filled
from ospc.settings.exposures import (
    EARLIER_LAG_LEAD,
    LAG_CHANGE_START_TOLERANCE,
    LAG_CHANGE_WINDOW_FRAMES,
    LATER_LAG_LEAD,
    MAX_COMMON_LAG,
    MIN_LAG_PAIRS,
    MIN_LEAD,
    MIN_LIGHT_PERIOD_FRAMES,
    MIN_PAIRS_BEFORE_LAG_CHANGE,
    SUSPECTED_LAG_CHANGE_LEAD,
)

_LATER = np.arange(-MAX_COMMON_LAG, MAX_COMMON_LAG + 1)
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
    first = max(0, len(log_exposure) - LAG_CHANGE_WINDOW_FRAMES)
    watched = BrightnessChanges.of([c for c in changes if c.frame0 >= first])
    latest = replace(watched, frame=watched.frame - first).within(len(log_exposure) - first, *(known + _LATER))
    if len(latest.driven) < MIN_LAG_PAIRS:
        return None
    exposures = filled(log_exposure[first:])
    change = np.stack([latest.log_change(exposures, lag) for lag in (known + _LATER).tolist()])
    best, begins, lead = _beginning(_leads(latest, change), latest.frame[latest.driven])
    suspected = LagChange(first + begins, int(_LATER[best]))
    if (
        lead < SUSPECTED_LAG_CHANGE_LEAD
        or sum(c.frame0 < suspected.frame for c in changes) < MIN_PAIRS_BEFORE_LAG_CHANGE
    ):
        return None
    since = np.where(latest.frame < begins, change[MAX_COMMON_LAG], change)
    leads = _leads(latest, since, _slow_light(latest.frame)).sum(axis=1)
    likely = _LATER[leads > leads.max() - MIN_LEAD]
    late, early = (
        leads.max() > LATER_LAG_LEAD and likely.min() > 0,
        leads.max() > EARLIER_LAG_LEAD and likely.max() < 0,
    )
    return LagChange(suspected.frame, int(_LATER[leads.argmax()]), proven=True) if late or early else suspected


def _leads(latest: BrightnessChanges, change: FloatArray, light: FloatArray | None = None) -> FloatArray:
    """Return by how much each row of changes of exposure makes driven pairs likelier than the known lag's does.

    Shape (lags, pairs).
    """
    log_likelihood = np.array([fit.log_likelihood for fit in fit_exposures(latest, change, light)])
    return np.asarray(log_likelihood - log_likelihood[MAX_COMMON_LAG])


def _beginning(leads: FloatArray, frame: IntArray) -> tuple[int, int, float]:
    """Return the lag that leads most since some pair, the first frame of that pair, and the lead."""
    since = np.cumsum(leads[:, ::-1], axis=1)[:, ::-1]
    best = int(np.argmax(since.max(axis=1)))
    begins = int(np.flatnonzero(since[best] > since[best].max() - LAG_CHANGE_START_TOLERANCE)[-1])
    return best, int(frame[begins]), float(since[best, begins])


def _slow_light(frame: IntArray) -> FloatArray:
    """Return cosines of which any change of brightness that is slow enough is a sum, shape (pairs, cosines)."""
    frames = frame[-1] + 1 - frame[0]
    halves = np.arange(2 * frames // MIN_LIGHT_PERIOD_FRAMES + 1)
    return np.asarray(np.cos(np.pi * np.outer(frame - frame[0] + 0.5, halves) / frames))
