"""Response and vignette of all observations at once: robust maximum likelihood with latent irradiance.

The first round is one convex problem, a non-negative least squares; each further round repeats it with the model
linearised at the grey levels that the last one predicts, robust weights, an error model fitted to the residuals, and
the strength of the prior chosen anew.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_matrix
from threadpoolctl import threadpool_limits

from ospc.arrays import BoolArray, FloatArray, IntArray
from ospc.estimation.effects import Effects, Seen
from ospc.estimation.error_model import ErrorModel
from ospc.estimation.fit import Fit
from ospc.estimation.latent import Latent, LatentModel, refitted_share, weighted_means
from ospc.estimation.normal_equations import NormalEquations
from ospc.estimation.prior import Prior, PriorHyperparameters
from ospc.estimation.response_basis import ResponseBasis, typical_gamma
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.observations import ExposedObservations
from ospc.photometry.noise import NoiseModel
from ospc.robust import robust_scale
from ospc.settings.estimation import (
    CHUNK_OBSERVATIONS,
    CLEAR_OF_ENDS_SIGMAS,
    CONVEX_ROUNDS,
    DISAGREEMENT_SHARE,
    GROUPS_PER_BLOCK,
    MAX_DARK_CLEARANCE,
    MAX_GAMMA_CHANGE,
    MIN_BLOCKS,
    MIN_GAMMA,
    MIN_SANDWICH_FACTOR,
    SETTLED_SIGMAS,
    START_DRIFT,
    START_WALK,
    WEIGHT_CUT_SIGMAS,
    WEIGHT_SCALE_SIGMAS,
)


@dataclass(frozen=True)
class MaximumLikelihoodEstimator:
    """Fits response and vignette to observations.

    Attributes
    ----------
    response_basis, vignette_basis
        The models.
    effects
        What is estimated beside them.
    noise
        Noise of single pixels, by which clipping biases the mean near the ends. None where the observations are
        single pixels themselves.
    rounds
        Most rounds after the first; fewer where the parameters settle, to a tenth of a standard deviation
        each.
    """

    response_basis: ResponseBasis
    vignette_basis: VignetteBasis
    noise: NoiseModel | None = None
    rounds: int = 8
    effects: Effects = field(default_factory=Effects)

    def fit(self, observations: ExposedObservations, start: Fit | None = None) -> Fit:
        """Fit the models, on one core: many small matrix products, which threads only slow down.

        Parameters
        ----------
        observations
            The observations.
        start
            An earlier fit with the same response basis to start from.
        """
        with threadpool_limits(1, user_api="blas"):
            return self._fit(observations, start)

    def _fit(self, observations: ExposedObservations, start: Fit | None) -> Fit:
        parameters = self._first_parameters(start)
        errors, texture_share = (start.errors, start.texture_share) if start else (ErrorModel(), 0.0)
        weight: FloatArray = np.ones(len(observations))
        hyperparameters = start.hyperparameters if start else PriorHyperparameters(START_WALK, START_DRIFT)
        index = self.response_basis.index_of(observations.grey)
        for round_number in range(self.rounds + 1):
            convex = start is None and round_number < CONVEX_ROUNDS
            trusted = round_number > 0 or start is not None
            model = self._latent_model(parameters, errors, texture_share, trusted)
            latent = model(observations, self._log_gain(parameters, observations, index), weight)
            index = latent.index
            if trusted:
                unclipped = _unclipped(latent, model.pixel_noise)
                weigh = _equal if convex else _redescending
                weight, sandwich_factor = weigh(latent, unclipped)
                errors = self._refitted(errors, latent, parameters, observations)
                texture_share = refitted_share(texture_share, latent, weight, observations)
            else:
                sandwich_factor = 1.0
            equations = self._equations(observations, latent, weight, parameters)
            prior = self.prior(parameters)
            equations = equations.scaled(prior.precision(hyperparameters), sandwich_factor)
            hyperparameters = equations.maximize_evidence(prior)
            previous, parameters = (
                parameters,
                self._limited(equations.solve(prior, hyperparameters, self._floor()), parameters),
            )
            precision = equations.posterior_precision(prior, hyperparameters)
            change = parameters - previous
            if round_number > 1 and float(change @ precision @ change) < SETTLED_SIGMAS**2 * len(change):
                break
        disagreement = self._disagreement(observations, latent, weight, previous, parameters)
        return Fit(
            self.response_basis,
            self.vignette_basis,
            self.effects,
            parameters,
            equations.covariance(prior, hyperparameters, disagreement),
            cho_solve(cho_factor(precision), np.eye(len(parameters))),
            errors,
            hyperparameters,
            int(np.count_nonzero(np.add.reduceat(weight, observations.starts))),
            len(np.unique(observations.group)),
            model.pixel_noise,
            texture_share,
        )

    def information(self, observations: ExposedObservations, fit: Fit, about: FloatArray) -> NormalEquations:
        """Return the information of the observations on the parameters of these models, without any prior.

        Parameters
        ----------
        observations
            The observations.
        fit
            Fit to them, possibly in other models: its response and its errors are relied on.
        about
            The same fit in parameters of these models, at which they are linearised, shape (p,).
        """
        with threadpool_limits(1, user_api="blas"):
            own = MaximumLikelihoodEstimator(
                fit.response_basis, fit.vignette_basis, self.noise, self.rounds, fit.effects
            )
            model = own._latent_model(fit.parameters, fit.errors, fit.texture_share, trusted=True)
            log_gain = own._log_gain(fit.parameters, observations, fit.response_basis.index_of(observations.grey))
            weight: FloatArray = np.ones(len(observations))
            for _ in range(2):  # the second time with radiances that outliers no longer draw to themselves
                latent = model(observations, log_gain, weight)
                weight, sandwich_factor = _redescending(latent, _unclipped(latent, model.pixel_noise))
            # This basis may not contain the fitted response exactly: refer the linearised values to the nearest one.
            here = self.response_basis.log_of(about[: len(self.response_basis)])
            latent = replace(latent, linear_log=latent.linear_log + (here - model.log_response)[latent.index])
            equations = self._equations(observations, latent, weight, about)
            return equations.scaled(self.prior(about).precision(fit.hyperparameters), sandwich_factor)

    def prior(self, parameters: FloatArray) -> Prior:
        """Return the prior of the parameters, linearised at some, shape (p,)."""
        return Prior(
            self.response_basis.knots,
            parameters[: len(self.response_basis)],
            np.concatenate([self.vignette_basis.prior_sigma, self.effects.sigma]),
        )

    def _limited(self, parameters: FloatArray, previous: FloatArray) -> FloatArray:
        """Return the parameters with no gamma further from the previous one than its linearised logarithm holds."""
        n = len(self.response_basis)
        return np.concatenate(
            [
                np.clip(parameters[:n], previous[:n] / MAX_GAMMA_CHANGE, previous[:n] * MAX_GAMMA_CHANGE),
                parameters[n:],
            ]
        )

    def _first_parameters(self, start: Fit | None) -> FloatArray:
        if start is None:
            further = len(self.vignette_basis) + len(self.effects)
            return np.concatenate([typical_gamma(self.response_basis.knots), np.zeros(further)])
        vignette = np.zeros(len(self.vignette_basis))
        shared = min(self.vignette_basis.radial, start.vignette_basis.radial)
        vignette[:shared] = start.vignette_parameters[:shared]
        if self.vignette_basis.free_centre and start.vignette_basis.free_centre:
            vignette[self.vignette_basis.radial :][:2] = start.vignette_basis.centre(start.vignette_parameters)
        known = dict(zip(start.effects.chosen, start.effect_parameters, strict=True))
        effects = [known.get(effect, 0.0) for effect in self.effects.chosen]
        return np.concatenate([start.response_parameters, vignette, effects])

    def _floor(self) -> FloatArray:
        floor = np.full(self._effect_part.start + len(self.effects), -np.inf)
        floor[: len(self.response_basis)] = MIN_GAMMA
        return floor

    @property
    def _vignette_part(self) -> slice:
        n = len(self.response_basis)
        return slice(n, n + len(self.vignette_basis))

    @property
    def _effect_part(self) -> slice:
        return slice(self._vignette_part.stop, None)

    def _log_gain(self, parameters: FloatArray, observations: ExposedObservations, index: IntArray) -> FloatArray:
        """Return ln of the irradiance over exposure and radiance, by the model, shape (n,)."""
        log_vignette = self.vignette_basis.log_value(parameters[self._vignette_part], observations.position)
        if not len(self.effects):
            return log_vignette
        seen = self._seen(parameters, observations, index)
        return log_vignette + self.effects.log_gain(parameters[self._effect_part], seen)

    def _seen(self, parameters: FloatArray, observations: ExposedObservations, index: IntArray) -> Seen:
        return self.effects.seen(observations, self.response_basis, parameters[: len(self.response_basis)], index)

    def _latent_model(
        self, parameters: FloatArray, errors: ErrorModel, texture_share: float, trusted: bool
    ) -> LatentModel:
        coefficients = parameters[: len(self.response_basis)]
        return LatentModel(self.response_basis, coefficients, errors, self.noise, texture_share, trusted)

    def _refitted(
        self, errors: ErrorModel, latent: Latent, parameters: FloatArray, observations: ExposedObservations
    ) -> ErrorModel:
        log_response = self.response_basis.log_of(parameters[: len(self.response_basis)])
        return errors.refitted(
            latent.residual**2 / latent.one_minus_leverage / latent.log_response_slope**2,
            latent.grey,
            1 / latent.log_response_slope,
            np.maximum(np.exp(log_response[latent.index]), 1e-12),
            observations.gradient,
        )

    def _equations(
        self, observations: ExposedObservations, latent: Latent, weight: FloatArray, parameters: FloatArray
    ) -> NormalEquations:
        p = len(parameters)
        block = _blocks_of(observations.group)
        matrix, scores = np.zeros((p, p)), np.zeros((int(block.max()) + 1, p))
        vector = np.zeros(p)
        for part in _chunks(observations):
            rows, target, factor, member = self._free_of_radiance(observations, latent, weight, part, parameters)
            weighted = rows * factor[:, None]
            matrix += rows.T @ weighted
            vector += weighted.T @ target
            misfit = target - rows @ parameters
            shape = (len(scores), len(rows))
            scores += csr_matrix((misfit, (block[part][member], np.arange(len(rows)))), shape=shape) @ weighted
        return NormalEquations(matrix, vector, scores.T @ scores, blocks=len(scores))

    def _disagreement(
        self,
        observations: ExposedObservations,
        latent: Latent,
        weight: FloatArray,
        about: FloatArray,
        parameters: FloatArray,
    ) -> FloatArray:
        """Return the scatter of the scores between the halves of the observations, cut in several ways, (p, p).

        Errors that all groups share, such as registration that is drawn to equal brightness, do not show in the
        scatter between groups. Most of them depend on something: on time, on the ratio of the exposures, on the place
        in the image. Then the halves would have the parameters move to opposite sides.
        """
        sides = np.repeat(_halves(observations), observations.counts, axis=1)
        scores = np.zeros((len(sides), len(parameters)))
        for part in _chunks(observations):
            rows, target, factor, member = self._free_of_radiance(observations, latent, weight, part, about)
            misfit = target - rows @ parameters
            scores += (sides[:, part][:, member] * (factor * misfit)) @ rows
        return np.asarray(DISAGREEMENT_SHARE * scores.T @ scores)

    def _free_of_radiance(
        self,
        observations: ExposedObservations,
        latent: Latent,
        weight: FloatArray,
        part: slice,
        parameters: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray, IntArray | slice]:
        """Return rows, right-hand sides, weights, and whose they are, with each point's radiance eliminated."""
        seen = observations.where(part)
        rows, target = self._rows(seen, latent, part, parameters)
        factor = weight[part] * latent.precision[part]
        if np.all(seen.counts == 2):
            # Minus their weighted mean, the two observations of a pair give the same equation: keep one difference.
            both = factor[0::2] + factor[1::2]
            factor = factor[0::2] * factor[1::2] / np.maximum(both, 1e-300)
            return rows[0::2] - rows[1::2], target[0::2] - target[1::2], factor, slice(0, None, 2)
        _, mean = weighted_means(np.column_stack([rows, target]), factor, seen)
        return rows - mean[:, :-1], target - mean[:, -1], factor, slice(None)

    def _rows(
        self, seen: ExposedObservations, latent: Latent, part: slice, parameters: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return rows and right-hand sides of h(M) − ln V − u = ln e, linear in all parameters."""
        vignette = parameters[self._vignette_part]
        jacobian = self.vignette_basis.jacobian(vignette, seen.position)
        # Where ln V is not linear in its parameters (the centre), what the linearisation leaves goes to the right.
        constant = self.vignette_basis.log_value(vignette, seen.position) - jacobian @ vignette
        rows = np.concatenate([self.response_basis.log_table[latent.index[part]], -jacobian], axis=1)
        # h at the measured grey level is h at the predicted one, which the rows hold, plus this much.
        excess = (
            latent.linear_log[part] - rows[:, : len(self.response_basis)] @ parameters[: len(self.response_basis)]
        )
        target = seen.log_exposure + constant - excess
        if len(self.effects):
            values, known = parameters[self._effect_part], self._seen(parameters, seen, latent.index[part])
            slopes = self.effects.jacobian(values, known)
            rows = np.concatenate([rows, -slopes], axis=1)
            target = target + self.effects.log_gain(values, known) - slopes @ values
        return rows, target


def _equal(_latent: Latent, unclipped: BoolArray) -> tuple[FloatArray, float]:
    """Return the same weight for all that counts, and E[ψ'] / E[w]."""
    return unclipped.astype(np.float64), 1.0


def _redescending(latent: Latent, unclipped: BoolArray) -> tuple[FloatArray, float]:
    """Return redescending weights (Geman and McClure 1987, cut off), and E[ψ'] / E[w] of those that count."""
    scaled = latent.studentised / (WEIGHT_SCALE_SIGMAS * max(robust_scale(latent.studentised), 1e-6))
    squared = scaled**2
    counts = unclipped & (np.abs(scaled) < WEIGHT_CUT_SIGMAS / WEIGHT_SCALE_SIGMAS)
    weight = np.where(counts, 1 / (1 + squared) ** 2, 0.0)
    derivative = np.where(counts, (1 - 3 * squared) / (1 + squared) ** 3, 0.0)
    sandwich_factor = float(derivative.sum() / max(weight.sum(), 1e-300))
    return weight, max(sandwich_factor, MIN_SANDWICH_FACTOR)


def _blocks_of(group: IntArray) -> IntArray:
    """Return the block each observation counts to when the spread of scores is measured, shape (n,).

    Errors of one pair of frames recur in the next ones, which show the same scene. Consecutive groups form a block,
    as long as enough blocks remain to measure a spread between them.
    """
    _, number = np.unique(group, return_inverse=True)
    size = int(np.clip((number.max() + 1) // MIN_BLOCKS, 1, GROUPS_PER_BLOCK))
    return np.asarray(number // size)


def _halves(observations: ExposedObservations) -> FloatArray:
    """Return -1 or 1 for every point and each way to cut the observations into halves, shape (ways, points).

    The ways are: early and late, large and small exposure ratios, rising and falling exposure, centre and edge.
    """
    first = observations.starts
    last = first + observations.counts - 1
    log_ratio = observations.log_exposure[last] - observations.log_exposure[first]
    squared_radius = np.sum(observations.position**2, axis=1)
    of_points = (
        observations.group[first],
        np.abs(log_ratio),
        log_ratio,
        squared_radius[first] + squared_radius[last],
    )
    cuts = (np.median(of_points[0]), np.median(of_points[1]), 0.0, np.median(of_points[3]))
    return np.array([np.where(values > cut, 1.0, -1.0) for values, cut in zip(of_points, cuts, strict=True)])


def _chunks(observations: ExposedObservations) -> Iterator[slice]:
    """Give slices of bounded length that do not cut a point's observations apart."""
    starts = np.append(observations.starts, len(observations))
    begin = 0
    while begin < len(observations):
        end = int(starts[np.searchsorted(starts, begin + CHUNK_OBSERVATIONS, side="right") - 1])
        end = end if end > begin else int(starts[np.searchsorted(starts, begin, side="right")])
        yield slice(begin, end)
        begin = end


def _unclipped(latent: Latent, noise: NoiseModel) -> BoolArray:
    """Return where the noise of single pixels hardly reaches black or white, by the predicted grey level.

    Judging by the measured one would keep just those samples whose noise happens to lead away from the end.
    """
    reach = CLEAR_OF_ENDS_SIGMAS * np.sqrt(noise.variance(latent.grey))
    return np.asarray((latent.grey + reach < 1.0) & (latent.grey > np.minimum(reach, MAX_DARK_CLEARANCE)))
