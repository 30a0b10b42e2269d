"""The course of the exposures, and how much of the changes of brightness it explains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.exposures.flicker import Flicker, find_flicker, without_waves
from ospc.exposures.jumps import Jump, find_jumps
from ospc.exposures.lag_decision import exposure_cycle
from ospc.exposures.lag_estimate import LagEstimate
from ospc.exposures.table import blocks

NOTABLE_RMS_LOG = 0.006
"""Root mean square change of ln brightness from frame to frame, unexplained by exposures, up to which nothing is
doubted: registration alone leaves as much."""

DRIFT_FRAMES = 40
"""Frames over which unexplained changes are added up: an exposure control acts within them, and the errors of
registration do not yet add up to much."""

_DRIFT_STEP = DRIFT_FRAMES // 4
"""Frames between the beginnings of these stretches, which overlap so that no swing is cut in two."""

_CHANGED = 0.01
"""Change of ln exposure from which a frame counts as exposed differently from the one before: 1 per cent."""

_UNCHANGED = 1e-4
"""Change of ln exposure up to which it counts as none: above the rounding of numbers in files, below any step that a
camera makes."""

_STALE_DRIFT_LOG = 0.12
"""Drift of ln brightness from which an exposure that never changes counts as stale, however small each step is: an
exposure control changes it by more within :data:`DRIFT_FRAMES`, errors of registration by less."""

_MIN_UNCHANGED_PAIRS = 12
"""Fewest pairs of unchanged exposure that can show it to be stale: their root mean square is known to a fifth."""

_REPORTED_SHARE = 0.6
"""Share of the fast unexplained changes that a flicker makes up if it is reported. It is more than
:func:`find_flicker` asks for: a line may be tried beside a lag on less evidence than a user should be sent to the
lamp for."""

_LEAST_TOTAL_SHARE = 0.4
"""Share of the variance of all unexplained changes that the reported flicker makes up. A control loop's slow swings
have a strongest frequency, too, but it makes up less of them."""

_SAME_TURNS = 0.1
"""Turns by which a flicker may miss a whole number within a cycle of exposures and still be a harmonic of the
cycle."""

_KEPT_SHARE = 0.98
"""Share of the changes, the smaller ones, that a root mean square is taken of: a scene cut is no change of light."""


@dataclass(frozen=True)
class ExposureReport:
    """The course of the exposures written, over all frames.

    Attributes
    ----------
    lowest_ms, highest_ms
        Extremes.
    values
        Number of different exposures.
    changed_share
        Share of the frames whose exposure differs from that of the frame before by 1 % or more.
    cycle_frames
        Number of frames after which they repeat; None if they do not.
    """

    lowest_ms: float
    highest_ms: float
    values: int
    changed_share: float
    cycle_frames: int | None

    @classmethod
    def of(cls, log_exposure: FloatArray) -> ExposureReport:
        """Describe exposures by ln of their milliseconds, shape (frames,)."""
        parts = [*blocks(log_exposure, 1)]
        changed = sum(int(np.count_nonzero(np.abs(np.diff(part)) >= _CHANGED)) for part in parts)
        return cls(
            float(np.exp(log_exposure.min())),
            float(np.exp(log_exposure.max())),
            len(np.unique(np.concatenate([np.unique(part) for part in parts]))),
            changed / max(len(log_exposure) - 1, 1),
            exposure_cycle(log_exposure),
        )

    @property
    def ratio(self) -> float:
        """Longest over shortest exposure."""
        return self.highest_ms / self.lowest_ms

    def in_words(self) -> str:
        """Return the range of exposures, such as "1 to 32 ms"."""
        if self.values == 1:
            return f"{self.lowest_ms:.4g} ms"
        return f"{self.lowest_ms:.4g} to {self.highest_ms:.4g} ms"


@dataclass(frozen=True)
class BrightnessReport:
    """How the brightness of the same things changes, and what explains it.

    Attributes
    ----------
    change_rms_log
        Root mean square change of ln grey from one frame to the next.
    unexplained_rms_log
        The same of what exposures (shifted by the lag) and flicker do not explain.
    unexplained_share
        Share of the energy of all changes that exposures do not explain; NaN where brightness does not change.
    unexplained_drift_log
        Most that unexplained changes add up to within :data:`DRIFT_FRAMES`.
    stale
        Whether brightness changes while the exposures stay as they are.
    flicker
        Periodic changes that the exposures do not explain, strongest first.
    jumps
        Lasting jumps that the exposures do not explain, in the order of frames.
    """

    change_rms_log: float
    unexplained_rms_log: float
    unexplained_share: float
    unexplained_drift_log: float
    stale: bool
    flicker: tuple[Flicker, ...]
    jumps: tuple[Jump, ...] = ()


def brightness_report(lag: LagEstimate, log_exposure: FloatArray) -> BrightnessReport | None:
    """Compare brightness with the exposures; None where too few frames could be compared.

    Parameters
    ----------
    lag
        Estimate of the lag, with the changes it was made from.
    log_exposure
        ln of the exposure of every frame, shape (frames,).
    """
    if lag.fit is None or not len(lag.frame):
        return None
    fit = lag.fit
    flicker = _reported(lag, exposure_cycle(log_exposure))
    unexplained = without_waves(lag.frame, fit.unexplained, [f.cycles_per_frame for f in flicker])
    energy = float(np.sum(fit.observed**2))
    shift = lag.candidates[0] if lag.candidates else 0
    change = log_exposure[lag.frame + 1 + shift] - log_exposure[lag.frame + shift]
    unchanged = unexplained[np.abs(change) < _UNCHANGED]
    drift = _drift(unexplained, lag.frame)
    constant = len(unchanged) == len(unexplained)
    stale = len(unchanged) >= _MIN_UNCHANGED_PAIRS and _rms(unchanged) > NOTABLE_RMS_LOG
    return BrightnessReport(
        _rms(fit.observed),
        _rms(unexplained),
        float(np.sum(fit.unexplained**2)) / energy if energy > 0 else float("nan"),
        drift,
        bool(stale or (constant and drift > _STALE_DRIFT_LOG)),
        flicker,
        find_jumps(lag.frame, unexplained),
    )


def _reported(lag: LagEstimate, cycle: int | None) -> tuple[Flicker, ...]:
    """Return the flicker to report: clear lines that are not harmonics of the exposures' own cycle."""
    found = lag.flicker
    if not found and lag.fit is not None:
        one = find_flicker(lag.frame, lag.fit.unexplained)
        found = () if one is None else (one,)

    def own(flicker: Flicker) -> bool:
        if cycle is None:
            return False
        turns = flicker.cycles_per_frame * cycle
        return abs(turns - round(turns)) < _SAME_TURNS

    reported = tuple(f for f in found if f.share >= _REPORTED_SHARE and not own(f))
    if not reported or lag.fit is None:
        return ()
    left = without_waves(lag.frame, lag.fit.unexplained, [f.cycles_per_frame for f in reported])
    return reported if np.var(left) <= (1 - _LEAST_TOTAL_SHARE) * np.var(lag.fit.unexplained) else ()


def _rms(values: FloatArray) -> float:
    """Return the root mean square without the largest values."""
    squared = np.sort(values**2)
    kept = squared[: max(1, int(_KEPT_SHARE * len(squared)))]
    return float(np.sqrt(kept.mean())) if len(kept) else 0.0


def _drift(change: FloatArray, frame: IntArray) -> float:
    """Return the largest range of the sum of changes over consecutive frames, within :data:`DRIFT_FRAMES`."""
    pieces = np.split(change, np.flatnonzero(np.diff(frame) != 1) + 1)
    largest = 0.0
    for piece in pieces:
        total = np.concatenate([[0.0], np.cumsum(piece)])
        for start in range(0, max(1, len(total) - DRIFT_FRAMES), _DRIFT_STEP):
            largest = max(largest, float(np.ptp(total[start : start + DRIFT_FRAMES + 1])))
    return largest
