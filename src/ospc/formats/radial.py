"""The polynomial 1 + v₁R² + v₂R⁴ + v₃R⁶ of photographic programs, and its units of radius."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ospc.arrays import FloatArray, ImageSize
from ospc.errors import FormatError, SettingError, escaped
from ospc.photometry.geometry import half_diagonal, image_size, normalised
from ospc.photometry.vignette import (
    LARGEST_ATTENUATION,
    PolynomialVignette,
    Vignette,
    VignetteModel,
    powers_in_unit,
)

Terms: TypeAlias = tuple[float, float, float]
"""Coefficients of the polynomial for some unit of radius."""

FULL_FRAME_HALF_DIAGONAL_MM = math.hypot(36.0, 24.0) / 2
"""Half diagonal of a sensor with crop factor 1, in millimetres."""

_FITTED_PIXELS = 1_000_000
"""Approximate number of pixels on a regular grid for fits to larger images; four parameters need no more."""


@dataclass(frozen=True)
class RadialFit:
    """A vignette as 1 + v₁R² + v₂R⁴ + v₃R⁶, for R in half diagonals from a centre.

    ``centre`` is relative to the image centre, also in half diagonals. ``rms`` and ``worst`` are the root mean square
    and the largest residual over all pixels, relative to the value at the centre; 0 if the polynomial is exact.
    """

    size: ImageSize
    coefficients: Terms
    centre: tuple[float, float] = (0.0, 0.0)
    rms: float = 0.0
    worst: float = 0.0

    def __post_init__(self) -> None:
        """Raise a FormatError if the size is impossible, or the polynomial is not a valid vignette."""
        image_size(*self.size)
        half = half_diagonal(self.size)
        ends = [abs(c) + (side - 1) / 2 / half for c, side in zip(self.centre, self.size, strict=True)]
        with np.errstate(over="ignore", invalid="ignore"):
            squared = np.linspace(0, math.hypot(*ends), 201) ** 2
            values = np.polynomial.polynomial.polyval(squared, [1.0, *self.coefficients])
        if not (values.min() > 0 and values.max() <= LARGEST_ATTENUATION):
            v1, v2, v3 = self.coefficients
            raise FormatError(
                f"the polynomial 1 {v1:+.3g} R^2 {v2:+.3g} R^4 {v3:+.3g} R^6 is not a vignette, because it is not "
                f"between 0 and {LARGEST_ATTENUATION:g} everywhere in the image; use a map of pixels instead"
            )

    @property
    def note(self) -> str:
        """A sentence about the residual; empty if the polynomial is exact."""
        if self.worst == 0:
            return ""
        return (
            f"vignette fitted by 1 + v1 R^2 + v2 R^4 + v3 R^6: root mean square residual {self.rms:.2g}, "
            f"at most {self.worst:.2g}"
        )

    def vignette(self) -> PolynomialVignette:
        """Return the vignette."""
        return PolynomialVignette(self.size, self.coefficients, self.centre)


@dataclass(frozen=True)
class Optics:
    """Properties of camera and lens that photographic programs need in addition to the vignette.

    The crop factor is the ratio of the diagonal of 36x24 mm to that of the sensor, and the aperture is the f-number.
    """

    focal_mm: float | None = None
    focal_px: float | None = None
    crop_factor: float | None = None
    aperture: float | None = None
    maker: str = "unknown"
    lens: str = "unknown"
    camera: str = "unknown"

    def __post_init__(self) -> None:
        """Check the numbers, and escape the names."""
        for name in ("maker", "lens", "camera"):
            object.__setattr__(self, name, escaped(getattr(self, name)))
        for name in ("focal_mm", "focal_px", "crop_factor", "aperture"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise SettingError(f"{name} must be positive, not {value}")

    def focal_ratio(self, size: ImageSize) -> float:
        """Return the focal length in half diagonals; SettingError if it cannot be computed."""
        if self.focal_px is not None:
            return self.focal_px / half_diagonal(size)
        if self.focal_mm is not None and self.crop_factor is not None:
            return self.focal_mm * self.crop_factor / FULL_FRAME_HALF_DIAGONAL_MM
        raise SettingError(
            "the radius of this format is in focal lengths; give the focal length in pixels (--focal-px), or in "
            "millimetres with the crop factor (--focal-mm, --crop-factor)"
        )

    def focal_in_mm(self, size: ImageSize) -> float:
        """Return the focal length in millimetres; SettingError if it is unknown."""
        if self.focal_mm is not None:
            return self.focal_mm
        if self.focal_px is not None and self.crop_factor is not None:
            return self.focal_ratio(size) * FULL_FRAME_HALF_DIAGONAL_MM / self.crop_factor
        raise SettingError("this format needs the focal length; add --focal-mm, or --focal-px and --crop-factor")


def fit_radial(vignette: Vignette, *, about_its_centre: bool = False) -> RadialFit:
    """Return the polynomial fitted to a vignette by least squares over its pixels, without dark surrounds.

    It is centred on the image, or on the vignette if ``about_its_centre`` and the vignette states its centre. A
    vignette that is such a polynomial is not changed.

    Raises
    ------
    FormatError
        If the polynomial is not positive everywhere in the image.
    """
    centre = (0.0, 0.0)
    if about_its_centre and isinstance(vignette, VignetteModel):
        centre = vignette.centre
    if isinstance(vignette, PolynomialVignette) and len(vignette.coefficients) <= 3 and vignette.centre == centre:
        v1, v2, v3 = (*vignette.coefficients, 0.0, 0.0, 0.0)[:3]
        return RadialFit(vignette.size, (v1, v2, v3), centre)
    places, values = _samples(vignette)
    squared = np.sum((places - np.asarray(centre)) ** 2, axis=-1)
    powers = np.vander(squared, 4, increasing=True)
    solution = np.linalg.lstsq(powers, values, rcond=None)[0]
    residual = (values - powers @ solution) / float(solution[0])
    v1, v2, v3 = (float(v) for v in solution[1:] / solution[0])
    rms, worst = float(np.sqrt(np.mean(residual**2))), float(np.abs(residual).max())
    return RadialFit(vignette.size, (v1, v2, v3), centre, rms, worst)


def _samples(vignette: Vignette) -> tuple[FloatArray, FloatArray]:
    """Return places relative to the image centre in half diagonals, (n, 2), and the values at them, without zeros."""
    step = max(1, math.ceil(math.sqrt(vignette.size[0] * vignette.size[1] / _FITTED_PIXELS)))
    x, y = np.meshgrid(*(np.arange(0.0, side, step) for side in vignette.size))
    points = np.stack([x.ravel(), y.ravel()], axis=-1)
    values = vignette.at(points)
    bright = values > 0
    return normalised(points, vignette.size)[bright], values[bright]


def rescaled(coefficients: Terms, unit: float) -> Terms:
    """Return vₙ·unit²ⁿ, the coefficients for a unit of R that is ``unit`` times as long.

    FormatError if they overflow.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        v1, v2, v3 = map(float, powers_in_unit(coefficients, np.float64(unit)))
    if not all(map(math.isfinite, (v1, v2, v3))):
        raise FormatError(f"a focal length of {unit:.3g} or {1 / unit:.3g} half diagonals is impossible; correct it")
    return v1, v2, v3
