"""What contradicts the model of one response and one vignette, in words, with what to do about it."""

from __future__ import annotations

from ospc.estimation.effect_models import (
    DRIFTING_BLACK,
    DRIFTING_RESPONSE,
    DRIFTING_VIGNETTE,
    LOCAL_TONE_MAPPING,
)
from ospc.estimation.fit import Fit
from ospc.estimation.residual_effects import UNEVEN, UNSTEADY_RADIANCE, UNSTEADY_RESPONSE, UNSTEADY_VIGNETTE

Contradictions = tuple[tuple[str, str], ...]
"""The description and the remedy of each contradiction, the clearest first."""

_SAME_FOR_ALL_PLACES = "switch off local contrast, HDR and tone mapping in the camera, and film in steady light"
_VIGNETTE_STAYS = (
    "switch off all stabilisation, including that of the lens, and lock zoom, image orientation and white balance"
)

_CONTRADICTIONS = {
    LOCAL_TONE_MAPPING: (
        "grey levels depend on the brightness around them, as with local tone mapping or flickering light",
        "exponent",
        _SAME_FOR_ALL_PLACES,
    ),
    "curved exposures": (
        "the brightness of the images is not proportional to the exposures over their whole range",
        "curvature of ln brightness over ln exposure",
        "check the unit of the exposures: they must be times (not logarithms or steps) multiplied by the linear "
        "gain; switch off digital gain and HDR",
    ),
    DRIFTING_RESPONSE: (
        "the response changes during the recording",
        "exponent",
        "lock the picture profile, contrast and gamma of the camera",
    ),
    DRIFTING_BLACK: (
        "the black level changes during the recording",
        "share of white",
        "let the camera warm up, and switch off automatic contrast",
    ),
    "black level by exposure": (
        "the black level differs between long and short exposures, or the light changed",
        "share of white per e-fold exposure",
        "lock the gain of the camera, let it control only the exposure time, and film in steady light without sun or "
        "lamps in or near the view",
    ),
    UNSTEADY_VIGNETTE: (
        "the vignette has a different position in each frame, as with stabilisation, glossy surfaces or a lamp on "
        "the camera",
        "change of ln vignette per half diagonal",
        "switch off electronic stabilisation and cropping of the camera, and avoid glossy floors and walls, and "
        "lamps that move with the camera",
    ),
    UNSTEADY_RESPONSE: (
        "the response differs from frame to frame (automatic contrast, sun or lamps in or near the view, haze, fog), "
        "or the frames show too little texture to be registered",
        "exponent",
        "switch off automatic contrast and scene modes of the camera, keep sun and lamps out of the view, and film "
        "scenes with texture in clear air",
    ),
    UNSTEADY_RADIANCE: (
        "the brightness of the same points differs between frames by more than noise and exposure explain",
        "deviation of ln brightness",
        _SAME_FOR_ALL_PLACES,
    ),
    UNEVEN: (
        "a region of the image is darker or brighter than a smooth vignette predicts (dirt, a finger or hood, "
        "wipers, reflections in a window, parts of the sensor with another gain)",
        "deviation of ln vignette",
        "clean lens and sensor, remove what covers the lens, avoid wipers and reflections from the dashboard "
        "or a window, and switch off shading correction",
    ),
    DRIFTING_VIGNETTE: (
        "the vignette changes during the recording",
        "change of ln vignette at the corners",
        "lock zoom, focus and aperture, and switch off shading correction",
    ),
    "vignette by exposure": (
        "the vignette differs between long and short exposures, as with a leaf shutter or an automatic iris",
        "change of ln vignette at the corners per e-fold exposure",
        "lock the aperture, and use an electronic shutter",
    ),
    "square vignette": (
        "the corners of the image are darker or brighter than a round vignette predicts, as with shading correction "
        "on a coarse grid, a rectangular hood or pixels that are not square",
        "deviation of ln vignette",
        "switch off shading correction, film without a lens hood or filters, and record images with square pixels",
    ),
    "vignette moving sideways": (
        "the vignette moves sideways during the recording",
        "change of ln vignette per half diagonal",
        _VIGNETTE_STAYS,
    ),
    "vignette moving vertically": (
        "the vignette moves vertically during the recording",
        "change of ln vignette per half diagonal",
        _VIGNETTE_STAYS,
    ),
}
"""The description of each contradiction, the quantity that its size is given in, and its remedy."""


def contradictions_of(fit: Fit) -> Contradictions:
    """Return what contradicts the model of one response and one vignette."""
    found = [estimate for estimate in fit.effect_estimates if estimate.contradicts]
    found.sort(key=lambda estimate: -abs(estimate.value) / estimate.sigma)
    contradictions = []
    for one in found:
        what, quantity, remedy = _CONTRADICTIONS[one.name]
        contradictions.append((f"{what} ({quantity}: {one.value:.2g} ± {one.sigma:.1g})", remedy))
    return tuple(contradictions)
