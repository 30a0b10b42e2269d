"""Response and vignette of the simulated camera: analytic ones by name, or from pcalib.txt and vignette.png."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ospc.arrays import ImageSize
from ospc.errors import SettingError
from ospc.formats.dso import read_pcalib, read_vignette
from ospc.photometry.geometry import half_diagonal, normalised, pixel_grid
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette, RasterVignette, Vignette
from ospc.simulation.settings import SimulationSettings
from ospc.simulation.texture import srgb_decoded

LEVELS = 255 * 8 + 1
"""Length of the tables: every 8-bit grey value coincides with an entry."""
_GREY = np.linspace(0.0, 1.0, LEVELS)
"""Grey levels of the entries."""


def srgb() -> Response:
    """Return the transfer function of sRGB (IEC 61966-2-1)."""
    return Response(srgb_decoded(_GREY), model={"name": "srgb"})


def logarithmic(steepness: float = 50.0) -> Response:
    """Return f(I) = ln(1 + aI) / ln(1 + a), logarithmic compression."""
    inverse = np.expm1(_GREY * math.log1p(steepness)) / steepness
    return Response.from_values(inverse, model={"name": "log", "steepness": steepness})


def filmic() -> Response:
    """Return an S-curve with toe and shoulder, f(I) = (1 + c) I^p / (I^p + c), where c = halfᵖ.

    This is the function of Naka and Rushton (1966), scaled to reach 1. Its inverse is
    g(M) = (cM / (1 + c − M))^(1/p).
    """
    exponent, half = 1.25, 0.18
    constant = half**exponent
    inverse = (constant * _GREY / (1 + constant - _GREY)) ** (1 / exponent)
    return Response.from_values(inverse, model={"name": "filmic", "exponent": exponent, "half": half})


def tum_narrow() -> Response:
    """Return a piecewise linear g through (0, 0), (88/255, 0.068), (188/255, 0.464), (1, 1).

    This approximates the response of the camera of the TUM monocular data set.
    """
    inverse = np.interp(_GREY * 255, [0, 88, 188, 255], [0, 0.068, 0.464, 1])
    return Response(inverse, model={"name": "tum_narrow"})


RESPONSES: dict[str, Callable[[], Response]] = {
    "linear": lambda: Response(_GREY, model={"name": "linear"}),
    "srgb": srgb,
    "gamma2.2": lambda: Response.gamma(2.2, LEVELS),
    "log": logarithmic,
    "filmic": filmic,
    "tum_narrow": tum_narrow,
}
"""The responses by name; linear is g(M) = M, gamma2.2 is g(M) = M^2.2."""


def make_response(choice: str | Path | Response) -> Response:
    """Return a response given by name, as a pcalib.txt, or itself; SettingError if it is none of these."""
    if isinstance(choice, Response):
        return choice
    if str(choice) in RESPONSES:
        return RESPONSES[str(choice)]()
    if not Path(choice).is_file():
        raise SettingError(f"response '{choice}' is neither a file nor one of {', '.join(RESPONSES)}")
    return read_pcalib(choice)


def cos4(size: ImageSize, focal_px: float) -> RasterVignette:
    """Return the natural vignette of a thin lens, V = cos⁴θ with tan θ = distance from the centre / focal length."""
    tangent = np.linalg.norm(normalised(pixel_grid(size), size), axis=-1) * half_diagonal(size) / focal_px
    return RasterVignette((1 / (1 + tangent**2) ** 2).astype(np.float32), {"name": "cos4", "focal_px": focal_px})


DECENTRED = (0.10, -0.06)
"""Centre of the decentred vignette relative to the image centre, in half diagonals."""


def decentred(size: ImageSize, coefficients: tuple[float, ...]) -> RasterVignette:
    """Return V = 1 + v₁R² + v₂R⁴ + v₃R⁶ with R measured from :data:`DECENTRED`, divided by its maximum."""
    squared = np.sum((normalised(pixel_grid(size), size) - np.array(DECENTRED)) ** 2, axis=-1)
    values = np.polynomial.polynomial.polyval(squared, [1.0, *coefficients])
    source = {"name": "decentred", "coefficients": list(coefficients), "centre": list(DECENTRED)}
    return RasterVignette(values.astype(np.float32), source)


VIGNETTES: dict[str, Callable[[SimulationSettings], Vignette]] = {
    "none": lambda settings: PolynomialVignette(settings.size, (0.0, 0.0, 0.0)),
    "polynomial": lambda settings: PolynomialVignette(settings.size, tuple(settings.vignette_coefficients)),
    "cos4": lambda settings: cos4(settings.size, settings.focal_px),
    "decentred": lambda settings: decentred(settings.size, settings.vignette_coefficients),
}
"""The vignettes by name."""


def make_vignette(settings: SimulationSettings) -> Vignette:
    """Return the vignette of the settings, given by name, as a vignette.png, or itself.

    SettingError if it is none of these, is not positive everywhere, or differs in size from the images.
    """
    choice = settings.vignette
    if not isinstance(choice, str | Path):
        made: Vignette = choice
    elif str(choice) in VIGNETTES:
        made = VIGNETTES[str(choice)](settings)
    elif Path(choice).is_file():
        made = read_vignette(choice)
    else:
        raise SettingError(f"vignette '{choice}' is neither a file nor one of {', '.join(VIGNETTES)}")
    if tuple(made.size) != tuple(settings.size):
        raise SettingError(f"the vignette has {made.size} pixels, the images have {settings.size}; make them equal")
    image = made.image()
    if not np.all(np.isfinite(image)) or image.min() <= 0 or image.max() > 1 + 1e-6:
        raise SettingError(
            f"the vignette ranges from {image.min():.3g} to {image.max():.3g}; it must be above 0 and at most 1"
        )
    return made
