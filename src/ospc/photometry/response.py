"""The camera response f and its inverse g."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ospc.arrays import BoolArray, ByValue, FloatArray, number_of, numbers_of, read_only
from ospc.errors import FormatError, SettingError

_END_TOLERANCE = 1e-9
"""Largest deviation of g(0) from 0 and of g(1) from 1: the rounding in files with ten digits."""


@dataclass(frozen=True, eq=False)
class Response(ByValue):
    """Camera response with a strictly increasing inverse, g(0) = 0 and g(1) = 1.

    ``M = f(e V L)`` maps irradiance to grey level, and ``g = f⁻¹`` is estimated; figures in the literature call it
    "CRF". Both map [0, 1] to [0, 1].

    The scale of g is not observable: g(1) = 1 is a convention, and few recordings have data close to white. Therefore
    two uncertainties are distinguished: that of the shape, relative to a well-known grey level near the middle of the
    measured range, and that of the scale of the entire curve under this convention.

    Attributes
    ----------
    inverse_table
        g at the grey levels i/(n-1), shape (n,), strictly increasing from 0 to 1.
    log_sigma
        Standard deviation of ln g(M)/g(reference_grey) at the same levels, shape (n,); None if unknown.
    scale_sigma
        Standard deviation of ln g(reference_grey), given g(1) = 1; None if unknown.
    support
        Lowest and highest measured grey level in [0, 1]. Outside, the curve follows the prior.
    model
        Name and parameters of the model behind the table, as JSON-compatible values.
    reference_grey
        Grey level in [0, 1] that the uncertainty is relative to; by default the middle of the measured range.
    """

    inverse_table: FloatArray = field(repr=False)
    log_sigma: FloatArray | None = field(default=None, repr=False)
    scale_sigma: float | None = None
    support: tuple[float, float] = (0.0, 1.0)
    model: dict[str, Any] = field(default_factory=dict, repr=False)
    reference_grey: float = math.nan

    def __post_init__(self) -> None:
        """Check and freeze the table."""
        numbers = numbers_of(self.inverse_table)
        if numbers is None:
            raise FormatError("an inverse response must consist of numbers")
        table = read_only(numbers)
        if table.ndim != 1 or table.size < 2:
            raise FormatError(
                f"an inverse response needs at least 2 values in one dimension, not shape {table.shape}"
            )
        if not np.all(np.isfinite(table)):
            raise FormatError("an inverse response must be finite everywhere")
        if not np.all(np.diff(table) > 0):
            worst = int(np.argmin(np.diff(table)))
            raise FormatError(f"an inverse response must strictly increase; it does not after grey level {worst}")
        if abs(table[0]) > _END_TOLERANCE or abs(table[-1] - 1) > _END_TOLERANCE:
            raise FormatError(
                "an inverse response must begin at 0 and end at 1; use Response.from_values to normalise it"
            )
        object.__setattr__(self, "inverse_table", table)
        low, high = self.support
        if not 0 <= low <= high <= 1:
            raise FormatError(f"support is {low} to {high}; it must lie in [0, 1], lowest first")
        if math.isnan(self.reference_grey):
            object.__setattr__(self, "reference_grey", sum(self.support) / 2)
        if not 0 < self.reference_grey <= 1:
            raise FormatError(f"the reference grey level is {self.reference_grey}; it must be above 0, at most 1")
        if self.log_sigma is not None:
            sigma = read_only(np.array(self.log_sigma, dtype=np.float64))
            if sigma.shape != table.shape:
                raise FormatError(f"log_sigma has shape {sigma.shape}, the response {table.shape}")
            object.__setattr__(self, "log_sigma", sigma)

    @classmethod
    def from_values(cls, values: npt.ArrayLike, **attributes: Any) -> Response:
        """Return the response with these values of the inverse response.

        Parameters
        ----------
        values
            Inverse response g at equidistant grey levels, in any scale, shape (n,). It is shifted and scaled to the
            range from 0 to 1.
        **attributes
            Other attributes of the class.

        Raises
        ------
        FormatError
            If the values are not finite or do not strictly increase.
        """
        array = numbers_of(values)
        if array is None:
            raise FormatError("the values of a response must be numbers")
        if array.ndim == 1 and array.size >= 2 and array[-1] > array[0]:
            array = (array - array[0]) / (array[-1] - array[0])
            array[-1] = 1.0
        return cls(array, **attributes)

    @property
    def white(self) -> float:
        """Grey level in [0, 1] from which pixels are saturated: below 1 for a limited range of grey values."""
        stated = self.model.get("grey_range", ())
        limits = stated if isinstance(stated, list | tuple) else ()
        level = limits[1] if len(limits) == 2 else 1.0
        return float(level) if isinstance(level, int | float) and 0 < level < 1 else 1.0

    @classmethod
    def gamma(cls, exponent: float, levels: int = 256) -> Response:
        """Return the response with the inverse g(M) = M**exponent.

        Parameters
        ----------
        exponent
            Positive; 2.2 for a typical gamma curve, 1 for a linear camera.
        levels
            Number of grey levels in the table.

        Raises
        ------
        SettingError
            If the exponent is not a positive number, or so large or small that values of the table are equal.
        """
        power = number_of(exponent)
        if power is None or not 0 < power < math.inf:
            raise SettingError(f"the exponent is {exponent!r}; give a positive number")
        table = np.linspace(0, 1, levels) ** power
        if not np.all(np.diff(table) > 0):
            raise SettingError(f"the exponent is {exponent!r}; give one for which all {levels} values differ")
        return cls(table, model={"name": "gamma", "exponent": power})

    @property
    def inverse_sigma(self) -> FloatArray | None:
        """Standard deviation of g at the levels of the table for a fixed scale, shape (n,); None if unknown."""
        return None if self.log_sigma is None else self.inverse_table * self.log_sigma

    @property
    def levels(self) -> FloatArray:
        """Grey levels of the table in [0, 1], shape (n,)."""
        return np.linspace(0.0, 1.0, self.inverse_table.size)

    @property
    def measured(self) -> BoolArray:
        """Which levels of the table are within the measured range, shape (n,)."""
        low, high = self.support
        return np.asarray((self.levels >= low) & (self.levels <= high))

    def __call__(self, irradiance: npt.ArrayLike) -> FloatArray:
        """Return the grey levels f in [0, 1] of irradiances, in the same shape; irradiances are clipped to [0, 1]."""
        return np.interp(np.asarray(irradiance, dtype=np.float64), self.inverse_table, self.levels)

    def inverse(self, grey: npt.ArrayLike) -> FloatArray:
        """Return the irradiances g in [0, 1] of grey levels, in the same shape; grey levels are clipped to [0, 1].

        Raises
        ------
        SettingError
            If ``grey`` has integers above 1, such as the grey values of an 8-bit image.
        """
        levels = np.asarray(grey)
        if levels.dtype.kind in "iu" and levels.max(initial=0) > 1:
            raise SettingError("grey levels must be in [0, 1]; divide grey values by the largest possible value")
        return np.interp(levels.astype(np.float64), self.levels, self.inverse_table)

    def with_uncertain_exponent(self, sigma: float) -> Response:
        """Return the response with larger bands, because ln of an exponent of it has this standard deviation."""
        log_g = np.log(np.maximum(self.inverse_table, np.finfo(np.float64).tiny))
        log_reference = np.log(self.inverse(self.reference_grey))
        return replace(
            self,
            log_sigma=np.hypot(0.0 if self.log_sigma is None else self.log_sigma, sigma * (log_g - log_reference)),
            scale_sigma=float(np.hypot(self.scale_sigma or 0.0, sigma * log_reference)),
        )

    def matched(self, other: Response) -> FloatArray:
        """Return g of another response at the levels of this table, scaled to agree at the reference grey.

        The remaining difference is one of shape, which is observable. The result has shape (n,).
        """
        return np.asarray(other.inverse(self.levels) * other.scale_to(self))

    def scale_to(self, other: Response) -> float:
        """Return the factor by which g of this response agrees with another one at the other's reference grey."""
        return float(other.inverse(other.reference_grey) / self.inverse(other.reference_grey))

    def resampled(self, levels: int) -> FloatArray:
        """Return g at ``levels`` equidistant grey levels from 0 to 1, shape (levels,)."""
        return self.inverse(np.linspace(0.0, 1.0, levels))
