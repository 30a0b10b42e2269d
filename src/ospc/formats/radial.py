"""The polynomial 1 + v₁R² + v₂R⁴ + v₃R⁶ that photographic programs share, and its units of radius."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ospc.arrays import FloatArray, ImageSize
from ospc.errors import FormatError, SettingError
from ospc.photometry.geometry import half_diagonal, normalised
from ospc.photometry.vignette import LogVignette, PolynomialVignette, RasterVignette, Vignette

FULL_FRAME_HALF_DIAGONAL_MM = math.hypot(36.0, 24.0) / 2
"""Half the diagonal of a sensor with crop factor 1, in millimetres."""

_TERMS = 3
_MOST_PIXELS = 1_000_000


@dataclass(frozen=True)
class RadialFit:
    """A vignette as 1 + v₁R² + v₂R⁴ + v₃R⁶ about a centre.

    Attributes
    ----------
    size
        Width and height in pixels of the images.
    coefficients
        (v₁, v₂, v₃), for R in units of the half diagonal.
    centre
        Centre relative to the image centre, in half diagonals.
    rms
        Root mean square residual over the pixels, relative to the centre; 0 where nothing had to be fitted.
    worst
        Largest absolute residual.
    """

    size: ImageSize
    coefficients: tuple[float, float, float]
    centre: tuple[float, float] = (0.0, 0.0)
    rms: float = 0.0
    worst: float = 0.0

    @property
    def note(self) -> str:
        """The residual in a sentence; empty where nothing had to be fitted."""
        if self.worst == 0:
            return ""
        return (
            f"vignette fitted by 1 + v1 R^2 + v2 R^4 + v3 R^6: residual {self.rms:.2g} in the root mean square, "
            f"{self.worst:.2g} at most"
        )


@dataclass(frozen=True)
class Optics:
    """What photographic programs want to know of camera and lens besides the vignette.

    Attributes
    ----------
    focal_mm
        Focal length in millimetres.
    focal_px
        The same in pixels.
    crop_factor
        Diagonal of 36x24 mm over that of the sensor.
    aperture
        f-number.
    distance_m
        Focus distance in metres.
    maker, lens, camera
        Names.
    """

    focal_mm: float | None = None
    focal_px: float | None = None
    crop_factor: float | None = None
    aperture: float | None = None
    distance_m: float = 1000.0
    maker: str = "unknown"
    lens: str = "unknown"
    camera: str = "unknown"

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("focal_mm", "focal_px", "crop_factor", "aperture", "distance_m"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise SettingError(f"{name} must be positive, not {value}")

    def focal_ratio(self, size: ImageSize) -> float:
        """Return the focal length in half diagonals.

        Raises
        ------
        SettingError
            If the focal length is not known in a unit that allows it.
        """
        if self.focal_px is not None:
            return self.focal_px / half_diagonal(size)
        if self.focal_mm is not None and self.crop_factor is not None:
            return self.focal_mm * self.crop_factor / FULL_FRAME_HALF_DIAGONAL_MM
        raise SettingError(
            "the radius of this format is in focal lengths; give it in pixels (--focal-px), or in millimetres with "
            "the crop factor (--focal-mm, --crop-factor)"
        )

    def focal_in_mm(self, size: ImageSize) -> float:
        """Return the focal length in millimetres.

        Raises
        ------
        SettingError
            If it is not known.
        """
        if self.focal_mm is not None:
            return self.focal_mm
        if self.focal_px is not None and self.crop_factor is not None:
            return self.focal_ratio(size) * FULL_FRAME_HALF_DIAGONAL_MM / self.crop_factor
        raise SettingError("this format needs the focal length in millimetres, or in pixels with the crop factor")


def fit_radial(vignette: Vignette, *, about_its_centre: bool = False) -> RadialFit:
    """Return the polynomial nearest to a vignette in the least squares over its pixels, dark surrounds left out.

    Parameters
    ----------
    vignette
        Any vignette. One that is such a polynomial is returned as it is.
    about_its_centre
        Whether a vignette with a centre of its own is fitted about that; about the image centre otherwise.

    Raises
    ------
    FormatError
        If the polynomial is not positive all over the image and so is no vignette.
    """
    if isinstance(vignette, PolynomialVignette) and len(vignette.coefficients) <= _TERMS:
        v1, v2, v3 = (*vignette.coefficients, 0.0, 0.0, 0.0)[:_TERMS]
        return checked(RadialFit(vignette.size, (v1, v2, v3)))
    centre = vignette.centre if about_its_centre and isinstance(vignette, LogVignette) else (0.0, 0.0)
    points = _pixels(vignette.size)
    values = vignette.at(points)
    squared = np.sum((normalised(points, vignette.size) - np.array(centre)) ** 2, axis=-1)
    seen = values > 0
    values, powers = values[seen], np.vander(squared[seen], _TERMS + 1, increasing=True)
    solution = np.linalg.lstsq(powers, values, rcond=None)[0]
    scale = float(solution[0])
    residual = (values - powers @ solution) / scale
    v1, v2, v3 = (float(v) for v in solution[1:] / scale)
    rms, worst = float(np.sqrt(np.mean(residual**2))), float(np.abs(residual).max())
    return checked(RadialFit(vignette.size, (v1, v2, v3), centre, rms, worst))


def vignette_of(fit: RadialFit) -> Vignette:
    """Return the vignette of a polynomial: a map of pixels if its centre is not the image's.

    Raises
    ------
    FormatError
        If it is not positive all over the image.
    """
    checked(fit)
    if fit.centre == (0.0, 0.0):
        return PolynomialVignette(fit.size, fit.coefficients)
    width, height = fit.size
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    offsets = normalised(np.stack([x, y], axis=-1), fit.size) - np.array(fit.centre)
    values = _value(fit.coefficients, np.sum(offsets**2, axis=-1))
    return RasterVignette(
        values.astype(np.float32), {"coefficients": list(fit.coefficients), "centre": list(fit.centre)}
    )


def rescaled(coefficients: tuple[float, ...], unit: float) -> tuple[float, float, float]:
    """Return vₙ·unit²ⁿ: the coefficients for a radius measured in units that are ``unit`` times as long.

    Parameters
    ----------
    coefficients
        Up to three, for the old unit.
    unit
        New unit of radius over the old one: focal length over half diagonal, to go from half diagonals to focal
        lengths.
    """
    v1, v2, v3 = ((*coefficients, 0.0, 0.0, 0.0)[n] * unit ** (2 * (n + 1)) for n in range(_TERMS))
    return v1, v2, v3


def _pixels(size: ImageSize) -> FloatArray:
    """Return pixel coordinates, shape (n, 2): all pixels, or a regular part of those of a large image."""
    step = max(1, math.ceil(math.sqrt(size[0] * size[1] / _MOST_PIXELS)))
    x, y = np.meshgrid(np.arange(0.0, size[0], step), np.arange(0.0, size[1], step))
    return np.stack([x.ravel(), y.ravel()], axis=-1)


def _value(coefficients: tuple[float, ...], squared_radius: FloatArray) -> FloatArray:
    return np.asarray(np.polynomial.polynomial.polyval(squared_radius, [1.0, *coefficients]))


def checked(fit: RadialFit) -> RadialFit:
    """Return the polynomial if it is positive all over the image.

    Raises
    ------
    FormatError
        If it is not, and so is no vignette.
    """
    half = half_diagonal(fit.size)
    farthest = math.hypot(*(abs(c) + (side - 1) / 2 / half for c, side in zip(fit.centre, fit.size, strict=True)))
    if not _value(fit.coefficients, np.linspace(0, farthest, 201) ** 2).min() > 0:
        v1, v2, v3 = fit.coefficients
        raise FormatError(
            f"the polynomial 1 {v1:+.3g} R^2 {v2:+.3g} R^4 {v3:+.3g} R^6 is not positive all over the image "
            f"and so no vignette; use a map of pixels instead"
        )
    return fit
