"""The fitted model (response, vignette and effects) and the linear system of its observations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise

import numpy as np

from ospc.arrays import BoolArray, FloatArray, IntArray
from ospc.estimation.effects import Effects, EffectTerms, ResponseTables
from ospc.estimation.frame_gains import FrameGains, PairEnds, PairMeans
from ospc.estimation.group_sums import GroupSums
from ospc.estimation.latent import Latent, weighted_means
from ospc.estimation.normal_equations import NormalEquations
from ospc.estimation.prior import Prior
from ospc.estimation.response_basis import ResponseBasis, typical_gamma
from ospc.estimation.shared_errors import SharedErrors, expected_errors, halves
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.observations import ExposedObservations
from ospc.settings.fit import CHUNK_OBSERVATIONS, MAX_GAMMA, MAX_GAMMA_CHANGE, MIN_GAMMA


@dataclass(frozen=True)
class Model:
    """Response, vignette and effects. Their parameters, shape (p,), are concatenated in this order."""

    response_basis: ResponseBasis
    vignette_basis: VignetteBasis
    effects: Effects

    @property
    def vignette_part(self) -> slice:
        """Slice of the vignette's parameters."""
        n = len(self.response_basis)
        return slice(n, n + len(self.vignette_basis))

    @property
    def centre_part(self) -> slice:
        """Slice of the vignette's centre; empty if it is not free."""
        first, own = self.vignette_part.start, self.vignette_basis.centre_part
        return slice(first + own.start, first + own.stop)

    def split(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the parameters of the response, the vignette and the effects."""
        vignette = self.vignette_part
        return parameters[: vignette.start], parameters[vignette], parameters[vignette.stop :]

    @property
    def typical(self) -> FloatArray:
        """Parameters of a typical response without vignette or effects, shape (p,)."""
        further = len(self.vignette_basis) + len(self.effects)
        return np.concatenate([typical_gamma(self.response_basis.knots), np.zeros(further)])

    @property
    def floor(self) -> FloatArray:
        """Lower limit of each parameter, −inf for none, shape (p,)."""
        floor = np.full(self.vignette_part.stop + len(self.effects), -np.inf)
        floor[: len(self.response_basis)] = MIN_GAMMA
        return floor

    def limited(self, parameters: FloatArray, previous: FloatArray) -> FloatArray:
        """Return the parameters with every gamma plausible, and near enough to the previous one to linearise ln γ.

        The vignette's centre is kept well within the image.
        """
        n, vignette = len(self.response_basis), self.vignette_part
        highest = np.minimum(previous[:n] * MAX_GAMMA_CHANGE, MAX_GAMMA)
        gamma = np.clip(parameters[:n], previous[:n] / MAX_GAMMA_CHANGE, highest)
        within = self.vignette_basis.limited(parameters[vignette])
        return np.concatenate([gamma, within, parameters[vignette.stop :]])

    def prior(self, parameters: FloatArray) -> Prior:
        """Return the prior, linearised at the given parameters, shape (p,)."""
        return Prior(self.response_basis, self.vignette_basis, self.split(parameters)[0], self.effects.sigma)

    def effect_terms(self, parameters: FloatArray, observations: ExposedObservations, index: IntArray) -> EffectTerms:
        """Return the terms of the effects; ``index`` is the grid index of each expected grey level, shape (n,)."""
        return self.effects.terms(observations, self.response_tables(parameters), index)

    def response_tables(self, parameters: FloatArray) -> ResponseTables:
        """Return the response as the effects need it."""
        return ResponseTables.of(self.response_basis, self.split(parameters)[0])

    def log_gain(self, parameters: FloatArray, observations: ExposedObservations, index: IntArray) -> FloatArray:
        """Return ln of the irradiance over exposure and radiance, shape (n,).

        ``index`` is as in :meth:`effect_terms`.
        """
        _, vignette, values = self.split(parameters)
        log_vignette = self.vignette_basis.log_value(vignette, observations.position)
        if not len(self.effects):
            return log_vignette
        return log_vignette + self.effects.log_gain(values, self.effect_terms(parameters, observations, index))


@dataclass(frozen=True)
class LinearSystem:
    """The equations h(M) − ln V − u = ln e + s of all observations, with the radiance u of each point eliminated."""

    model: Model
    """The model."""
    about: FloatArray
    """The parameters at which it is linearised, shape (p,)."""
    observations: ExposedObservations
    """n observations."""
    latent: Latent
    """Their linearisation."""
    weight: FloatArray
    """Robust weights, shape (n,)."""
    gain_variances: tuple[float, ...] = ()
    """Variances of the latent frame gains, in ln²; empty for none."""

    def equations(self, prior_precision: FloatArray, sandwich_factor: float) -> NormalEquations:
        """Return the normal equations of the parameters and, last, of a change of the texture share.

        The precision of the prior, shape (p, p), and the sandwich factor are only used with latent gains, to scale
        the weights.
        """
        if not self.has_gains:
            return self._sums.equations()
        means = self._means(self.about, prior_precision, sandwich_factor)
        return self._sums.within.plus(means).equations()

    def _means(self, parameters: FloatArray, prior_precision: FloatArray, sandwich_factor: float) -> GroupSums:
        """Return the sums of the pairs' means about parameters of shape (p,), with gains in their precision."""
        scale = self._scale_within(self._sums, prior_precision, sandwich_factor)
        whiten = partial(self.gains(parameters).whitened, scale=scale)
        return self._sums.means(whiten, np.append(parameters, 0.0))

    def _scale_within(self, sums: GroupSums, prior_precision: FloatArray, sandwich_factor: float) -> float:
        """Return the information scale within pairs."""
        within = sums.within.equations().part(np.arange(len(self.about)))
        return within.scaled(prior_precision, sandwich_factor).information_scale

    @property
    def has_gains(self) -> bool:
        """Whether frames have a latent gain."""
        return bool(self.gain_variances) and self.observations.in_pairs

    def gains(self, parameters: FloatArray) -> FrameGains:
        """Return the frame gains for parameters of shape (p,)."""
        means = PairMeans(self._sums.mean_misfit(np.append(parameters, 0.0)), self._sums.by_chance)
        return FrameGains(PairEnds.of(self.observations), means, self.gain_variances)

    def significant_gain_variances(
        self, prior_precision: FloatArray, sandwich_factor: float, resolved: BoolArray
    ) -> tuple[float, ...]:
        """Return the variances of the gains, empty if chance explains the pairs.

        Chance includes errors that the points of a pair share. ``resolved`` states where the basis can follow the
        bends of the response, shape (n,); the other arguments are as in :meth:`equations`.
        """
        sums = self._summed(with_rows=True)
        scale = min(self._scale_within(sums, prior_precision, sandwich_factor), 1.0)
        weighted = PairMeans(sums.mean_misfit(sums.about), sums.by_chance).with_chance(1 / scale)
        # A response that fits most pairs leaves the others without weight.
        unweighted = self.latent.means_of_pairs(self.observations, resolved).with_chance(1 / scale)
        exceeds_chance = weighted.most_exceed_chance or unweighted.some_exceed_chance
        return unweighted.initial_variances if len(unweighted) and exceeds_chance else ()

    @cached_property
    def _log_response(self) -> FloatArray:
        return self.model.response_basis.log_of(self.model.split(self.about)[0])

    @cached_property
    def _response_tables(self) -> ResponseTables:
        return self.model.response_tables(self.about)

    @cached_property
    def _sums(self) -> GroupSums:
        return self._summed(with_rows=self.has_gains)

    def _summed(self, *, with_rows: bool) -> GroupSums:
        """Return the sums; those of rows are slow and only needed for gains."""
        about, number = np.append(self.about, 0.0), self.observations.group_number
        p, groups = len(about), int(number.max()) + 1
        matrix, vector = np.zeros((p, p)), np.zeros(p)
        precision, misfit, scores = np.zeros(groups), np.zeros(groups), np.zeros((groups, p))
        of_rows = np.zeros((groups, p if with_rows else 0))
        for part in _chunks(self.observations):
            rows, target, factor, member = self._free_of_radiance(part)
            root = np.sqrt(factor)
            rows *= root[:, None]
            target *= root
            matrix += rows.T @ rows
            vector += target @ rows
            wrong = target - rows @ about
            inside = number[part][member]
            if np.any(np.diff(inside) < 0):  # as in a series, whose points are in every group
                order = np.argsort(inside, kind="stable")
                inside, rows, root, wrong = inside[order], rows[order], root[order], wrong[order]
            # A group's observations are consecutive, and short products take less time than one of all.
            for begin, end in pairwise([*np.flatnonzero(np.diff(inside, prepend=-1)), len(inside)]):
                group, own = inside[begin], slice(begin, end)
                precision[group] += root[own] @ root[own]
                misfit[group] += root[own] @ wrong[own]
                scores[group] += wrong[own] @ rows[own]
                if with_rows:
                    of_rows[group] += root[own] @ rows[own]
        return GroupSums(about, matrix, vector, scores, of_rows, precision, misfit)

    def shared_errors(
        self, parameters: FloatArray, prior_precision: FloatArray, sandwich_factor: float
    ) -> SharedErrors:
        """Return the scores of errors that all pairs share; the arguments are as in :meth:`equations`.

        Most of them, for example a registration biased towards equal brightness, depend on time, on the exposure
        ratio or on the position in the image: halves of the observations, split in several ways, then disagree. Those
        that halves do not show are expected in points of the same kind.
        """
        shown = replace(self.observations, log_exposure=self.latent.log_exposure)
        sides = np.repeat(halves(shown), self.observations.counts, axis=1)
        error, kind, kinds = expected_errors(shown)
        disagreement, expected = np.zeros((len(sides), len(parameters))), np.zeros((kinds, len(parameters)))
        if self.has_gains:  # the mean of a pair has its own weight and belongs entirely to one half
            row_of_pair, misfit_of_pair = self._sums.mean_rows[:, :-1], self.gains(parameters).means.mean
            means = self._means(parameters, prior_precision, sandwich_factor)
            disagreement += self._sides_of_pairs(sides) @ means.scores[:, :-1]
        for part in _chunks(self.observations):
            rows, target, factor, member = self._free_of_radiance(part)
            rows = rows[:, :-1]
            misfit = target - rows @ parameters
            if self.has_gains:
                number = self.observations.group_number[part][member]
                rows, misfit = rows - row_of_pair[number], misfit - misfit_of_pair[number]
            disagreement += (sides[:, part][:, member] * (factor * misfit)) @ rows
            of_kind = kind[part][member] == np.arange(kinds)[:, None]
            expected += (of_kind * (factor * error[part][member])) @ rows
        return SharedErrors(disagreement, expected)

    def _sides_of_pairs(self, sides: FloatArray) -> FloatArray:
        """Average the sides of observations over the points of each pair, shape (ways, n) -> (ways, pairs)."""
        pair = self.observations.group_number
        return np.stack([np.bincount(pair, side) / np.bincount(pair) for side in sides])

    def _free_of_radiance(self, part: slice) -> tuple[FloatArray, FloatArray, FloatArray, IntArray | slice]:
        """Return rows, right-hand sides, weights and their observations, with the radiance of points eliminated."""
        observed = self.observations.where(part)
        columns, target = self._columns(observed, part)
        factor = self.weight[part] * self.latent.precision[part]
        if self.observations.in_pairs:
            # After subtracting the weighted mean, both observations give the same equation: keep the difference.
            both = factor[0::2] + factor[1::2]
            factor = factor[0::2] * factor[1::2] / np.maximum(both, 1e-300)
            rows, ends = np.empty((len(factor), len(self.about) + 1)), np.cumsum([each.shape[1] for each in columns])
            for each, own in zip(columns, np.split(rows, ends[:-1], axis=1), strict=True):
                np.subtract(each[0::2], each[1::2], out=own)
            return rows, target[0::2] - target[1::2], factor, slice(0, None, 2)
        rows = np.concatenate(columns, axis=1)
        _, mean = weighted_means(np.column_stack([rows, target]), factor, observed)
        return rows - mean[:, :-1], target - mean[:, -1], factor, slice(None)

    def _columns(self, observed: ExposedObservations, part: slice) -> tuple[list[FloatArray], FloatArray]:
        """Return the blocks of columns, for all parameters and the texture share, and the right-hand sides."""
        model, index = self.model, self.latent.index[part]
        _, vignette, values = model.split(self.about)
        jacobian = model.vignette_basis.jacobian(vignette, observed.position)
        remainder = model.vignette_basis.remainder(vignette, observed.position, jacobian)
        columns = [model.response_basis.log_table.take(index, axis=0), -jacobian]
        # The rows contain h at the predicted grey level; at the measured one, h is larger by this.
        excess = self.latent.linear_log[part] - self._log_response[index]
        target = observed.log_exposure + remainder - excess
        if len(model.effects):
            # An error of a stated exposure is in the target; if it were in the terms too, it would imitate an effect.
            shown = replace(observed, log_exposure=self.latent.log_exposure[part])
            terms = model.effects.terms(shown, self._response_tables, index)
            slopes = model.effects.jacobian(values, terms)
            columns.append(-slopes)
            target = target + model.effects.log_gain(values, terms) - slopes @ values
        return [*columns, self.latent.texture[part, None]], target


def _chunks(observations: ExposedObservations) -> Iterator[slice]:
    """Yield slices of limited length that do not separate the observations of a point."""
    starts = np.append(observations.starts, len(observations))
    begin = 0
    while begin < len(observations):
        end = int(starts[np.searchsorted(starts, begin + CHUNK_OBSERVATIONS, side="right") - 1])
        end = end if end > begin else int(starts[np.searchsorted(starts, begin, side="right")])
        yield slice(begin, end)
        begin = end
