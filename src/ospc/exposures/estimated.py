"""Calibrations from exposures that were estimated from the images: known up to one exponent, and labelled as such.

Raising response, vignette and exposures to any common power explains the images equally well.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.verdict import Verdict
from ospc.photometry.vignette import diagonal_profile
from ospc.settings.unknown_exposures import EXPONENT_SIGMA

_REMEDY = "give the exposure of every frame, or of a second recording of the same camera"


def labelled(calibration: Calibration) -> Calibration:
    """Return a calibration from estimated exposures with a label, and with the uncertainty of the exponent."""
    response, vignette_sigma, sigma = calibration.response, calibration.vignette_sigma, EXPONENT_SIGMA
    if response is not None:
        response = response.with_uncertain_exponent(sigma)
    if calibration.vignette is not None and vignette_sigma is not None:
        profile = diagonal_profile(calibration.vignette, PROFILE_RADII)
        vignette_sigma = np.hypot(vignette_sigma, np.abs(profile * np.log(np.maximum(profile, 1e-12))) * sigma)
    verdicts = {name: _labelled_verdict(name, verdict) for name, verdict in calibration.verdicts.items()}
    return replace(
        calibration,
        response=response,
        vignette_sigma=vignette_sigma,
        verdicts=verdicts,
        converged=False,
        exponent_sigma=sigma,
        advice=(_REMEDY, *calibration.advice),
    )


def _labelled_verdict(name: str, verdict: Verdict) -> Verdict:
    if not verdict.known:
        return replace(verdict, reason=f"{verdict.reason} (exposures are estimated: their unit is arbitrary)")
    others = " and ".join(part for part in ("response", "vignette", "exposures") if part != name)
    return Verdict(
        "marginal",
        f"up to one exponent: no exposures were known, and raising {name}, {others} to any common power explains the "
        f"images equally well; the power is that of a typical camera (ln γ ± {EXPONENT_SIGMA:.2f})",
        _REMEDY,
    )
