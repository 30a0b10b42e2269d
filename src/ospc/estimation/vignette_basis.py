"""ln V as a sum of terms, each of which is zero at the vignette's centre."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ospc.arrays import FloatArray, ImageSize
from ospc.photometry.vignette import NON_RADIAL, LogVignette, non_radial_terms
from ospc.settings.estimation import (
    CENTRE_SIGMA,
    DARK_RADIUS,
    MAX_DECENTRING,
    NON_RADIAL_SIGMA,
    VIGNETTE_SIGMA,
)


@dataclass(frozen=True)
class VignetteBasis:
    """A number of radial terms R², R⁴, …, optionally about a free centre and with non-radial terms.

    A free centre adds two parameters, in which ln V is not linear; the non-radial terms are those of
    :data:`~ospc.photometry.vignette.NON_RADIAL`. The usable radius, in half diagonals, is the radius that the image
    reaches.
    """

    radial: int
    free_centre: bool = False
    non_radial: bool = False
    usable_radius: float = 1.0

    def __len__(self) -> int:
        """Return the number of parameters."""
        return self.radial + 2 * self.free_centre + len(NON_RADIAL) * self.non_radial

    @property
    def prior_sigma(self) -> FloatArray:
        """Prior standard deviation of each parameter about zero, shape (len,).

        For the radial terms it decreases like the coefficients of ln(1 − R²/D²), where D is the radius at which V may
        reach zero, so that a few samples do not determine the corners through high orders.
        """
        order = np.arange(1, self.radial + 1)
        radial = VIGNETTE_SIGMA / (order * (DARK_RADIUS * self.usable_radius) ** (2.0 * (order - 1)))
        further = [CENTRE_SIGMA] * (2 * self.free_centre) + [NON_RADIAL_SIGMA] * (len(NON_RADIAL) * self.non_radial)
        return np.concatenate([radial, further])

    @property
    def names(self) -> list[str]:
        """Names of the parameters."""
        names = [f"a{i + 1}" for i in range(self.radial)]
        names += ["centre_x", "centre_y"] if self.free_centre else []
        return names + (list(NON_RADIAL) if self.non_radial else [])

    def log_value(self, parameters: FloatArray, position: FloatArray) -> FloatArray:
        """Return ln V at positions in half diagonals from the image centre, shape (n, 2) -> (n,)."""
        return self._model(parameters, (1, 1)).log_at_normalised(position)

    def jacobian(self, parameters: FloatArray, position: FloatArray) -> FloatArray:
        """Return the derivative of ln V by the parameters, shape (n, 2) -> (n, len)."""
        offset = position - self.centre(parameters)
        squared, order = np.sum(offset**2, axis=1), np.arange(1, self.radial + 1)
        columns = [squared[:, None] ** order]
        if self.free_centre:
            by_squared = (squared[:, None] ** (order - 1)) @ (order * parameters[: self.radial])
            columns.append(-2 * offset * by_squared[:, None] - self._slope_of_non_radial(parameters, offset))
        if self.non_radial:
            columns.append(np.stack(non_radial_terms(*offset.T), axis=1))
        return np.concatenate(columns, axis=1)

    def _slope_of_non_radial(self, parameters: FloatArray, offset: FloatArray) -> FloatArray:
        """Return the derivative of the non-radial part by the offset from the centre, shape (n, 2)."""
        if not self.non_radial:
            return np.zeros_like(offset)
        tilt_x, tilt_y, saddle, ellipse, slope_x, slope_y = parameters[-len(NON_RADIAL) :]
        x, y = offset.T
        by_x = tilt_x + saddle * y + 2 * ellipse * x + slope_x * (3 * x**2 + y**2) + 2 * slope_y * x * y
        by_y = tilt_y + saddle * x - 2 * ellipse * y + 2 * slope_x * x * y + slope_y * (x**2 + 3 * y**2)
        return np.stack([by_x, by_y], axis=1)

    def centre(self, parameters: FloatArray) -> FloatArray:
        """Return the centre of the vignette relative to the image centre, in half diagonals, shape (2,)."""
        return parameters[self.radial : self.radial + 2] if self.free_centre else np.zeros(2)

    def limited(self, parameters: FloatArray) -> FloatArray:
        """Return the parameters with the centre kept well within the image, shape (len,)."""
        centre = slice(self.radial, self.radial + 2 * self.free_centre)
        within = parameters.copy()
        within[centre] = np.clip(within[centre], -MAX_DECENTRING, MAX_DECENTRING)
        return within

    def vignette(self, parameters: FloatArray, size: ImageSize, usable_radius: float = 1.0) -> LogVignette:
        """Return the vignette for an image size; beyond the usable radius it is constant."""
        model = self._model(parameters, size)
        if usable_radius >= 1:
            return model
        return replace(model, limit=usable_radius + float(np.hypot(*model.centre)))

    def _model(self, parameters: FloatArray, size: ImageSize) -> LogVignette:
        non_radial = parameters[len(self) - len(NON_RADIAL) :].tolist() if self.non_radial else ()
        x, y = self.centre(parameters).tolist()
        return LogVignette(size, tuple(parameters[: self.radial].tolist()), (x, y), tuple(non_radial))
