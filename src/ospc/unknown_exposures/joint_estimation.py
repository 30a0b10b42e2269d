"""Joint estimation of response, vignette and exposures from images alone (Bergmann, Wang, Cremers 2018).

Scene points p are tracked through frames i. Their grey levels O are modelled as O = f(eᵢ V(xᵢᵖ) Lᵖ), with f from the
empirical model of response, V = 1 + v₁R² + v₂R⁴ + v₃R⁶, and free e and L. Non-linear least squares alternates between
Gauss-Newton steps in (c, v, e) with fixed radiances, and steps in the radiances with the rest fixed. Residuals at
steep image gradients have less weight, and a Huber loss bounds the influence of outliers.

The result explains the data equally well after g → g^γ, V → V^γ, e → e^γ for any γ. One known point of the true
response fixes γ, see :meth:`JointEstimate.aligned_to`. Without it, γ stays close to its initial value.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ospc.arrays import FloatArray, ImageSize, IntArray
from ospc.errors import NotObservableError, counted
from ospc.numerics.robust import huber_weights
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette, RasterVignette, Vignette
from ospc.settings.unknown_exposures import (
    DAMPING_DOWN,
    DAMPING_UP,
    JOINT_ALTERNATIONS,
    JOINT_HUBER,
    JOINT_TOLERANCE,
    MAX_DAMPED_ATTEMPTS,
    MAX_JOINT_LOG,
    MAX_JOINT_STEP,
    MAX_SOLVER_STEPS,
    MIN_DAMPING,
    MIN_JOINT_OBSERVATIONS,
    MIN_JOINT_VIGNETTE,
    MIN_START_IRRADIANCE,
    RESPONSE_COMPONENTS,
    RESPONSE_SAMPLES,
    SOLVER_TOLERANCE,
    START_DAMPING,
)
from ospc.unknown_exposures.response_model import learned_model
from ospc.unknown_exposures.tracking import TrackObservations

_RADIAL = 2 * np.arange(1, 4)
"""Powers of R in the vignette, as in the paper: R², R⁴ and R⁶."""


@dataclass(frozen=True)
class JointEstimate:
    """The result of joint estimation, known up to one exponent.

    Response, vignette and exposures are raised to the power γ, ``exponent``. Before that, ``coefficients`` are the c
    of the response model, shape (n,), ``radial`` is the v of the vignette, shape (3,), and ``log_exposures`` are the
    ln e, with mean 0, of the frames with the indices ``frames``, shape (m,). ``cost`` is the weighted mean Huber loss
    of the residuals.
    """

    size: ImageSize
    coefficients: FloatArray
    radial: FloatArray
    frames: IntArray
    log_exposures: FloatArray
    exponent: float = 1.0
    cost: float = 0.0

    @property
    def response(self) -> Response:
        """The response, raised to the exponent."""
        found = learned_model().response(self.coefficients)
        if self.exponent == 1.0:
            return found
        powered = found.inverse_table**self.exponent
        # The ramp keeps the curve strictly increasing where the power makes it flat.
        return Response.from_values(powered + np.linspace(0, 1e-9, powered.size), model={"name": "joint"})

    @property
    def vignette(self) -> Vignette:
        """The vignette, raised to the exponent."""
        found = PolynomialVignette(self.size, tuple(self.radial.tolist()))
        if self.exponent == 1.0 and found.profile(1.0) > MIN_JOINT_VIGNETTE:
            return found
        image = np.maximum(found.image(), MIN_JOINT_VIGNETTE) ** np.float32(self.exponent)
        return RasterVignette(image, {"name": "joint", "exponent": self.exponent})

    @property
    def exposures(self) -> FloatArray:
        """Exposures up to a factor, raised to the exponent, shape (m,)."""
        return np.asarray(np.exp(self.exponent * self.log_exposures))

    def aligned_to(self, truth: Response) -> JointEstimate:
        """Return the estimate with the exponent for which g(½) equals the true value."""
        found = float(learned_model().response(self.coefficients).inverse(0.5))
        return replace(self, exponent=float(np.log(truth.inverse(0.5)) / np.log(found)))


def estimate_jointly(
    tracks: TrackObservations, start: JointEstimate | None = None, iterations: int = JOINT_ALTERNATIONS
) -> JointEstimate:
    """Return the response, vignette and exposures that fit the observations best.

    The optimisation starts from ``start``, or from the mean response, no vignette and equal exposures, and alternates
    at most ``iterations`` times.

    Raises
    ------
    NotObservableError
        If there are too few observations.
    """
    if tracks.grey.size < MIN_JOINT_OBSERVATIONS or tracks.frames.size < 2:
        raise NotObservableError(
            f"joint estimation has {counted(tracks.grey.size, 'observation')} in "
            f"{counted(tracks.frames.size, 'frame')}; it needs {MIN_JOINT_OBSERVATIONS} in at least two frames"
        )
    c, v, log_e = np.zeros(RESPONSE_COMPONENTS), np.zeros(3), np.zeros(tracks.frames.size)
    if start is not None:
        c, v = start.coefficients.copy(), start.radial.copy()
        log_e = np.interp(tracks.frames, start.frames, start.log_exposures)
    problem = _Problem(tracks, c, v, log_e)
    cost = np.inf
    for _ in range(iterations):
        problem.fit_parameters()
        problem.fit_radiances()
        before, cost = cost, problem.cost()
        if np.isfinite(before) and before - cost < JOINT_TOLERANCE * before:
            break
    return problem.estimate(cost)


class _Problem:
    """The state of the alternation; arrays have one entry per observation unless stated otherwise."""

    def __init__(self, tracks: TrackObservations, c: FloatArray, v: FloatArray, log_e: FloatArray) -> None:
        self._tracks, self._model = tracks, learned_model()
        self._c, self._v = c, v
        self._radial = tracks.radius[:, None] ** _RADIAL
        self._points = int(tracks.point.max()) + 1
        irradiance = np.interp(tracks.grey, self._model.curve(c), np.linspace(0, 1, RESPONSE_SAMPLES))
        first_log = np.log(np.maximum(irradiance, MIN_START_IRRADIANCE)) - np.log(self._attenuation(v))
        self._log_e, self._log_l = _first_exposures(tracks, first_log, log_e)
        self._damping = START_DAMPING
        self._centre()

    def estimate(self, cost: float) -> JointEstimate:
        """Return the current state as a result."""
        size, frames, log_e = self._tracks.size, self._tracks.frames, self._log_e - self._log_e.mean()
        return JointEstimate(size, self._c, self._v, frames, log_e, cost=cost)

    def cost(self) -> float:
        """Return the weighted mean Huber loss of the residuals."""
        return self._cost_of(self._c, self._v, self._log_e)

    def fit_parameters(self) -> None:
        """Take one damped Gauss-Newton step in response, vignette and exposures."""
        tracks = self._tracks
        x, residual, slope, weight = self._linearised()
        attenuation = self._attenuation(self._v)
        inner = np.column_stack([self._at(self._model.components, x), (slope / attenuation)[:, None] * self._radial])
        a = (inner * weight[:, None]).T @ inner

        def by_frame(values: FloatArray) -> FloatArray:
            sums = np.bincount(tracks.frame, weights=values, minlength=self._log_e.size)
            return np.asarray(sums, dtype=np.float64)

        b = np.stack([by_frame(weight * slope * column) for column in inner.T])
        d = by_frame(weight * slope**2)
        rhs, rhs_e = inner.T @ (weight * residual), by_frame(weight * slope * residual)
        before = self.cost()
        for _ in range(MAX_DAMPED_ATTEMPTS):
            d_damped = d * (1 + self._damping) + 1e-9
            reduced = a + np.diag(np.diag(a) * self._damping + 1e-9) - (b / d_damped) @ b.T
            step = np.linalg.lstsq(reduced, rhs - (b / d_damped) @ rhs_e, rcond=None)[0]
            step_e = np.clip((rhs_e - step @ b) / d_damped, -MAX_JOINT_STEP, MAX_JOINT_STEP)
            c, v = self._c + step[: self._c.size], self._v + step[self._c.size :]
            log_e = self._log_e + step_e
            if self._cost_of(c, v, log_e) < before:
                self._c, self._v, self._log_e = c, v, log_e
                self._damping = max(self._damping / DAMPING_DOWN, MIN_DAMPING)
                return
            self._damping *= DAMPING_UP

    def fit_radiances(self) -> None:
        """Take one Gauss-Newton step in the radiance of every point."""
        _, residual, slope, weight = self._linearised()
        top = np.bincount(self._tracks.point, weights=weight * slope * residual, minlength=self._points)
        bottom = np.bincount(self._tracks.point, weights=weight * slope**2, minlength=self._points)
        self._log_l = self._log_l + np.clip(top / (bottom * (1 + 1e-6) + 1e-9), -MAX_JOINT_STEP, MAX_JOINT_STEP)
        self._centre()

    def _linearised(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return irradiance, residual O − f, the derivative of f with respect to ln irradiance, and weight."""
        x = self._irradiance(self._v, self._log_e)
        curve = self._model.curve(self._c)
        residual = self._tracks.grey - self._at(curve[None], x)[:, 0]
        slope = self._at(np.gradient(curve, 1 / (RESPONSE_SAMPLES - 1))[None], x)[:, 0] * x
        weight = self._tracks.weight * huber_weights(residual, JOINT_HUBER)
        return x, residual, np.where(x < 1, slope, 0.0), weight

    def _attenuation(self, v: FloatArray) -> FloatArray:
        return np.maximum(1 + self._radial @ v, MIN_JOINT_VIGNETTE)

    def _irradiance(self, v: FloatArray, log_e: FloatArray) -> FloatArray:
        log_x = np.log(self._attenuation(v)) + log_e[self._tracks.frame] + self._log_l[self._tracks.point]
        return np.asarray(np.exp(np.clip(log_x, -MAX_JOINT_LOG, MAX_JOINT_LOG)))

    def _cost_of(self, c: FloatArray, v: FloatArray, log_e: FloatArray) -> float:
        x = self._irradiance(v, log_e)
        residual = np.abs(self._tracks.grey - self._at(self._model.curve(c)[None], x)[:, 0])
        robust = np.where(residual < JOINT_HUBER, residual**2, 2 * JOINT_HUBER * residual - JOINT_HUBER**2)
        return float(np.average(robust, weights=self._tracks.weight))

    def _centre(self) -> None:
        """Move the mean exposure into the radiances, because their common factor is not observable."""
        mean = float(self._log_e.mean())
        self._log_e, self._log_l = self._log_e - mean, self._log_l + mean

    @staticmethod
    def _at(curves: FloatArray, x: FloatArray) -> FloatArray:
        """Interpolate curves, given at equidistant irradiances, at x, shape (m, 1024), (n,) -> (n, m)."""
        place = np.clip(x, 0, 1) * (RESPONSE_SAMPLES - 1)
        low = np.minimum(place.astype(np.int64), RESPONSE_SAMPLES - 2)
        share = (place - low)[:, None]
        table = curves.T
        return np.asarray(table[low] * (1 - share) + table[low + 1] * share)


def _first_exposures(
    tracks: TrackObservations, log_irradiance: FloatArray, start: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the ln e of frames and ln L of points whose sums fit observed ln irradiances best."""
    # The alternation propagates a change of exposure only slowly along a chain of tracks; this linear system does so
    # at once. Bergmann et al. solve it from frame to frame.
    from scipy.sparse import csr_matrix  # slow to import and rarely needed
    from scipy.sparse.linalg import lsqr

    frames, points = tracks.frames.size, int(tracks.point.max()) + 1
    weight = np.sqrt(tracks.weight)
    columns = np.concatenate([tracks.frame, frames + tracks.point])
    matrix = csr_matrix(
        (np.tile(weight, 2), (np.tile(np.arange(weight.size), 2), columns)), shape=(weight.size, frames + points)
    )
    found = lsqr(
        matrix,
        weight * log_irradiance,
        atol=SOLVER_TOLERANCE,
        btol=SOLVER_TOLERANCE,
        iter_lim=MAX_SOLVER_STEPS,
        x0=np.append(start, np.zeros(points)),
    )[0]
    return np.asarray(found[:frames]), np.asarray(found[frames:])
