"""Lasting jumps of brightness that the exposure does not explain: a gain that is missing in the metadata."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.robust import robust_scale

_SIGMAS = 10.0
"""Least size of a jump, in robust standard deviations of the unexplained changes. Their tails are heavy, from failed
registrations and moving objects, so that a few times the standard deviation is common."""

_SMALLEST_LOG = 0.04
"""Least size of a jump, in ln of the grey level: 4 per cent. Recordings without noise have scatter next to none, and
smaller jumps are not worth a note."""

_AROUND = 4
"""Frames before and after a jump in which it must not be taken back: a hand that passes by takes longer than one."""

_LASTING_SHARE = 0.6
"""Share of a jump that must remain for these frames: noise and drift of a few frames take away less than the rest."""

_MOST_SHARE = 0.1
"""Share of the pairs above which jumps are the rule, and none is reported: the exposures do not fit at all."""


@dataclass(frozen=True)
class Jump:
    """One lasting change of brightness from a frame to the next.

    Attributes
    ----------
    frame
        Index of the first frame after it.
    log_change
        Change of ln grey of the same things.
    """

    frame: int
    log_change: float


def find_jumps(frame: IntArray, unexplained: FloatArray) -> tuple[Jump, ...]:
    """Find changes far beyond the usual ones that last for some frames.

    Parameters
    ----------
    frame
        Index of the first frame of each pair of consecutive frames, increasing, shape (n,).
    unexplained
        Change of ln brightness of each pair that its exposures do not explain, shape (n,).

    Returns
    -------
    tuple of Jump
        Empty where jumps are so many that they are the rule: exposures that do not fit at all.
    """
    if len(unexplained) < 2 * _AROUND:
        return ()
    usual = robust_scale(unexplained - np.median(unexplained))
    large = np.flatnonzero(np.abs(unexplained) > max(_SIGMAS * usual, _SMALLEST_LOG))
    lasting = [int(at) for at in large if _lasts(frame, unexplained, int(at))]
    if len(lasting) > _MOST_SHARE * len(unexplained):
        return ()
    return tuple(Jump(int(frame[at]) + 1, float(unexplained[at])) for at in lasting)


def _lasts(frame: IntArray, unexplained: FloatArray, at: int) -> bool:
    """Return whether most of a change is still there a few frames later, and was not there a few frames before.

    A hand that passes by, or one exposure written wrongly, is taken back at once.
    """
    near = (np.abs(frame - frame[at]) <= _AROUND) & (frame != frame[at])
    before, after = (float(unexplained[near & side].sum()) for side in (frame < frame[at], frame > frame[at]))
    change = float(unexplained[at])
    return min((change + part) / change for part in (before, after)) > _LASTING_SHARE
