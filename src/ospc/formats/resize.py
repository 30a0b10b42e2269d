"""Calibrations for images that were cropped, scaled or binned after the calibration.

The response stays; the vignette moves with the pixels. What would no longer be valid is left out of the result: the
noise of averaged pixels, and the uncertainty of a profile about another centre.
"""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np

from ospc.arrays import Image, ImageSize
from ospc.errors import SettingError
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.geometry import half_diagonal, pixel_grid
from ospc.photometry.vignette import LogVignette, PolynomialVignette, RasterVignette, Vignette

_ASPECT_TOLERANCE = 0.01
"""Aspect ratios whose logarithms differ by more belong to different fields of view; less is rounding to pixels."""

_CENTRED_PX = 1.0
"""Parts whose margins differ by at most this are centred: with an odd number of pixels they cannot be equal."""

_DEGREES = (1, 1, 2, 2, 3, 3)
"""Degrees in x and y of the terms :data:`~ospc.photometry.vignette.NON_RADIAL`."""


def same_aspect(first: ImageSize, second: ImageSize) -> bool:
    """Tell whether two sizes can show the same field of view."""
    return abs(math.log(first[0] * second[1] / (first[1] * second[0]))) <= _ASPECT_TOLERANCE


def resampled(image: Image, size: ImageSize) -> Image:
    """Return an image of the same view with another number of pixels, of the same type."""
    how = cv2.INTER_AREA if size[0] < image.shape[1] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, size, interpolation=how))


def resize_vignette(vignette: Vignette, size: ImageSize) -> Vignette:
    """Return the vignette of the same view at another resolution.

    SettingError if the aspect ratio differs by more than 1 %: part of the view was cut off, so crop first.
    """
    width, height = vignette.size
    _check_size(size)
    if not same_aspect(size, vignette.size):
        raise SettingError(
            f"{width}x{height} cannot be scaled to {size[0]}x{size[1]}, which has another aspect ratio; crop first"
        )
    if isinstance(vignette, RasterVignette):
        return RasterVignette(resampled(vignette.values, size), vignette.source)
    scale = math.hypot(width, height) / math.hypot(*size)
    unit = scale * half_diagonal(size) / half_diagonal(vignette.size)
    if isinstance(vignette, LogVignette):
        centre = (vignette.centre[0] / unit, vignette.centre[1] / unit)
        return _in_unit(vignette, size, unit, centre)
    if isinstance(vignette, PolynomialVignette):
        return PolynomialVignette(size, _powers(vignette.coefficients, unit))
    at = (pixel_grid(size) + 0.5) * scale - 0.5
    return RasterVignette(vignette.at(at).astype(np.float32), vignette.as_dict())


def crop_vignette(vignette: Vignette, offset: tuple[int, int], size: ImageSize) -> Vignette:
    """Return the vignette of a part of the image, of which ``offset`` is the column and row of the first pixel.

    Each pixel keeps its attenuation, so the centre moves in the image. A polynomial about the image centre becomes a
    map of pixels unless the part is centred. SettingError if the part is not inside the image.
    """
    _check_size(size)
    inside = all(o >= 0 and o + s <= w for o, s, w in zip(offset, size, vignette.size, strict=True))
    if not inside:
        raise SettingError(
            f"{size[0]}x{size[1]} pixels from ({offset[0]}, {offset[1]}) are not inside "
            f"{vignette.size[0]}x{vignette.size[1]}"
        )
    half, new_half = half_diagonal(vignette.size), half_diagonal(size)
    shift = [(w - 1) / 2 - o - (s - 1) / 2 for w, o, s in zip(vignette.size, offset, size, strict=True)]
    if isinstance(vignette, LogVignette):
        centre = tuple((c * half + move) / new_half for c, move in zip(vignette.centre, shift, strict=True))
        return _in_unit(vignette, size, new_half / half, (centre[0], centre[1]))
    if isinstance(vignette, PolynomialVignette) and math.hypot(*shift) == 0:
        return PolynomialVignette(size, _powers(vignette.coefficients, new_half / half))
    values = vignette.at(pixel_grid(size) + np.array(offset, dtype=np.float64))
    return RasterVignette(values.astype(np.float32), {**vignette.as_dict(), "crop": [*offset, *size]})


def resize_calibration(calibration: Calibration, size: ImageSize) -> Calibration:
    """Return the calibration for scaled images, as :func:`resize_vignette`; their noise is not known."""
    _check_size(size)
    vignette = None if calibration.vignette is None else resize_vignette(calibration.vignette, size)
    return _changed(calibration, size, vignette, {"resized_to": list(size)})


def crop_calibration(calibration: Calibration, offset: tuple[int, int], size: ImageSize) -> Calibration:
    """Return the calibration for a part of the images, as :func:`crop_vignette`.

    The profile's uncertainty is kept where the part is centred, for the radii that remain.
    """
    vignette = None if calibration.vignette is None else crop_vignette(calibration.vignette, offset, size)
    margins = [w - o - s - o for w, o, s in zip(calibration.size, offset, size, strict=True)]
    sigma = calibration.vignette_sigma
    if max(map(abs, margins)) > _CENTRED_PX:
        sigma = None
    if sigma is not None:
        radii = PROFILE_RADII * (half_diagonal(size) / half_diagonal(calibration.size))
        sigma = np.interp(radii, PROFILE_RADII, sigma)
    changed = _changed(calibration, size, vignette, {"cropped_to": [*offset, *size]})
    return replace(changed, vignette_sigma=sigma, noise=calibration.noise)


def bin_calibration(calibration: Calibration, factor: int) -> Calibration:
    """Return the calibration for images in which blocks of ``factor`` × ``factor`` pixels are averaged.

    Columns and rows at the right and the bottom that fill no block are cut off. If the camera averages grey values
    instead of irradiances, the response is right only where they are nearly equal. SettingError if the factor is less
    than 1 or leaves no pixel.
    """
    width, height = calibration.size
    if factor < 1 or min(width, height) // max(factor, 1) < 2:
        raise SettingError(f"{width}x{height} pixels cannot be binned by {factor}")
    size = (width // factor, height // factor)
    whole = (size[0] * factor, size[1] * factor)
    cut = calibration if whole == calibration.size else crop_calibration(calibration, (0, 0), whole)
    return cut if factor == 1 else resize_calibration(cut, size)


def _in_unit(vignette: LogVignette, size: ImageSize, unit: float, centre: tuple[float, float]) -> LogVignette:
    """Return a log-polynomial for a radius in units ``unit`` times as long."""
    return LogVignette(
        size,
        _powers(vignette.coefficients, unit),
        centre,
        tuple(c * unit**degree for c, degree in zip(vignette.non_radial, _DEGREES, strict=False)),
        vignette.limit / unit,
    )


def _powers(coefficients: tuple[float, ...], unit: float) -> tuple[float, ...]:
    return tuple(c * unit ** (2 * n) for n, c in enumerate(coefficients, start=1))


def _changed(
    calibration: Calibration, size: ImageSize, vignette: Vignette | None, change: dict[str, list[int]]
) -> Calibration:
    return replace(
        calibration,
        size=size,
        vignette=vignette,
        noise=None,
        covariance={name: part for name, part in calibration.covariance.items() if name == "response"},
        source={**calibration.source, **change},
    )


def _check_size(size: ImageSize) -> None:
    if min(size) < 2:
        raise SettingError(f"an image of {size[0]}x{size[1]} pixels is too small for a vignette")
