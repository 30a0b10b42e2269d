"""ln V as a sum of terms, each of which is zero at the vignette's centre."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ospc.arrays import FloatArray, ImageSize
from ospc.estimation.bends import sharpest_bend
from ospc.observations import Observations
from ospc.photometry.non_radial import NON_RADIAL, non_radial_terms, slope_of_non_radial
from ospc.photometry.radial_spline import RadialSpline, radial_spline
from ospc.photometry.vignette import LogSplineVignette
from ospc.settings.fit import MAX_DECENTRING, MAX_UNSEEN_FALL, UNRESOLVED_JUMP, UNSEEN_CHANGE, UNSEEN_OBSERVATIONS
from ospc.settings.vignette import VIGNETTE_REACH, VIGNETTE_REACH_STEP


@dataclass(frozen=True)
class VignetteBasis:
    """A radial spline of ln V in R², optionally about a free centre and with non-radial terms.

    The parameters are the slopes d ln V / d(R²) at a number of knots, the free centre, in which ln V is not linear,
    and the coefficients of the terms :data:`~ospc.photometry.non_radial.NON_RADIAL`. The usable radius, in half
    diagonals, is the radius that the image reaches, and ``reach`` is the radius of the last knot in usable radii.
    """

    radial: int
    free_centre: bool = False
    non_radial: bool = False
    usable_radius: float = 1.0
    reach: float = VIGNETTE_REACH

    def __len__(self) -> int:
        """Return the number of parameters."""
        return self.radial + 2 * self.free_centre + len(NON_RADIAL) * self.non_radial

    @property
    def names(self) -> list[str]:
        """Names of the parameters."""
        names = [f"slope({radius:.4f})" for radius in np.sqrt(self.spline.knots)]
        names += ["centre_x", "centre_y"] if self.free_centre else []
        return names + (list(NON_RADIAL) if self.non_radial else [])

    @property
    def centre_part(self) -> slice:
        """Slice of the centre; empty if it is not free."""
        return slice(self.radial, self.radial + 2 * self.free_centre)

    @property
    def spline(self) -> RadialSpline:
        """The radial part."""
        return radial_spline(self.radial, self.reach * self.usable_radius)

    def reach_of_far_corner(self, parameters: FloatArray) -> float:
        """Return the reach with which the last knot is as far from the centre as any corner of the image, or more."""
        farthest = 1 + float(np.hypot(*self.centre(parameters))) / self.usable_radius
        steps = max(np.ceil((farthest - VIGNETTE_REACH) / VIGNETTE_REACH_STEP), 0.0)
        return float(VIGNETTE_REACH + steps * VIGNETTE_REACH_STEP)

    def conversion(self, other: VignetteBasis) -> FloatArray:
        """Return the matrix that converts the parameters of another basis to this one, shape (len, len of other).

        The slopes are taken at this basis's knots. What this basis lacks is dropped.
        """
        matrix = np.zeros((len(self), len(other)))
        matrix[: self.radial, : other.radial] = other.spline.slopes_at(self.spline.knots)
        if self.free_centre and other.free_centre:
            matrix[self.centre_part, other.centre_part] = np.eye(2)
        if self.non_radial and other.non_radial:
            matrix[-len(NON_RADIAL) :, -len(NON_RADIAL) :] = np.eye(len(NON_RADIAL))
        return matrix

    def log_value(self, parameters: FloatArray, position: FloatArray) -> FloatArray:
        """Return ln V at positions in half diagonals from the image centre, shape (n, 2) -> (n,)."""
        return self.vignette(parameters, (1, 1)).log_at_normalised(position)

    def jacobian(self, parameters: FloatArray, position: FloatArray) -> FloatArray:
        """Return the derivative of ln V with respect to the parameters, shape (n, 2) -> (n, len)."""
        offset, spline = position - self.centre(parameters), self.spline
        squared = np.einsum("ij,ij->i", offset, offset)
        columns = [spline.jacobian(squared)]
        if self.free_centre:
            slope = spline.slope(parameters[: self.radial], squared)
            by_centre = -2 * offset * slope[:, None]
            if self.non_radial:
                by_centre -= slope_of_non_radial(parameters[-len(NON_RADIAL) :], offset)
            columns.append(by_centre)
        if self.non_radial:
            columns.append(np.stack(non_radial_terms(*offset.T), axis=1))
        return np.concatenate(columns, axis=1) if len(columns) > 1 else columns[0]

    def remainder(self, parameters: FloatArray, position: FloatArray, jacobian: FloatArray) -> FloatArray:
        """Return ln V minus its linear part, shape (n,), given :meth:`jacobian`: ln V is not linear in the centre."""
        if not self.free_centre:
            return np.zeros(len(position))
        return np.asarray(self.log_value(parameters, position) - jacobian @ parameters)

    def unresolved(self, parameters: FloatArray, position: FloatArray) -> FloatArray:
        """Return the standard deviation of ln V that the basis cannot follow, shape (n, 2) -> (n,).

        The slope of ln V may jump between knots. Beyond the last one it is constant, but may go on to change at the
        rate before.
        """
        squared, spline = np.sum((position - self.centre(parameters)) ** 2, axis=1), self.spline
        bend = sharpest_bend(parameters[: self.radial], spline.knots, squared)
        between = UNRESOLVED_JUMP * bend * np.minimum(squared, spline.width_at(squared))
        beyond = np.maximum(squared - spline.reach**2, 0.0)
        return np.asarray(np.hypot(between, self._rate_before(parameters, spline.reach) * beyond**2 / 2))

    def unseen(self, parameters: FloatArray, radius: float) -> FloatArray:
        """Return the covariance of the parameters due to bends beyond the last observations, shape (len, len).

        Nothing shows what the slope of ln V does beyond that radius, a distance from the vignette's centre. Its rate
        of change there may differ by a share of the largest one in the last two intervals between knots before. The
        error of ln V then grows with the square of the distance in R². If V falls so steeply that it would reach zero
        soon, the rate increases on the way there: if V is linear in R², its slope is proportional to 1/V.
        """
        change = np.zeros(len(self))
        distance = np.maximum(self.spline.knots - radius**2, 0.0)
        slope = self.spline.slope(parameters[: self.radial], np.array([radius**2]))
        fallen = np.clip(-slope * distance, 0.0, MAX_UNSEEN_FALL)
        share = np.maximum(fallen / (1 - fallen), UNSEEN_CHANGE)
        change[: self.radial] = share * self._rate_before(parameters, radius) * distance
        return np.outer(change, change)

    def _rate_before(self, parameters: FloatArray, radius: float) -> float:
        """Return the largest rate of change of the slope of ln V in the last two intervals of knots to a radius."""
        if self.radial < 2:
            return 0.0
        knots = self.spline.knots
        rates = np.abs(np.diff(parameters[: self.radial]) / np.diff(knots))
        end = int(np.clip(np.searchsorted(knots, radius**2), 1, len(rates)))
        return float(rates[max(end - 2, 0) : end].max())

    def centre(self, parameters: FloatArray) -> FloatArray:
        """Return the centre of the vignette relative to the image centre, in half diagonals, shape (2,)."""
        return parameters[self.centre_part] if self.free_centre else np.zeros(2)

    def limited(self, parameters: FloatArray) -> FloatArray:
        """Return the parameters with the centre kept well within the image, shape (len,)."""
        within = parameters.copy()
        within[self.centre_part] = np.clip(within[self.centre_part], -MAX_DECENTRING, MAX_DECENTRING)
        return within

    def usable_vignette(self, parameters: FloatArray, size: ImageSize) -> LogSplineVignette:
        """Return the vignette for an image size; beyond the usable radius it is constant."""
        model = self.vignette(parameters, size)
        if self.usable_radius >= 1:
            return model
        return replace(model, limit=self.usable_radius + float(np.hypot(*model.centre)))

    def vignette(self, parameters: FloatArray, size: ImageSize) -> LogSplineVignette:
        """Return the vignette for an image size; beyond the usable radius it is extrapolated."""
        non_radial = parameters[len(self) - len(NON_RADIAL) :].tolist() if self.non_radial else ()
        x, y = self.centre(parameters).tolist()
        slopes = tuple(parameters[: self.radial].tolist())
        return LogSplineVignette(size, slopes, (x, y), tuple(non_radial), reach=self.spline.reach)


def measured_radius(observations: Observations, centre: FloatArray) -> float:
    """Return the distance from a centre, shape (2,), beyond which there are hardly any observations; 0 for a few."""
    if len(observations) < UNSEEN_OBSERVATIONS:
        return 0.0
    squared = np.sum((observations.position - centre) ** 2, axis=1)
    return float(np.sqrt(np.partition(squared, -UNSEEN_OBSERVATIONS)[-UNSEEN_OBSERVATIONS]))
