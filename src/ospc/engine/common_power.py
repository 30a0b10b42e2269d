"""Detection of exposures on another scale after a change: response and vignette are then raised to the same power."""

from __future__ import annotations

import numpy as np

from ospc.arrays import FloatArray
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.response import Response
from ospc.photometry.vignette import diagonal_profile
from ospc.settings.methods import (
    COMMON_POWER_GREYS,
    COMMON_POWER_SIGMAS,
    COMMON_POWER_TOLERANCE,
    MIN_COMMON_POWER_LOG,
)


def common_power(before: Calibration, after: Calibration) -> float | None:
    """Return the power of the earlier response and vignette that the later ones are; None if they are no such power.

    If the recorded exposures are a power of the true ones, the images show the same power of response and vignette.
    Another response leaves the vignette as it was, and another lens the response.
    """
    if before.response is None or after.response is None or before.vignette is None or after.vignette is None:
        return None
    if before.vignette_sigma is None or after.vignette_sigma is None:
        return None
    of_response, misfit = _power(*_log_responses(before.response, after.response))
    earlier, later = (diagonal_profile(one, PROFILE_RADII) for one in (before.vignette, after.vignette))
    of_vignette, _ = _power(np.log(earlier), np.log(later))
    log_sigma = before.vignette_sigma[-1] / earlier[-1] + after.vignette_sigma[-1] / later[-1]
    sigma = log_sigma / max(abs(np.log(earlier[-1])), np.finfo(np.float64).tiny)
    alike = abs(of_response - of_vignette) < COMMON_POWER_TOLERANCE + COMMON_POWER_SIGMAS * sigma
    clear = of_vignette > 0 and abs(np.log(of_vignette)) > MIN_COMMON_POWER_LOG + COMMON_POWER_SIGMAS * sigma
    return of_response if alike and clear and misfit < COMMON_POWER_TOLERANCE else None


def _log_responses(before: Response, after: Response) -> tuple[FloatArray, FloatArray]:
    """Return ln g of both, relative to the middle of the grey levels that both have measured, shape (32,) each."""
    lowest = max(before.support[0], after.support[0])
    highest = max(min(before.support[1], after.support[1]), lowest)
    levels = np.linspace(lowest, highest, COMMON_POWER_GREYS)
    first, second = (np.log(one.inverse(levels) / one.inverse((lowest + highest) / 2)) for one in (before, after))
    return np.asarray(first), np.asarray(second)


def _power(before: FloatArray, after: FloatArray) -> tuple[float, float]:
    """Return the factor from one logarithm to another, and the misfit relative to the other."""
    squared = float(before @ before)
    power = float(before @ after) / squared if squared > 0 else 0.0
    left = after - power * before
    return power, float(np.sqrt(left @ left / max(float(after @ after), np.finfo(np.float64).tiny)))
