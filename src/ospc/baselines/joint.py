"""Joint estimation of response, vignette and exposures without any metadata (Bergmann, Wang, Cremers 2018).

Tracked scene points p, seen in frames i as grey levels O, are explained by O = f(eᵢ V(xᵢᵖ) Lᵖ): f from the empirical
model of response, V = 1 + v₁R² + v₂R⁴ + v₃R⁶, e and L free. Alternating non-linear least squares: Gauss-Newton
steps in (c, v, e) with the radiances fixed, then in the radiances with everything else fixed; residuals weigh less
where the image is steep, and large ones less by Huber's function.

Whatever is found explains the data as well after g → g^γ, V → V^γ, e → e^γ for any γ. The publication fixes γ by one
point of the true response; :meth:`JointEstimate.aligned_to` does that ("WGT"), without it the exponent stays where
the optimisation began ("WOGT").
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import lsqr

from ospc.arrays import FloatArray, ImageSize, IntArray
from ospc.baselines.response_model import SAMPLES, ResponseModel, learned_model
from ospc.baselines.tracks import GainRobustTracker, TrackObservations
from ospc.errors import NotObservableError, SettingError
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette, RasterVignette, Vignette
from ospc.recording.frame import Frame

_HUBER = 0.015
"""Grey difference, of full scale, from which residuals count less than quadratically."""

_RADIAL = 2 * np.arange(1, 4)
_FEWEST = 200
_LEAST_V, _MOST_LOG = 0.05, 12.0
_SETTLED = 1e-5


@dataclass(frozen=True)
class JointEstimate:
    """What a joint estimation found, up to one exponent.

    Attributes
    ----------
    size
        Width and height of the frames.
    model
        The space of responses searched.
    coefficients
        c, shape (n,).
    radial
        v, shape (3,).
    frames
        Indices of frames with an exposure, shape (m,).
    log_exposures
        Their ln e, mean 0, shape (m,).
    exponent
        γ that all three are to be raised to.
    cost
        Mean weighted square of the residuals.
    """

    size: ImageSize
    model: ResponseModel = field(repr=False)
    coefficients: FloatArray
    radial: FloatArray
    frames: IntArray
    log_exposures: FloatArray
    exponent: float = 1.0
    cost: float = 0.0

    @property
    def response(self) -> Response:
        """The response, with the exponent."""
        found = self.model.response(self.coefficients)
        if self.exponent == 1.0:
            return found
        return Response.from_values(_strict(found.inverse_table**self.exponent), model={"name": "joint"})

    @property
    def vignette(self) -> Vignette:
        """The vignette, with the exponent."""
        found = PolynomialVignette(self.size, tuple(self.radial.tolist()))
        if self.exponent == 1.0 and found.profile(1.0) > _LEAST_V:
            return found
        image = np.maximum(found.image(), _LEAST_V) ** np.float32(self.exponent)
        return RasterVignette(image, {"name": "joint", "exponent": self.exponent})

    @property
    def exposures(self) -> FloatArray:
        """Exposures up to a factor, with the exponent, shape (m,)."""
        return np.asarray(np.exp(self.exponent * self.log_exposures))

    def aligned_to(self, truth: Response, grey: float = 0.5) -> JointEstimate:
        """Return the estimate with the exponent that makes g true at one grey level.

        Raises
        ------
        SettingError
            If the grey level is not between 0 and 1.
        """
        if not 0 < grey < 1:
            raise SettingError(f"the known point of the response is at grey level {grey}; choose one within (0, 1)")
        found = float(self.model.response(self.coefficients).inverse(grey))
        return self.with_exponent(float(np.log(truth.inverse(grey)) / np.log(found)))

    def with_exponent(self, exponent: float) -> JointEstimate:
        """Return the estimate with another exponent."""
        return JointEstimate(
            self.size,
            self.model,
            self.coefficients,
            self.radial,
            self.frames,
            self.log_exposures,
            exponent,
            self.cost,
        )


def estimate_jointly(
    seen: TrackObservations,
    model: ResponseModel | None = None,
    start: JointEstimate | None = None,
    iterations: int = 60,
) -> JointEstimate:
    """Return response, vignette and exposures that explain observations best.

    Parameters
    ----------
    seen
        The observations.
    model
        Space of responses; that of :func:`learned_model` where None.
    start
        Where to begin; at the mean response, without vignette, at equal exposures where None.
    iterations
        Most alternations.

    Raises
    ------
    NotObservableError
        If there are too few observations.
    """
    if seen.grey.size < _FEWEST or seen.frames.size < 2:
        raise NotObservableError(
            f"joint estimation has {seen.grey.size} observations in {seen.frames.size} frames; "
            f"it needs {_FEWEST} in two frames or more"
        )
    problem = _Problem.of(seen, model or learned_model(), start)
    cost = np.inf
    for _ in range(iterations):
        problem.fit_parameters()
        problem.fit_radiances()
        before, cost = cost, problem.cost()
        if np.isfinite(before) and before - cost < _SETTLED * before:
            break
    return problem.estimate(cost)


class OnlineJoint:
    """The online variant: a new estimate every few frames from a window of the last ones, begun at the one before.

    Parameters
    ----------
    window
        Frames an estimate rests on; None for all of them (the batch variant, which estimates only when asked).
    every
        Frames between estimates.
    model
        Space of responses.
    """

    def __init__(self, window: int | None = 200, every: int = 50, model: ResponseModel | None = None) -> None:
        self._tracker = GainRobustTracker()
        self._window, self._every = window, every
        self._model = model or learned_model()
        self._latest: JointEstimate | None = None
        self._frames = 0
        self._last = 0

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        self._tracker.push(frame)
        self._frames += 1
        self._last = frame.index
        if self._window is not None and self._frames % self._every == 0 and self._frames >= self._window // 2:
            self._latest = self._estimate(20)

    def estimate(self) -> JointEstimate:
        """Return what is known now.

        Raises
        ------
        NotObservableError
            If too little was seen.
        """
        if self._window is None or self._latest is None:
            return self._estimate(60)
        return self._latest

    def _estimate(self, iterations: int) -> JointEstimate:
        seen = self._tracker.observations()
        if self._window is not None:
            seen = seen.since(self._last - self._window + 1)
        return estimate_jointly(seen, self._model, self._latest, iterations)


def calibrate_jointly(
    frames: Iterable[Frame],
    *,
    online: bool = False,
    model: ResponseModel | None = None,
    progress: Callable[[int], None] = lambda _done: None,
) -> JointEstimate:
    """Return the joint estimate from a recording's frames, whose exposures are not looked at.

    Raises
    ------
    NotObservableError
        If too little could be tracked.
    """
    method = OnlineJoint(200 if online else None, model=model)
    for done, frame in enumerate(frames, start=1):
        method.push(frame)
        progress(done)
    return method.estimate()


class _Problem:
    """The state of the alternation; everything by observation unless said otherwise."""

    def __init__(
        self, seen: TrackObservations, model: ResponseModel, c: FloatArray, v: FloatArray, log_e: FloatArray
    ) -> None:
        self._seen, self._model = seen, model
        self._c, self._v, self._log_e = c, v, log_e
        self._radial = seen.radius[:, None] ** _RADIAL
        self._points = int(seen.point.max()) + 1
        irradiance = np.interp(seen.grey, model.curve(c), np.linspace(0, 1, SAMPLES))
        seen_log = np.log(np.maximum(irradiance, 1e-4)) - np.log(self._attenuation(v))
        self._log_e, self._log_l = _first_exposures(seen, seen_log, log_e)
        self._damping = 1e-3
        self._centre()

    @classmethod
    def of(cls, seen: TrackObservations, model: ResponseModel, start: JointEstimate | None) -> _Problem:
        if start is None:
            return cls(seen, model, np.zeros(len(model.components)), np.zeros(3), np.zeros(seen.frames.size))
        log_e = np.interp(seen.frames, start.frames, start.log_exposures)
        return cls(seen, model, start.coefficients.copy(), start.radial.copy(), log_e)

    def estimate(self, cost: float) -> JointEstimate:
        """Return the present state as a result."""
        return JointEstimate(
            self._seen.size,
            self._model,
            self._c,
            self._v,
            self._seen.frames,
            self._log_e - self._log_e.mean(),
            1.0,
            cost,
        )

    def cost(self) -> float:
        """Return the mean of Huber's function of the residuals, weighted."""
        return self._cost_of(self._c, self._v, self._log_e, self._log_l)

    def fit_parameters(self) -> None:
        """Take one damped Gauss-Newton step in response, vignette and exposures."""
        seen = self._seen
        x, residual, slope = self._linearised()
        weight = self._weights(residual)
        attenuation = self._attenuation(self._v)
        inner = np.column_stack([self._at(self._model.components, x), (slope / attenuation)[:, None] * self._radial])
        count = self._log_e.size
        a = (inner * weight[:, None]).T @ inner
        b = np.stack(
            [np.bincount(seen.frame, weights=weight * slope * column, minlength=count) for column in inner.T]
        )
        d = np.bincount(seen.frame, weights=weight * slope**2, minlength=count)
        rhs = inner.T @ (weight * residual)
        rhs_e = np.bincount(seen.frame, weights=weight * slope * residual, minlength=count)
        before = self.cost()
        for _ in range(6):
            d_damped = d * (1 + self._damping) + 1e-9
            reduced = a + np.diag(np.diag(a) * self._damping + 1e-9) - (b / d_damped) @ b.T
            step = np.linalg.lstsq(reduced, rhs - (b / d_damped) @ rhs_e, rcond=None)[0]
            step_e = np.clip((rhs_e - step @ b) / d_damped, -0.5, 0.5)
            k = self._c.size
            c, v, log_e = self._c + step[:k], self._v + step[k:], self._log_e + step_e
            if self._cost_of(c, v, log_e, self._log_l) < before:
                self._c, self._v, self._log_e = c, v, log_e
                self._damping = max(self._damping / 4, 1e-7)
                return
            self._damping *= 8

    def fit_radiances(self) -> None:
        """Take one Gauss-Newton step in the radiance of every point."""
        _, residual, slope = self._linearised()
        weight = self._weights(residual)
        top = np.bincount(self._seen.point, weights=weight * slope * residual, minlength=self._points)
        bottom = np.bincount(self._seen.point, weights=weight * slope**2, minlength=self._points)
        self._log_l = self._log_l + np.clip(top / (bottom * (1 + 1e-6) + 1e-9), -0.5, 0.5)
        self._centre()

    def _linearised(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return irradiance, residual O − f, and the derivative of f by ln of the irradiance."""
        x = self._irradiance(self._v, self._log_e, self._log_l)
        curve = self._model.curve(self._c)
        slopes = np.gradient(curve, 1 / (SAMPLES - 1))
        inside = x < 1
        slope = np.where(inside, self._at(slopes[None], x)[:, 0] * x, 0.0)
        return x, self._seen.grey - self._at(curve[None], x)[:, 0], slope

    def _weights(self, residual: FloatArray) -> FloatArray:
        return np.asarray(self._seen.weight * np.minimum(1, _HUBER / np.maximum(np.abs(residual), 1e-12)))

    def _attenuation(self, v: FloatArray) -> FloatArray:
        return np.maximum(1 + self._radial @ v, _LEAST_V)

    def _irradiance(self, v: FloatArray, log_e: FloatArray, log_l: FloatArray) -> FloatArray:
        log_x = np.log(self._attenuation(v)) + log_e[self._seen.frame] + log_l[self._seen.point]
        return np.asarray(np.exp(np.clip(log_x, -_MOST_LOG, _MOST_LOG)))

    def _cost_of(self, c: FloatArray, v: FloatArray, log_e: FloatArray, log_l: FloatArray) -> float:
        x = self._irradiance(v, log_e, log_l)
        residual = np.abs(self._seen.grey - self._at(self._model.curve(c)[None], x)[:, 0])
        robust = np.where(residual < _HUBER, residual**2, 2 * _HUBER * residual - _HUBER**2)
        return float(np.average(robust, weights=self._seen.weight))

    def _centre(self) -> None:
        """Move the mean exposure into the radiances, which cannot be told apart."""
        mean = float(self._log_e.mean())
        self._log_e, self._log_l = self._log_e - mean, self._log_l + mean

    @staticmethod
    def _at(curves: FloatArray, x: FloatArray) -> FloatArray:
        """Return curves over equidistant irradiances at others, shape (m, 1024), (n,) -> (n, m)."""
        place = np.clip(x, 0, 1) * (SAMPLES - 1)
        low = np.minimum(place.astype(np.int64), SAMPLES - 2)
        share = (place - low)[:, None]
        table = curves.T
        return np.asarray(table[low] * (1 - share) + table[low + 1] * share)


def _first_exposures(
    seen: TrackObservations, log_irradiance: FloatArray, start: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return ln e of frames and ln L of points whose sums are nearest to observed ln irradiances.

    Alternation spreads an exposure's change over a chain of tracks only slowly; this linear system, which Bergmann et
    al. solve from frame to frame, does at once.
    """
    frames, points = seen.frames.size, int(seen.point.max()) + 1
    rows = np.arange(seen.grey.size)
    root = np.sqrt(seen.weight)
    matrix = csr_matrix(
        (
            np.concatenate([root, root]),
            (np.concatenate([rows, rows]), np.concatenate([seen.frame, frames + seen.point])),
        ),
        shape=(seen.grey.size, frames + points),
    )
    found = lsqr(
        matrix, root * log_irradiance, atol=1e-8, btol=1e-8, iter_lim=400, x0=np.append(start, np.zeros(points))
    )[0]
    return np.asarray(found[:frames]), np.asarray(found[frames:])


def _strict(table: FloatArray) -> FloatArray:
    """Return a curve that increases strictly even where a power has made it flat."""
    return np.asarray(table + np.linspace(0, 1e-9, table.size))
