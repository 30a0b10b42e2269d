"""The vignette: the attenuation of light over the image, relative to the centre."""

from __future__ import annotations

import io
import math
import zipfile
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self

import numpy as np
import numpy.typing as npt

from ospc.arrays import ByValue, Float32Array, FloatArray, ImageSize, read_only
from ospc.errors import UNREADABLE, FormatError
from ospc.photometry.geometry import along_diagonals, image_of, normalised, pixel_grid, pixels_of
from ospc.photometry.non_radial import DEGREES, non_radial_terms
from ospc.photometry.radial_spline import radial_spline
from ospc.system.atomic import write_atomically

LARGEST_ATTENUATION = 1e3
"""Models that exceed this anywhere in the image are rejected: V is normalised to 1."""
_CENTRE_BINS = 3
"""Number of bins around the centre that normalise a profile: the first one alone has few pixels."""
_MAP_NAME = "vignette.npy"
_MAP_HEADER_BYTES = 4096
"""Largest ``.npy`` header; this and the size of the map limit how much is read."""


class Vignette(Protocol):
    """Attenuation as a function of position, 1 at the centre of the vignette (measured maps: at their maximum)."""

    @property
    def size(self) -> ImageSize:
        """Width and height of the images in pixels."""
        ...

    def at(self, points: npt.ArrayLike) -> FloatArray:
        """Return the attenuation at pixel coordinates (x, y), shape (..., 2) -> (...)."""
        ...

    def image(self) -> Float32Array:
        """Return the attenuation of every pixel, shape (height, width)."""
        ...

    def as_dict(self) -> dict[str, Any]:
        """Return name and parameters as JSON-compatible values."""
        ...


@dataclass(frozen=True)
class VignetteModel:
    """A vignette that is a function of the position relative to the image centre in half diagonals."""

    size: ImageSize
    """Width and height in pixels."""
    coefficients: tuple[float, ...]
    """Coefficients for the radius in half diagonals, measured from ``centre``."""
    centre: tuple[float, float] = (0.0, 0.0)
    """Centre of the vignette relative to the image centre, in half diagonals."""

    _NAME: ClassVar[str]

    def _values(self, x: FloatArray, y: FloatArray) -> FloatArray:
        raise NotImplementedError

    def at(self, points: npt.ArrayLike) -> FloatArray:
        """Return the attenuation at pixel coordinates, shape (..., 2) -> (...)."""
        return self.at_normalised(normalised(np.asarray(points, dtype=np.float64), self.size))

    def at_normalised(self, position: FloatArray) -> FloatArray:
        """Return the attenuation at positions relative to the image centre in half diagonals, (..., 2) -> (...)."""
        return self._values(position[..., 0], position[..., 1])

    def profile(self, radius: npt.ArrayLike) -> FloatArray:
        """Return the mean attenuation along the four half diagonals, at distances from the image centre in them."""
        return np.asarray(self.at_normalised(along_diagonals(radius, self.size)).mean(axis=-1))

    def image(self) -> Float32Array:
        """Return the attenuation of every pixel, shape (height, width)."""
        return image_of(self._values, self.size)

    def moved(self, size: ImageSize, centre: tuple[float, float], unit: float) -> Self:
        """Return the same vignette in images of another size.

        ``centre`` is its centre in them, and ``unit`` is their half diagonal, in half diagonals of the present
        images.
        """
        return replace(self, size=size, centre=centre, coefficients=powers_in_unit(self.coefficients, unit))

    def as_dict(self) -> dict[str, Any]:
        """Return name and parameters as JSON-compatible values, without those that are infinite."""
        stored: dict[str, Any] = {"name": self._NAME}
        for entry in fields(self):
            value = getattr(self, entry.name)
            if value != math.inf:
                stored[entry.name] = list(value) if isinstance(value, tuple) else value
        return stored


@dataclass(frozen=True)
class PolynomialVignette(VignetteModel):
    """V(R) = 1 + v₁R² + v₂R⁴ + v₃R⁶, R in half diagonals (paper, eq. radial, there about the image centre).

    The coefficients are (v₁, v₂, …).
    """

    _NAME = "polynomial"

    def _values(self, x: FloatArray, y: FloatArray) -> FloatArray:
        x, y = x - self.centre[0], y - self.centre[1]
        return np.asarray(np.polynomial.polynomial.polyval(x**2 + y**2, [1.0, *self.coefficients]), dtype=np.float64)


