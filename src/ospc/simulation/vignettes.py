"""Vignettes of the simulated camera: analytic ones by name, or a vignette.png."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ospc.arrays import ImageSize
from ospc.errors import SettingError
from ospc.formats.dso import read_vignette
from ospc.photometry.geometry import half_diagonal, normalised, pixel_grid
from ospc.photometry.vignette import PolynomialVignette, RasterVignette, Vignette
from ospc.simulation.settings import SimulationSettings

VIGNETTES = ("none", "polynomial", "cos4", "decentred")
"""The vignettes by name."""


def none(size: ImageSize) -> PolynomialVignette:
    """Return V = 1 everywhere."""
    return PolynomialVignette(size, (0.0, 0.0, 0.0))


def cos4(size: ImageSize, focal_px: float) -> RasterVignette:
    """Return the natural fall-off of a thin lens, V = cos⁴θ with tan θ = distance from the centre / focal length."""
    tangent = np.linalg.norm(normalised(pixel_grid(size), size), axis=-1) * half_diagonal(size) / focal_px
    return RasterVignette((1 / (1 + tangent**2) ** 2).astype(np.float32), {"name": "cos4", "focal_px": focal_px})


def decentred(size: ImageSize, coefficients: tuple[float, ...], centre: tuple[float, float]) -> RasterVignette:
    """Return V = 1 + v₁R² + v₂R⁴ + v₃R⁶ with R measured from its own centre, divided by its maximum.

    R, and the centre relative to the image centre, are in half diagonals.
    """
    squared = np.sum((normalised(pixel_grid(size), size) - np.array(centre)) ** 2, axis=-1)
    values = np.polynomial.polynomial.polyval(squared, [1.0, *coefficients])
    source = {"name": "decentred", "coefficients": list(coefficients), "centre": list(centre)}
    return RasterVignette(values.astype(np.float32), source)


def make_vignette(settings: SimulationSettings) -> Vignette:
    """Return the vignette of the settings: by name, from a file, or as given.

    Raises
    ------
    SettingError
        If it is neither a name nor a file, is not positive everywhere, or its size is not that of the images.
    FormatError
        If the file is not a grey PNG.
    """
    choice = settings.vignette
    if not isinstance(choice, str | Path):
        made: Vignette = choice
    elif choice == "none":
        made = none(settings.size)
    elif choice == "polynomial":
        made = PolynomialVignette(settings.size, tuple(settings.vignette_coefficients))
    elif choice == "cos4":
        made = cos4(settings.size, settings.focal_px)
    elif choice == "decentred":
        made = decentred(settings.size, settings.vignette_coefficients, settings.vignette_centre)
    elif Path(choice).is_file():
        made = read_vignette(choice)
    else:
        raise SettingError(f"vignette '{choice}' is neither a file nor one of {', '.join(VIGNETTES)}")
    if tuple(made.size) != tuple(settings.size):
        raise SettingError(f"the vignette has {made.size} pixels, the images have {settings.size}; make them equal")
    image = made.image()
    if not np.all(np.isfinite(image)) or image.min() <= 0 or image.max() > 1 + 1e-6:
        raise SettingError(
            f"the vignette runs from {image.min():.3g} to {image.max():.3g}; it must stay above 0 and at most 1"
        )
    return made
