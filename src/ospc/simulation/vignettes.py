"""Vignettes a simulated camera can have: analytic ones by name, or an image file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ospc.arrays import ImageSize
from ospc.errors import FormatError, FrameError, SettingError
from ospc.photometry.geometry import half_diagonal, normalised, pixel_grid
from ospc.photometry.vignette import PolynomialVignette, RasterVignette, Vignette
from ospc.recording.decoding import MAX_FILE_BYTES, decode_grey
from ospc.recording.image_header import read_header
from ospc.simulation.settings import SimulationSettings

VIGNETTES = ("none", "polynomial", "cos4", "decentred")
"""The vignettes that have a name."""


def none(size: ImageSize) -> PolynomialVignette:
    """Return a lens that loses no light anywhere."""
    return PolynomialVignette(size, (0.0, 0.0, 0.0))


def cos4(size: ImageSize, focal_px: float) -> RasterVignette:
    """Return the natural fall-off of a thin lens, V = cos⁴θ with tan θ = distance from the centre / focal length."""
    tangent = np.linalg.norm(normalised(pixel_grid(size), size), axis=-1) * half_diagonal(size) / focal_px
    return RasterVignette((1 / (1 + tangent**2) ** 2).astype(np.float32), {"name": "cos4", "focal_px": focal_px})


def decentred(size: ImageSize, coefficients: tuple[float, ...], centre: tuple[float, float]) -> RasterVignette:
    """Return V = 1 + v₁R² + v₂R⁴ + v₃R⁶ with R measured from another centre, divided by its maximum.

    Parameters
    ----------
    size
        Width and height in pixels.
    coefficients
        (v₁, v₂, v₃), radius in half diagonals.
    centre
        Centre relative to the image centre, in half diagonals.
    """
    squared = np.sum((normalised(pixel_grid(size), size) - np.array(centre)) ** 2, axis=-1)
    values = np.polynomial.polynomial.polyval(squared, [1.0, *coefficients])
    source = {"name": "decentred", "coefficients": list(coefficients), "centre": list(centre)}
    return RasterVignette(values.astype(np.float32), source)


def read_vignette(path: str | Path) -> RasterVignette:
    """Read a vignette image of 8 or 16 bit; grey values are proportional to V.

    Raises
    ------
    FormatError
        If the file is not such an image.
    """
    place = Path(path)
    try:
        with place.open("rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
        if len(data) > MAX_FILE_BYTES or read_header(data, str(place)).channels != 1:
            raise FormatError(f"{place}: not a grey image of reasonable size; give one with values proportional to V")
        image = decode_grey(data, str(place))
    except (OSError, FrameError) as error:
        raise FormatError(f"{place}: not readable as a vignette ({error})") from None
    return RasterVignette(image.astype(np.float32), {"file": place.name})


def make_vignette(settings: SimulationSettings) -> Vignette:
    """Return the vignette that the settings name, point to, or hold.

    Raises
    ------
    SettingError
        If it is neither a name nor a file, is not positive everywhere, or has another size than the images.
    FormatError
        If the file does not hold a vignette.
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
        raise SettingError(f"the vignette is {made.size} pixels in size, the images {settings.size}; make them equal")
    image = made.image()
    if not np.all(np.isfinite(image)) or image.min() <= 0 or image.max() > 1 + 1e-6:
        raise SettingError(
            f"the vignette runs from {image.min():.3g} to {image.max():.3g}; it must stay above 0 and at most 1"
        )
    return made