_LARGEST_LOG = 50.0
"""Limit of |ln V| that keeps the exponential finite: a fit to wrong exposures may reach any value."""


@dataclass(frozen=True)
class LogSplineVignette(VignetteModel):
    """ln V about its own centre: a :class:`~ospc.photometry.radial_spline.RadialSpline` plus non-radial terms.

    The coefficients are the slopes d ln V / d(R²) of the spline at its knots. ln V is zero at the centre.
    """

    non_radial: tuple[float, ...] = ()
    """Coefficients of the terms :data:`~ospc.photometry.non_radial.NON_RADIAL`, in this order; empty for none."""
    limit: float = math.inf
    """Distance from ``centre`` in half diagonals beyond which V is unknown, as outside the image circle of a fisheye.
    Beyond, V keeps its value at this distance."""
    reach: float = 1.0
    """Radius of the last knot in half diagonals, measured from ``centre``."""

    _NAME = "log_spline"

    def log_at_normalised(self, position: FloatArray) -> FloatArray:
        """Return ln V at positions relative to the image centre in half diagonals, (..., 2) -> (...)."""
        return self._log_values(position[..., 0], position[..., 1])

    def moved(self, size: ImageSize, centre: tuple[float, float], unit: float) -> Self:
        """Return the same vignette in images of another size; see :meth:`VignetteModel.moved`."""
        return replace(
            self,
            size=size,
            coefficients=tuple(c * unit**2 for c in self.coefficients),
            centre=centre,
            non_radial=tuple(c * unit**degree for c, degree in zip(self.non_radial, DEGREES, strict=False)),
            limit=self.limit / unit,
            reach=self.reach / unit,
        )

    def _values(self, x: FloatArray, y: FloatArray) -> FloatArray:
        return np.asarray(np.exp(np.clip(self._log_values(x, y), -_LARGEST_LOG, _LARGEST_LOG)))

    def _log_values(self, x: FloatArray, y: FloatArray) -> FloatArray:
        x, y = x - self.centre[0], y - self.centre[1]
        squared = x**2 + y**2
        if squared.size and squared.max() > self.limit**2:
            inwards = np.minimum(1.0, self.limit / np.sqrt(np.maximum(squared, 1e-300)))
            x, y, squared = x * inwards, y * inwards, squared * inwards**2
        log_v = radial_spline(len(self.coefficients), self.reach).values(np.array(self.coefficients), squared)
        if self.non_radial:
            log_v = log_v + sum(c * t for c, t in zip(self.non_radial, non_radial_terms(x, y), strict=True))
        return np.asarray(log_v)


def usable_radius_of(vignette: Vignette | None) -> float:
    """Return the usable radius of the images to which a vignette was fitted; 1 if it does not tell."""
    if not isinstance(vignette, LogSplineVignette):
        return 1.0
    return max(0.0, min(1.0, vignette.limit - math.hypot(*vignette.centre)))


def unknown_part_in_words(vignette: Vignette | None) -> str:
    """Return where in the image a vignette is unknown; empty if nowhere."""
    if not isinstance(vignette, LogSplineVignette):
        return ""
    corners = along_diagonals(1.0, vignette.size) - vignette.centre
    if np.linalg.norm(corners, axis=-1).max() <= vignette.limit:
        return ""
    return (
        f"beyond {vignette.limit:.2f} half diagonals from its centre, the vignette is unknown and taken as constant"
    )


def powers_in_unit(coefficients: tuple[float, ...], unit: float) -> tuple[float, ...]:
    """Return coefficients of R², R⁴, … for a unit of radius that is ``unit`` times as long."""
    return tuple(c * unit ** (2 * n) for n, c in enumerate(coefficients, start=1))


