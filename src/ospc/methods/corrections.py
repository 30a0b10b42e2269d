"""The effects that a fit found and corrected: notes on them, and the corrected exposures."""

from __future__ import annotations

from typing import Any

import numpy as np

from ospc.errors import plain
from ospc.estimation.effect_models import DRIFTING_LIGHT, GAIN_STEPS, GLARE_OF_WHITE, LIGHT_FIXED_TO_CAMERA
from ospc.estimation.effects import Effects
from ospc.estimation.fit import Fit
from ospc.estimation.light_shapes import DARK_SIGNAL, STRAY_LIGHT, UNEVEN_GLARE
from ospc.estimation.residual_effects import UNSTEADY_LIGHT
from ospc.exposures.used import corrected_as_source
from ospc.observations import ExposedObservations
from ospc.photometry.verdict import INEXACT_EXPOSURES, LATE_EXPOSURES, NOMINAL_EXPOSURES, EffectEstimate
from ospc.settings.methods import MAX_CORRECTED_EXPOSURES, MIN_NOTED_GAIN

_EDGES = {"sideways": "per half diagonal to the right", "vertically": "per half diagonal downwards"}
"""Where light grows from one edge of the image to the opposite one."""

_STRAY = "light fixed to the camera (a leak, a reflection, dark current) is {{amount}} of white {{stronger}} {}"

_LIGHT = {
    "veiling glare": "veiling glare of {amount} of the mean irradiance of each frame was found and corrected",
    "light scattered nearby": "{amount} of the light is scattered nearby; this was corrected",
    "light scattered widely": "{amount} of the light is scattered over a quarter of the image; this was corrected",
    **dict.fromkeys(GLARE_OF_WHITE, "white pixels cause another amount of glare than usual; this was corrected"),
    **{
        name: f"glare is {{amount}} of the mean irradiance of each frame {{stronger}} {where}; this was corrected"
        for name, where in UNEVEN_GLARE.items()
    },
    **{
        name: _STRAY.format(_EDGES.get(where, where)) + " at {typical}; this was corrected"
        for name, where in STRAY_LIGHT.items()
    },
    **{
        name: f"the black level is {{amount}} of white {{higher}} {_EDGES.get(where, where)}; this was corrected"
        for name, where in DARK_SIGNAL.items()
    },
    DRIFTING_LIGHT: "the light {rose} by {amount} from the first frame to the last; this was corrected",
}
"""The note on light that was added or changed, with its absolute amount and the exposure."""
_OPPOSITE = {"stronger": "weaker", "higher": "lower", "rose": "fell"}
"""The words in these notes, and those that replace them if the amount is negative."""

_RANDOM = {
    UNSTEADY_LIGHT: (
        "frames are brighter or darker than their exposures predict, by {percent:.2g}% between the frames of a pair; "
        "this was accounted for"
    ),
    INEXACT_EXPOSURES: (
        "exposures are inexact by about {percent:.2g}%: all images at one exposure are brighter, or all are darker, "
        "than it predicts; this was accounted for"
    ),
}
"""The note on random gains of frames or of exposures."""


def notes_of(fit: Fit) -> tuple[str, ...]:
    """Return a sentence for each effect that was found and corrected or accounted for, if it is noticeable."""
    corrected = (found for found in fit.effect_estimates if found.corrected)
    noticeable = (one for one in corrected if one.name not in _RANDOM or one.value >= MIN_NOTED_GAIN)
    return tuple(dict.fromkeys(_corrected(one, fit.effects) for one in noticeable))


def corrected_exposures_of(fit: Fit, observations: ExposedObservations) -> dict[str, Any]:
    """Return the corrected exposures for the ``source`` of a calibration; empty if none were corrected."""
    error = fit.log_exposure_error(observations)
    if not error.any():
        return {}
    _, first = np.unique(observations.log_exposure, return_index=True)
    if len(first) > MAX_CORRECTED_EXPOSURES:
        first = first[np.linspace(0, len(first) - 1, MAX_CORRECTED_EXPOSURES).round().astype(np.int64)]
    log_stated = observations.log_exposure[first]
    return corrected_as_source(np.exp(log_stated), np.exp(log_stated + error[first]))


def _corrected(found: EffectEstimate, effects: Effects) -> str:
    typical_ms = float(np.exp(effects.log_typical_exposure))
    digits = 2 if found.name in LIGHT_FIXED_TO_CAMERA else 1
    sigma = f"± {found.sigma:.{digits}%}"
    if found.name in _LIGHT:
        amount = f"{abs(found.value):.{digits}%} {sigma}"
        words = {word: word if found.value >= 0 else opposite for word, opposite in _OPPOSITE.items()}
        return _LIGHT[found.name].format(amount=amount, typical=f"{plain(typical_ms, 3)} ms", **words)
    if found.name in GAIN_STEPS:
        limit_ms = effects.step_exposures[GAIN_STEPS.index(found.name)] * typical_ms
        share, than = f"{abs(found.value):.1%} {sigma}", "brighter" if found.value > 0 else "darker"
        return (
            f"images with exposures above {plain(limit_ms, 3)} ms are {share} {than} than predicted, as with an "
            "inexact gain; this was corrected"
        )
    if found.name == NOMINAL_EXPOSURES:
        return "exposures are nominal, such as 1/60 s for 1/64 s; the exact fractions of a stop were used instead"
    if found.name == LATE_EXPOSURES:
        when, lag = ("late" if found.value > 0 else "early"), f"{abs(found.value):.2f} ± {found.sigma:.1g}"
        return f"exposures are {lag} frames {when}; this was corrected"
    if found.name in _RANDOM:
        return _RANDOM[found.name].format(percent=100 * found.value)
    offset = f"{plain(abs(found.value) * typical_ms, 3)} ± {plain(found.sigma * typical_ms, 1)} ms"
    too = "short" if found.value > 0 else "long"
    return f"all exposures are {offset} too {too}; this was corrected"
