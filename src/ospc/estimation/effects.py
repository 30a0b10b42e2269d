"""A selection of the effects in :mod:`~ospc.estimation.effect_models`, as terms of the fit.

In the logarithm, each effect is a term s of the equation ``h(M) − ln V − u = ln e + s``, which is linear in response
and vignette; :meth:`Effects.log_gain` returns s.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import get_args

import numpy as np

from ospc.arrays import Float32Array, FloatArray, IntArray
from ospc.estimation.effect_models import (
    CORRECTED_EXPOSURES,
    EFFECTS,
    GLARE_OF_WHITE,
    LIGHT_FIXED_TO_CAMERA,
    SCATTERED_LIGHT,
    AbsorbedLight,
    Addition,
    Circumstances,
)
from ospc.estimation.response_basis import ResponseBasis
from ospc.observations import ExposedObservations
from ospc.settings.effects import (
    ABSORBED_FRAME_LIGHT,
    ABSORBED_NEARBY_LIGHT,
    BEYOND_WHITE,
    DARKEST_IRRADIANCE,
    DIFFERENT_LOG_EXPOSURE,
    LIGHT_DRIFT_FRAMES,
    LIGHT_FIT_FLOOR,
    MAX_ADDED_SHARE,
    MIN_EXPOSURE_FACTOR,
    MIN_STEP_EXPOSURES,
    STEP_EXPOSURES,
)
from ospc.settings.error_model import PIXEL_NOISE_STRIDE
from ospc.settings.fit import MIN_GAMMA
from ospc.settings.sampling import GREY_POWERS


@dataclass(frozen=True)
class ResponseTables:
    """What the effects need of a response."""

    grid: FloatArray
    """Grey levels of the tables, shape (4097,)."""
    irradiance: FloatArray
    """g, shape (4097,)."""
    gamma: FloatArray
    """Local gamma, shape (4097,)."""
    light_of_moments: FloatArray
    """See :class:`~ospc.estimation.effect_models.Circumstances`."""

    @classmethod
    def of(cls, basis: ResponseBasis, coefficients: FloatArray) -> ResponseTables:
        """Return the tables for the coefficients of a response, shape (len of the basis,)."""
        irradiance = np.exp(basis.log_of(coefficients))
        return cls(basis.grid, irradiance, basis.gamma_of(coefficients), _light_of_moments(basis.grid, irradiance))


@dataclass(frozen=True)
class EffectTerms:
    """The values from which the effects of n observations are computed."""

    exposure: FloatArray
    """Exposure relative to the typical one, shape (n,)."""
    light: FloatArray
    """g at the expected grey level, shape (n,)."""
    amounts: dict[str, FloatArray]
    """The amount that a parameter of 1 of each chosen effect adds, in irradiance, typical exposures or ln g, shape
    (n,) each."""


@dataclass(frozen=True)
class Effects:
    """A selection of effects, and their reference values."""

    chosen: tuple[str, ...] = ()
    """Names of the effects, in the order of their parameters."""
    log_typical_exposure: float = 0.0
    """ln ē, in milliseconds."""
    groups: tuple[int, int] = (0, 1)
    """First and last group of the observations."""
    frames: tuple[int, int] = (0, 1)
    """Numbers of their first and last frame."""
    absorbed: AbsorbedLight = field(default_factory=AbsorbedLight)
    """Amounts of additional light contained in the response. A constant amount cannot be distinguished from the
    response. During the fit, the effects therefore only describe the difference of each observation from one with
    rather little additional light. All zero once the response is free of it."""
    most_white: tuple[float, float] = (1.0, 1.0)
    """Largest share of white pixels in a frame, and of its product with the exposure relative to the typical one; 1
    if there are none."""
    step_exposures: tuple[float, ...] = ()
    """Exposures relative to the typical one, beyond which the gain may differ; NaN where too few exposures differ for
    a step to be told from a power of the exposures, shape (15,); empty if no effect can be chosen."""

    @classmethod
    def none_of(cls, observations: ExposedObservations) -> Effects:
        """Return an empty selection, with the reference values of the observations."""
        groups = int(observations.group.min()), int(observations.group.max())
        frames = int(observations.frame.min()), int(observations.frame.max())
        frame, around = observations.frame_moments, observations.surround_moments
        log_exposure = observations.log_exposure
        typical = float(np.median(log_exposure))
        white = frame[:, -1:] * np.exp(log_exposure - typical)[:, None] ** [0, 1]
        most_white = np.where(white.any(axis=0), white.max(axis=0), 1.0)
        rather_dark = _at(ABSORBED_FRAME_LIGHT, frame[:, 0])
        typical_around = [_at(ABSORBED_NEARBY_LIGHT, total) for total in around[:, :, 1].T]
        absorbed = AbsorbedLight(
            tuple(frame[rather_dark].tolist()),
            tuple((white[rather_dark] / most_white).tolist()),
            tuple(tuple(around[place, number].tolist()) for number, place in enumerate(typical_around)),
        )
        steps = _step_exposures(log_exposure, typical)
        return cls((), typical, groups, frames, absorbed, tuple(most_white.tolist()), steps)

    def __len__(self) -> int:
        """Return the number of parameters."""
        return len(self.chosen)

    @property
    def sigma(self) -> FloatArray:
        """Prior standard deviation of each parameter about zero, shape (len,)."""
        return np.array([EFFECTS[name].sigma for name in self.chosen])

    def including(self, *names: str) -> Effects:
        """Return these effects together with others."""
        return replace(self, chosen=(*self.chosen, *names))

    def terms(self, observations: ExposedObservations, response: ResponseTables, index: IntArray) -> EffectTerms:
        """Return the terms of the effects for a response; ``index`` is the grid index of each expected grey level."""
        first, last = self.groups
        begin, end = self.frames
        seen = Circumstances(
            observations,
            exposure=np.exp(observations.log_exposure - self.log_typical_exposure),
            time=2 * (observations.group - first) / max(last - first, 1) - 1,
            part_of_recording=(observations.frame.astype(np.float64) - begin) / max(end - begin, LIGHT_DRIFT_FRAMES),
            grey=response.grid[index],
            gamma=response.gamma[index],
            light_of_moments=response.light_of_moments,
            absorbed=self.absorbed,
            most_white=self.most_white,
            step_exposures=self.step_exposures,
        )
        amounts = {name: EFFECTS[name].amount(seen) for name in self.chosen}
        return EffectTerms(seen.exposure, np.maximum(response.irradiance[index], DARKEST_IRRADIANCE), amounts)

    def without_absorbed_light(self, basis: ResponseBasis, parameters: FloatArray) -> tuple[Effects, FloatArray]:
        """Return the effects for a response without additional light, and the converted parameters.

        These are the coefficients of the response, any others, and last those of the effects, shape (p,).
        """
        n = len(basis)
        irradiance = np.exp(basis.log_of(parameters[:n]))
        factors = _light_of_moments(basis.grid, irradiance)
        values = dict(zip(self.chosen, parameters[len(parameters) - len(self) :], strict=True))
        glare, nearby, widely, *of_white = (values.get(name, 0.0) for name in SCATTERED_LIGHT)
        share, *around = np.array([nearby, widely]) @ self.absorbed.surround_moments
        # The response g̃ containing the light and the one without it, g, satisfy g ∝ g̃ + c. Mean irradiances contain
        # c, too: hence the divisor.
        held = (glare * np.array(self.absorbed.frame_moments) + around) @ factors
        held += np.array(of_white) @ self.absorbed.white
        constant = held / (1 - glare - share)
        at_knots = np.maximum(np.interp(basis.knots, basis.grid, irradiance), np.finfo(np.float64).tiny)
        changed = parameters.copy()
        changed[:n] = np.maximum(parameters[:n] * at_knots / (at_knots + constant), MIN_GAMMA)
        for number, name in enumerate(self.chosen, len(parameters) - len(self)):
            if name in (*LIGHT_FIXED_TO_CAMERA, *GLARE_OF_WHITE):  # those relative to white
                changed[number] /= 1 + constant
        return replace(self, absorbed=AbsorbedLight()), changed

    def log_gain(self, values: FloatArray, terms: EffectTerms) -> FloatArray:
        """Return the increase of ln g due to the effects, shape (n,)."""
        added, factor, log_gain = self._parts(values, terms)
        return np.asarray(log_gain + np.log(factor) - np.log(1 - added))

    def log_added(self, values: FloatArray, terms: EffectTerms) -> FloatArray:
        """Return the part of :meth:`log_gain` due to additional light, shape (n,)."""
        return np.asarray(-np.log(1 - self._parts(values, terms)[0]))

    def log_exposure_error(self, values: FloatArray, terms: EffectTerms) -> FloatArray:
        """Return ln of the true over the stated exposure due to effects of the exposure alone, shape (n,)."""
        _, factor, log_gain = self._parts(values * np.isin(self.chosen, CORRECTED_EXPOSURES), terms)
        return np.asarray(np.log(factor) + log_gain)

    def jacobian(self, values: FloatArray, terms: EffectTerms) -> FloatArray:
        """Return the derivative of :meth:`log_gain` with respect to the parameters, shape (n, len)."""
        added, factor, _ = self._parts(values, terms)
        over = {"light": terms.light * (1 - added), "exposure": terms.exposure * factor, "log": np.ones_like(added)}
        return np.stack([terms.amounts[name] / over[EFFECTS[name].adds] for name in self.chosen], axis=1)

    def _parts(self, values: FloatArray, terms: EffectTerms) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the share of added light, the factor on the exposure, and the addition to ln g, shape (n,) each."""
        sums = {adds: np.zeros_like(terms.exposure) for adds in get_args(Addition)}
        for name, value in zip(self.chosen, values, strict=True):
            sums[EFFECTS[name].adds] += value * terms.amounts[name]
        added = np.clip(sums["light"] / terms.light, -MAX_ADDED_SHARE, MAX_ADDED_SHARE)
        factor = np.maximum(1 + sums["exposure"] / terms.exposure, MIN_EXPOSURE_FACTOR)
        return added, factor, sums["log"]