@dataclass(frozen=True, eq=False)
class RasterVignette(ByValue):
    """A measured vignette with one value per pixel."""

    values: Float32Array
    """Attenuation, shape (height, width), in (0, 1]; divided by its maximum on construction."""
    source: dict[str, Any] = field(default_factory=dict)
    """Origin of the map, as JSON-compatible values."""

    def __post_init__(self) -> None:
        """Normalise and freeze the values."""
        values = np.array(self.values, dtype=np.float32)
        if values.ndim != 2 or values.size == 0:
            raise FormatError(
                f"a vignette map must have one value per pixel in two dimensions, not shape {values.shape}"
            )
        if not np.all(np.isfinite(values)) or values.min() < 0 or values.max() <= 0:
            raise FormatError("the values of a vignette map must be finite, not negative, and not all zero")
        values /= values.max()
        object.__setattr__(self, "values", read_only(values))

    @property
    def size(self) -> ImageSize:
        """Width and height in pixels."""
        return self.values.shape[1], self.values.shape[0]

    def at(self, points: npt.ArrayLike) -> FloatArray:
        """Return the attenuation at pixel coordinates, interpolated bilinearly, shape (..., 2) -> (...)."""
        from scipy.ndimage import map_coordinates  # slow to import and rarely needed

        xy = np.asarray(points, dtype=np.float64)
        x, y = xy.reshape(-1, 2).T
        sampled = map_coordinates(self.values, (y, x), np.float64, order=1, mode="nearest")
        return np.asarray(sampled, dtype=np.float64).reshape(xy.shape[:-1])

    def image(self) -> Float32Array:
        """Return the attenuation of every pixel, shape (height, width)."""
        return self.values

    def as_dict(self) -> dict[str, Any]:
        """Return the size and the source; :meth:`write_map` writes the values."""
        return {"name": "raster", "size": list(self.size), "source": self.source}

    def write_map(self, path: str | Path) -> None:
        """Write the values to an ``.npz`` file atomically."""
        packed = io.BytesIO()
        np.savez_compressed(packed, vignette=self.values)
        write_atomically(path, packed.getvalue())

    @classmethod
    def read_map(cls, path: str | Path, size: ImageSize, source: dict[str, Any]) -> RasterVignette:
        """Read a map written by :meth:`write_map`; FormatError if it cannot be read or has another size."""
        try:
            with zipfile.ZipFile(path) as archive:
                stored = archive.getinfo(_MAP_NAME)
                if stored.file_size > _MAP_HEADER_BYTES + 8 * size[0] * size[1]:
                    raise FormatError(f"{path}: larger than a vignette map of {size[0]}×{size[1]} pixels")
                with archive.open(stored) as file:
                    values = np.lib.format.read_array(file, allow_pickle=False)
        except (OSError, *UNREADABLE) as error:
            raise FormatError(f"{path}: the vignette map cannot be read ({error})") from None
        if values.shape != (size[1], size[0]) or values.dtype.kind != "f":
            raise FormatError(f"{path}: not a vignette map of {size[0]}×{size[1]} pixels")
        return cls(values, source)


def diagonal_profile(vignette: Vignette, radii: FloatArray) -> FloatArray:
    """Return the mean of :func:`half_diagonal_profiles`, shape (radii,) -> (radii,)."""
    return np.asarray(half_diagonal_profiles(vignette, radii).mean(axis=1))


def half_diagonal_profiles(vignette: Vignette, radii: FloatArray) -> FloatArray:
    """Return V along each of the four half diagonals, relative to V at the image centre.

    ``radii`` are distances from the image centre in half diagonals, shape (radii,) -> (radii, 4).
    """
    size = vignette.size
    centre = float(vignette.at(pixels_of(np.zeros(2), size)))
    values = vignette.at(pixels_of(along_diagonals(radii, size), size))
    return np.asarray(values / centre if centre > 0 else values)


def radial_profile(vignette: Vignette, bins: int = 50) -> FloatArray:
    """Return the mean of V in equal bins of R in [0, 1], divided by the mean of the innermost three, shape (bins,).

    Bins without pixels are NaN.
    """
    size = vignette.size
    radius = np.linalg.norm(normalised(pixel_grid(size), size), axis=-1).ravel()
    index = np.minimum((radius * bins).astype(np.int64), bins - 1)
    count = np.bincount(index, minlength=bins).astype(np.float64)
    total = np.bincount(index, weights=vignette.image().ravel().astype(np.float64), minlength=bins)
    with np.errstate(invalid="ignore"):
        profile = total / np.where(count > 0, count, np.nan)
    return np.asarray(profile / profile[count > 0][:_CENTRE_BINS].mean())
