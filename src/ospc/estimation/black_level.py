"""The grey level of black, from the fitted response, if no pixel shows it.

Sensors add a pedestal to their values. If many pixels are black, their histogram shows it. Otherwise, the response
does: with g = c·(M − p)ᵞ, the local gamma γ·M/(M − p) rises steeply towards p, more than its basis can follow.
"""

from __future__ import annotations

import numpy as np

from ospc.estimation.fit import Fit, measured_greys
from ospc.observations import Observations
from ospc.settings.response import (
    BLACK_LEVEL_SIGMAS,
    BRIGHTEST_OF_BLACK_LEVEL,
    MAX_BLACK_LEVEL,
    MAX_BLACK_LEVEL_MISFIT,
    MIN_BLACK_LEVEL_KNOTS,
    MIN_RECIPROCAL_GAMMA_SIGMA,
)


def black_level(fit: Fit, observations: Observations, least: float) -> float:
    """Return the grey level in [0, 1] at which the fitted response vanishes; 0 unless it is clearly above ``least``.

    The reciprocal of the local gamma is (1 − p/M)/γ: a line in 1/M. A response with a flat toe has no such line.
    """
    basis = fit.response_basis
    lowest = measured_greys(observations)[0]
    used = (basis.knots >= lowest) & (basis.knots <= BRIGHTEST_OF_BLACK_LEVEL)
    if np.count_nonzero(used) < MIN_BLACK_LEVEL_KNOTS:
        return 0.0
    gamma = fit.response_parameters[used]
    sigma = np.sqrt(np.diag(fit.covariance)[: len(basis)][used]) / gamma**2
    sigma = np.maximum(sigma, MIN_RECIPROCAL_GAMMA_SIGMA)
    rows = np.stack([np.ones(len(gamma)), -1 / basis.knots[used]], axis=1) / sigma[:, None]
    covariance = np.linalg.inv(rows.T @ rows)
    level, slope = covariance @ (rows.T @ (1 / gamma / sigma))
    misfit = np.sum((rows @ [level, slope] - 1 / gamma / sigma) ** 2) / (len(gamma) - 2)
    found = slope / level
    by_line = np.array([-found, 1.0]) / level
    error = float(np.sqrt(max(1.0, misfit) * by_line @ covariance @ by_line))
    clear = level > 0 and found > max(least, BLACK_LEVEL_SIGMAS * error) and misfit < MAX_BLACK_LEVEL_MISFIT
    return min(float(found), lowest, MAX_BLACK_LEVEL) if clear else 0.0