def _at(quantile: float, values: FloatArray | Float32Array) -> int:
    """Return the index of the value at a quantile."""
    place = int(quantile * (len(values) - 1))
    return int(np.argpartition(values, place)[place])


def different_log_exposures(log_exposure: FloatArray) -> FloatArray:
    """Return the logarithms of clearly different exposures, in increasing order."""
    return np.unique(np.rint(log_exposure / DIFFERENT_LOG_EXPOSURE)) * DIFFERENT_LOG_EXPOSURE


def _step_exposures(log_exposure: FloatArray, log_typical: float) -> tuple[float, ...]:
    """Return the exposures that divide the observations equally; NaN if few different ones are on either side."""
    limits = np.quantile(log_exposure, np.arange(1, STEP_EXPOSURES + 1) / (STEP_EXPOSURES + 1))
    different = different_log_exposures(log_exposure)
    above = np.array([np.count_nonzero(different > limit + DIFFERENT_LOG_EXPOSURE / 2) for limit in limits])
    fewest = np.minimum(above, len(different) - above)
    return tuple(np.where(fewest >= MIN_STEP_EXPOSURES, np.exp(limits - log_typical), np.nan).tolist())


def _light_of_moments(grid: FloatArray, irradiance: FloatArray) -> FloatArray:
    """Return the factors on moments whose weighted sum is the mean irradiance; see :class:`Circumstances`."""
    # The first are the coefficients of the powers of M in the best fit to g; the last is the excess of white pixels.
    grey, light = grid[::PIXEL_NOISE_STRIDE], irradiance[::PIXEL_NOISE_STRIDE]
    weight = 1 / (light + LIGHT_FIT_FLOOR)
    rows = grey[:, None] ** np.arange(1, GREY_POWERS + 1) * weight[:, None]
    return np.append(np.linalg.lstsq(rows, light * weight, rcond=None)[0], BEYOND_WHITE)
