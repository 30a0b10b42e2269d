"""Effects of optics, sensors and metadata other than response and vignette, which are zero unless the data show them.

With the corrected effects, the irradiance of an observation is ``g(M) = (e + δ ē) V L + γ Ḡ + d e/ē``, where Ḡ is the
mean of g over the frame and ē a typical exposure. In the logarithm, each effect is a term s of the equation
``h(M) − ln V − u = ln e + s``, which is linear in response and vignette; :meth:`Effects.log_gain` returns s. The
other effects are not properties of a camera: they show that the recording contradicts the model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from ospc.arrays import Float32Array, FloatArray, IntArray
from ospc.estimation.response_basis import ResponseBasis
from ospc.observations import MOMENTS, POWERS, ExposedObservations
from ospc.photometry.verdict import LATE_EXPOSURES
from ospc.settings.estimation import (
    ABSORBED_DARK,
    ABSORBED_FRAME_LIGHT,
    ABSORBED_NEARBY_LIGHT,
    BEYOND_WHITE,
    BLACK_BY_EXPOSURE,
    BLACK_DRIFT,
    CURVATURE,
    DARK_CURRENT,
    DARKEST_GREY,
    DARKEST_IRRADIANCE,
    GLARE,
    LATENESS,
    LIGHT_FIT_FLOOR,
    LOCAL_TONE,
    MAX_ADDED_SHARE,
    MIN_EXPOSURE_FACTOR,
    MIN_GAMMA,
    MOST_ADDED_LIGHT,
    MOST_LATE_FRAMES,
    MOST_OFFSET,
    OFFSET,
    PIXEL_NOISE_STRIDE,
    RESPONSE_DRIFT,
    SCATTER,
    VIGNETTE_DRIFT,
)

Addition = Literal["light", "exposure", "log"]
"""The quantity that an effect adds to: the light on the sensor, the exposure, or ln g."""


@dataclass(frozen=True)
class AbsorbedLight:
    """Additional light contained in the response, as that of a rather dark observation: moments and exposure."""

    frame_moments: tuple[float, ...] = (0.0,) * MOMENTS
    surround_moments: tuple[float, ...] = (0.0,) * (1 + MOMENTS)
    dark: float = 0.0


@dataclass(frozen=True)
class Circumstances:
    """Quantities that determine the amount of an effect, for n observations and a response.

    Attributes
    ----------
    observations
        The observations.
    exposure, time
        Exposure relative to the typical one, and time from −1 in the first group to 1 in the last, shape (n,).
    grey, gamma
        Expected grey levels, and the local gamma there, shape (n,).
    light_of_moments
        Factors on the moments of grey levels; the weighted sum is their mean irradiance, shape (6,).
    absorbed
        The additional light contained in the response.
    """

    observations: ExposedObservations
    exposure: FloatArray
    time: FloatArray
    grey: FloatArray
    gamma: FloatArray
    light_of_moments: FloatArray
    absorbed: AbsorbedLight

    @property
    def position(self) -> FloatArray:
        """Positions of the observations, in half diagonals, shape (n, 2)."""
        return self.observations.position

    @property
    def light_of_frame(self) -> FloatArray:
        """Mean irradiance of the frame in excess of that contained in the response, shape (n,)."""
        return (self.observations.frame_moments - self.absorbed.frame_moments) @ self.light_of_moments

    @property
    def light_around(self) -> FloatArray:
        """Mean irradiance of the surroundings in excess of that contained in the response, shape (n,)."""
        return (self.observations.surround_moments - self.absorbed.surround_moments)[:, 1:] @ self.light_of_moments

    @property
    def grey_around(self) -> FloatArray:
        """Mean grey level of the surroundings that receive light, 1 if none do, shape (n,)."""
        share, total = self.observations.surround_moments[:, :2].T.astype(np.float64)
        return np.maximum(np.where(share > 0, total / np.maximum(share, DARKEST_GREY), 1.0), DARKEST_GREY)


@dataclass(frozen=True)
class Effect:
    """One effect.

    Attributes
    ----------
    adds
        The quantity it adds to.
    amount
        The amount that a parameter of 1 adds to each of n observations, in irradiance, typical exposures or ln g,
        shape (n,).
    sigma, usual_sigma
        Prior standard deviations of the parameter: in cameras with the effect, and in all others.
    systematic
        Standard deviation of spurious values of the parameter in clean recordings.
    least, most
        Plausible range of the parameter: there is no negative light.
    """

    adds: Addition
    amount: Callable[[Circumstances], FloatArray]
    sigma: float
    usual_sigma: float
    systematic: float
    least: float = -np.inf
    most: float = np.inf

    def allows(self, value: float) -> bool:
        """Return whether a value of the parameter is plausible."""
        return self.least <= value <= self.most


EFFECTS = {
    # Light is relative to that contained in the response.
    "veiling glare": Effect("light", lambda seen: seen.light_of_frame, *GLARE, 0.0, MOST_ADDED_LIGHT),
    "light scattered nearby": Effect("light", lambda seen: seen.light_around, *SCATTER, 0.0, MOST_ADDED_LIGHT),
    "dark current": Effect(
        "light", lambda seen: seen.exposure - seen.absorbed.dark, *DARK_CURRENT, 0.0, MOST_ADDED_LIGHT
    ),
    "exposure offset": Effect(
        "exposure", lambda seen: np.ones_like(seen.exposure), *OFFSET, -MOST_OFFSET, MOST_OFFSET
    ),
    LATE_EXPOSURES: Effect(
        "log", lambda seen: seen.observations.log_exposure_rate, *LATENESS, -MOST_LATE_FRAMES, MOST_LATE_FRAMES
    ),
    # The grey level is multiplied by a power θ of that of the surroundings.
    "local tone mapping": Effect("log", lambda seen: seen.gamma * np.log(seen.grey_around), *LOCAL_TONE),
    "curved exposures": Effect("log", lambda seen: np.log(seen.exposure) ** 2, *CURVATURE),
    # The grey level has a power of 1 + θ; it rises by θ.
    "drifting response": Effect("log", lambda seen: seen.time * seen.gamma * np.log(seen.grey), *RESPONSE_DRIFT),
    "drifting black level": Effect("log", lambda seen: seen.time * seen.gamma / seen.grey, *BLACK_DRIFT),
    "black level by exposure": Effect(
        "log", lambda seen: np.log(seen.exposure) * seen.gamma / seen.grey, *BLACK_BY_EXPOSURE
    ),
    "drifting vignette": Effect("log", lambda seen: seen.time * np.sum(seen.position**2, axis=1), *VIGNETTE_DRIFT),
    "vignette moving sideways": Effect("log", lambda seen: seen.time * seen.position[:, 0], *VIGNETTE_DRIFT),
    "vignette moving vertically": Effect("log", lambda seen: seen.time * seen.position[:, 1], *VIGNETTE_DRIFT),
}
"""All effects by name."""

CORRECTED = ("veiling glare", "light scattered nearby", "dark current", "exposure offset", LATE_EXPOSURES)
"""Effects of real cameras. Those that the observations show are corrected in the result."""

CONTRADICTIONS = tuple(name for name in EFFECTS if name not in CORRECTED)
"""Effects that contradict a camera with one response and one vignette."""


@dataclass(frozen=True)
class EffectTerms:
    """The values from which the effects of n observations are computed.

    Attributes
    ----------
    exposure, light
        Exposure relative to the typical one, and g at the expected grey level, shape (n,).
    amounts
        The amount that a parameter of 1 of each chosen effect adds, in irradiance, typical exposures or ln g, shape
        (n,) each.
    """

    exposure: FloatArray
    light: FloatArray
    amounts: dict[str, FloatArray]


@dataclass(frozen=True)
class Effects:
    """A selection of effects, and their reference values.

    Attributes
    ----------
    chosen
        Names of the effects, in the order of their parameters.
    log_typical_exposure, groups
        ln ē, in milliseconds, and first and last group of the observations.
    absorbed
        Amounts of additional light contained in the response. A constant amount cannot be distinguished from the
        response. During the fit, the effects therefore only describe the difference of each observation from one with
        rather little additional light. All zero once the response is free of it.
    """

    chosen: tuple[str, ...] = ()
    log_typical_exposure: float = 0.0
    groups: tuple[int, int] = (0, 1)
    absorbed: AbsorbedLight = AbsorbedLight()

    @classmethod
    def none_of(cls, observations: ExposedObservations) -> Effects:
        """Return an empty selection, with the reference values of the observations."""
        groups = int(observations.group.min()), int(observations.group.max())
        frame, around = observations.frame_moments, observations.surround_moments
        log_exposure = observations.log_exposure
        typical = float(np.median(log_exposure))
        absorbed = AbsorbedLight(
            tuple(frame[_at(ABSORBED_FRAME_LIGHT, frame[:, 0])].tolist()),
            tuple(around[_at(ABSORBED_NEARBY_LIGHT, around[:, 1])].tolist()),
            float(np.exp(log_exposure[_at(ABSORBED_DARK, log_exposure)] - typical)),
        )
        return cls((), typical, groups, absorbed)

    def __len__(self) -> int:
        """Return the number of parameters."""
        return len(self.chosen)

    @property
    def sigma(self) -> FloatArray:
        """Prior standard deviation of each parameter about zero, shape (len,)."""
        return np.array([EFFECTS[name].sigma for name in self.chosen])

    def and_(self, *names: str) -> Effects:
        """Return these effects together with others."""
        return replace(self, chosen=(*self.chosen, *names))

    def terms(
        self, observations: ExposedObservations, basis: ResponseBasis, coefficients: FloatArray, index: IntArray
    ) -> EffectTerms:
        """Return the terms of the effects for a response; ``index`` is the grid index of each expected grey level."""
        irradiance = np.exp(basis.log_of(coefficients))
        first, last = self.groups
        seen = Circumstances(
            observations,
            np.exp(observations.log_exposure - self.log_typical_exposure),
            2 * (observations.group - first) / max(last - first, 1) - 1,
            basis.grid[index],
            basis.gamma_of(coefficients)[index],
            _light_of_moments(basis.grid, irradiance),
            self.absorbed,
        )
        amounts = {name: EFFECTS[name].amount(seen) for name in self.chosen}
        return EffectTerms(seen.exposure, np.maximum(irradiance[index], DARKEST_IRRADIANCE), amounts)

    def without_absorbed_light(self, basis: ResponseBasis, parameters: FloatArray) -> tuple[Effects, FloatArray]:
        """Return the effects for a response without additional light, and the converted parameters.

        These are the coefficients of the response, any others, and last those of the effects, shape (p,).
        """
        n = len(basis)
        irradiance = np.exp(basis.log_of(parameters[:n]))
        factors = _light_of_moments(basis.grid, irradiance)
        values = dict(zip(self.chosen, parameters[len(parameters) - len(self) :], strict=True))
        glare, scatter, dark = (values.get(name, 0.0) for name in CORRECTED[:3])
        share, *around = self.absorbed.surround_moments
        # The response g̃ containing the light and the one without it, g, satisfy g ∝ g̃ + c. Mean irradiances contain
        # c, too: hence the divisor.
        held = (
            glare * (self.absorbed.frame_moments @ factors) + scatter * (around @ factors) + dark * self.absorbed.dark
        )
        constant = held / (1 - glare - scatter * share)
        at_knots = np.maximum(np.interp(basis.knots, basis.grid, irradiance), np.finfo(np.float64).tiny)
        changed = parameters.copy()
        changed[:n] = np.maximum(parameters[:n] * at_knots / (at_knots + constant), MIN_GAMMA)
        if "dark current" in values:
            changed[len(parameters) - len(self) + self.chosen.index("dark current")] /= 1 + constant
        return replace(self, absorbed=AbsorbedLight()), changed

    def log_gain(self, values: FloatArray, terms: EffectTerms) -> FloatArray:
        """Return the increase of ln g due to the effects, shape (n,)."""
        added, factor, log_gain = self._parts(values, terms)
        return np.asarray(log_gain + np.log(factor) - np.log(1 - added))

    def log_added(self, values: FloatArray, terms: EffectTerms) -> FloatArray:
        """Return the part of :meth:`log_gain` due to additional light, shape (n,)."""
        return np.asarray(-np.log(1 - self._parts(values, terms)[0]))

    def jacobian(self, values: FloatArray, terms: EffectTerms) -> FloatArray:
        """Return the derivative of :meth:`log_gain` by the parameters, shape (n, len)."""
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


def _light_of_moments(grid: FloatArray, irradiance: FloatArray) -> FloatArray:
    """Return the factors on moments whose weighted sum is the mean irradiance; see :class:`Circumstances`.

    The first are the coefficients of the powers of M in the best fit to g; the last is the excess of white pixels.
    """
    grey, light = grid[::PIXEL_NOISE_STRIDE], irradiance[::PIXEL_NOISE_STRIDE]
    weight = 1 / (light + LIGHT_FIT_FLOOR)
    rows = grey[:, None] ** np.arange(1, POWERS + 1) * weight[:, None]
    return np.append(np.linalg.lstsq(rows, light * weight, rcond=None)[0], BEYOND_WHITE)
