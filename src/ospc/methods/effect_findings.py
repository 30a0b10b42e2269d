"""What the effects that a fit found mean to the user: notes on what was corrected, warnings of contradictions."""

from __future__ import annotations

import numpy as np

from ospc.estimation.fit import Fit
from ospc.estimation.unevenness import UNEVEN
from ospc.estimation.unsteadiness import UNSTEADY_RESPONSE, UNSTEADY_VIGNETTE
from ospc.photometry.effect_estimate import EffectEstimate
from ospc.photometry.verdict import Verdict

_CONTRADICTIONS = {
    "local tone mapping": (
        "grey levels depend on their surroundings, as local tone mapping makes them",
        "switch off local contrast, HDR and tone mapping in the camera",
    ),
    "curved exposures": (
        "the images do not follow the exposures in proportion over their whole range",
        "check the unit of the exposures: they must be times, not logarithms or steps, multiplied by the linear gain",
    ),
    "drifting response": (
        "the response changes in the course of the recording",
        "fix the picture profile, contrast and gamma of the camera",
    ),
    "drifting black level": (
        "the black level changes in the course of the recording",
        "let the camera warm up, and switch off automatic contrast",
    ),
    UNSTEADY_VIGNETTE: (
        "the vignette is at another place in each frame",
        "switch off electronic stabilisation and cropping of the camera",
    ),
    UNSTEADY_RESPONSE: (
        "the response differs from frame to frame, or the frames show too little texture to be registered",
        "switch off automatic contrast and scene modes of the camera, and film scenes with texture",
    ),
    UNEVEN: (
        "a part of the image is darker or brighter than a smooth vignette would have it, in ln V",
        "clean lens and sensor, and switch off shading correction",
    ),
    "drifting vignette": (
        "the vignette changes in the course of the recording",
        "fix zoom, focus and aperture, and switch off shading correction",
    ),
}
"""What each contradiction is, and what to do about it."""


def notes_of(fit: Fit) -> tuple[str, ...]:
    """Return what was found and corrected, in sentences."""
    typical_ms = float(np.exp(fit.effects.log_typical_exposure))
    return tuple(_corrected(found, typical_ms) for found in fit.effect_estimates if found.corrected)


def contradictions_of(fit: Fit) -> tuple[tuple[str, str], ...]:
    """Return each contradiction as what it is and what to do about it, the clearest first."""
    found = [estimate for estimate in fit.effect_estimates if estimate.contradicts]
    found.sort(key=lambda estimate: -abs(estimate.value) / estimate.sigma)
    return tuple(
        (f"{_CONTRADICTIONS[one.name][0]}: {one.value:.2g} ± {one.sigma:.1g}", _CONTRADICTIONS[one.name][1])
        for one in found
    )


def judged(verdict: Verdict, contradictions: tuple[tuple[str, str], ...]) -> Verdict:
    """Return a verdict, marginal at best where something contradicts the model."""
    if not contradictions or not verdict.known:
        return verdict
    what, remedy = contradictions[0]
    return Verdict("marginal", f"{verdict.reason}, but {what}", remedy)


def _corrected(found: EffectEstimate, typical_ms: float) -> str:
    share = f"{abs(found.value):.1%} ± {found.sigma:.1%}"
    if found.name == "veiling glare":
        return f"veiling glare of {share} of the mean irradiance of each frame was found and is taken into account"
    if found.name == "light scattered nearby":
        return f"{share} of the light is scattered around its place; that is taken into account"
    if found.name == "dark current":
        return f"a dark signal of {share} of white at {typical_ms:.3g} ms was found and is taken into account"
    if found.name == "late exposures":
        when, lag = ("late" if found.value > 0 else "early"), f"{abs(found.value):.2f} ± {found.sigma:.1g}"
        return f"exposures are {when} by {lag} of a frame; that is taken into account"
    offset = f"{abs(found.value) * typical_ms:.3g} ± {found.sigma * typical_ms:.1g} ms"
    too = "short" if found.value > 0 else "long"
    return f"all exposures are too {too} by {offset}; that is taken into account"
