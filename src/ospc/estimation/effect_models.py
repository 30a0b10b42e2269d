"""The models of effects of optics, sensors and metadata other than response and vignette.

With the corrected effects, the irradiance of an observation is ``g(M) = a(e) (e + δ ē) V L + γ Ḡ + d(x) e/ē``, where
a is an unrecorded gain, Ḡ the mean of g over the frame, ē a typical exposure and d light that is fixed to the camera.
The other effects are not properties of a camera: they show that the recording contradicts the model.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ospc.arrays import FloatArray
from ospc.estimation.light_shapes import DARK_SIGNAL, SHAPES, STRAY_LIGHT, UNEVEN_GLARE
from ospc.observations import MOMENTS, SURROUND_MOMENTS, ExposedObservations
from ospc.photometry.verdict import LATE_EXPOSURES, NOMINAL_EXPOSURES
from ospc.settings.effects import (
    ADDED_LIGHT_MODEL_ERROR,
    BLACK_BY_EXPOSURE,
    BLACK_DRIFT,
    CURVATURE,
    FIXED_LIGHT,
    GAIN_STEP,
    GAIN_STEP_MODEL_ERROR,
    GLARE,
    GLARE_SHAPE,
    LATENESS,
    LATENESS_MODEL_ERROR,
    LEAST_NOMINAL,
    LIGHT_DRIFT,
    LOCAL_TONE,
    MOST_ADDED_LIGHT,
    MOST_LATE_FRAMES,
    MOST_NOMINAL,
    MOST_OFFSET,
    NOMINAL,
    OFFSET,
    RESPONSE_DRIFT,
    SCATTER,
    SQUARE_VIGNETTE,
    STEP_EXPOSURES,
    VIGNETTE_BY_EXPOSURE,
    VIGNETTE_DRIFT,
    WHITE_GLARE,
    WIDE_SCATTER,
)
from ospc.settings.error_model import DARKEST_GREY

Addition = Literal["light", "exposure", "log"]
"""The quantity that an effect adds to: the light on the sensor, the exposure, or ln g."""


@dataclass(frozen=True)
class AbsorbedLight:
    """The additional light that the response contains.

    A constant amount of it cannot be distinguished from the response. It is the light in an observation with rather
    little of it, given by the moments of the grey levels that cause it: of the frame and of the surroundings.
    """

    frame_moments: tuple[float, ...] = (0.0,) * MOMENTS
    white: tuple[float, float] = (0.0, 0.0)
    """Share of white pixels, and its product with the exposure, relative to the largest in a frame."""
    surround_moments: tuple[tuple[float, ...], ...] = ((0.0,) * SURROUND_MOMENTS[1],) * SURROUND_MOMENTS[0]


@dataclass(frozen=True)
class Circumstances:
    """Quantities that determine the amount of an effect, for n observations and a response."""

    observations: ExposedObservations
    """The observations."""
    exposure: FloatArray
    """Exposure relative to the typical one, shape (n,)."""
    time: FloatArray
    """Time from −1 in the first group to 1 in the last, shape (n,)."""
    part_of_recording: FloatArray
    """Time from 0 in the first frame to 1 in the last, or to less in few frames, shape (n,). It differs between the
    frames of a group."""
    grey: FloatArray
    """Expected grey levels, shape (n,)."""
    gamma: FloatArray
    """Local gamma at these grey levels, shape (n,)."""
    light_of_moments: FloatArray
    """Factors on the moments of grey levels; the weighted sum is their mean irradiance, shape (6,)."""
    absorbed: AbsorbedLight
    """The additional light contained in the response."""
    most_white: tuple[float, float]
    """Largest share of white pixels in a frame, and of its product with the exposure relative to the typical one."""
    step_exposures: tuple[float, ...]
    """Exposures relative to the typical one, beyond which the gain may differ, shape (15,)."""

    @property
    def position(self) -> FloatArray:
        """Positions of the observations, in half diagonals, shape (n, 2)."""
        return self.observations.position

    @property
    def light_of_frame(self) -> FloatArray:
        """Mean irradiance of the frame in excess of that contained in the response, shape (n,)."""
        return (self.observations.frame_moments - self.absorbed.frame_moments) @ self.light_of_moments

    def white(self, power: int) -> FloatArray:
        """Return the share of white pixels in excess of that contained in the response, shape (n,).

        It is multiplied by a power, 0 or 1, of the exposure, and relative to the largest in a frame.
        """
        light = self.observations.frame_moments[:, -1] * self.exposure**power
        return light / self.most_white[power] - self.absorbed.white[power]

    def light_around(self, number: int) -> FloatArray:
        """Return the mean irradiance around each point in excess of that contained in the response, shape (n,).

        ``number`` is that of the distance over which light is scattered.
        """
        around = self.observations.surround_moments[:, number, 1:]
        return np.asarray((around - self.absorbed.surround_moments[number][1:]) @ self.light_of_moments)

    @property
    def grey_around(self) -> FloatArray:
        """Mean grey level of the surroundings that receive light, 1 if none do, shape (n,)."""
        share, total = self.observations.surround_moments[:, 0, :2].T.astype(np.float64)
        return np.maximum(np.where(share > 0, total / np.maximum(share, DARKEST_GREY), 1.0), DARKEST_GREY)


@dataclass(frozen=True)
class Effect:
    """One effect."""

    adds: Addition
    """The quantity it adds to."""
    amount: Callable[[Circumstances], FloatArray]
    """The amount that a parameter of 1 adds to each of n observations, in irradiance, typical exposures or ln g,
    shape (n,)."""
    sigma: float
    """Prior standard deviation of the parameter in cameras with the effect."""
    usual_sigma: float
    """The same in all other cameras."""
    systematic: float
    """Standard deviation of spurious values of the parameter in clean recordings."""
    model_error: float = 0.0
    """Standard deviation of the parameter of a real effect, which its model only approximates, as a share of it."""
    least: float = -np.inf
    most: float = np.inf
    """Plausible range of the parameter: there is no negative light."""
    alternatives: int = 1
    """Number of effects, including this one, of which a camera has at most one."""

    def allows(self, value: float) -> bool:
        """Return whether a value of the parameter is plausible."""
        return self.least <= value <= self.most


def _light(
    amount: Callable[[Circumstances], FloatArray],
    sigmas: tuple[float, float, float],
    least: float = 0.0,
    alternatives: int = 1,
) -> Effect:
    """Return an effect that adds light."""
    return Effect("light", amount, *sigmas, ADDED_LIGHT_MODEL_ERROR, least, MOST_ADDED_LIGHT, alternatives)


def _shaped_light(
    where: str, strength: Callable[[Circumstances], FloatArray], sigmas: tuple[float, float, float], alternatives: int
) -> Effect:
    """Return the effect of light with a shape in the image, given how strong it is in each observation."""
    shape = SHAPES[where]
    return _light(lambda seen: strength(seen) * shape(*seen.position.T), sigmas, -MOST_ADDED_LIGHT, alternatives)


def _mean_of_frame(seen: Circumstances) -> FloatArray:
    """Return the mean irradiance of the frame, shape (n,)."""
    return np.asarray(seen.observations.frame_moments @ seen.light_of_moments)


def _gain_step(number: int) -> Effect:
    """Return the effect of a gain that differs beyond one of the step exposures."""
    return Effect(
        "log",
        lambda seen: (seen.exposure > seen.step_exposures[number]).astype(np.float64),
        *GAIN_STEP,
        GAIN_STEP_MODEL_ERROR,
        alternatives=STEP_EXPOSURES,
    )


def _missing_of_nominal(seen: Circumstances) -> FloatArray:
    """Return ln of the closest 2^(n/3) or 2^(n/2) s relative to the exposure: cameras call 1/64 s 1/60 s."""
    # A camera sets either thirds or halves of a stop: those that are closer to most of its exposures.
    typical = seen.observations.log_exposure[:1] - np.log(seen.exposure[:1])
    of_camera = np.log(seen.step_exposures) + typical
    per_stop = min((3, 2), key=lambda n: np.nansum(np.abs(_missing_of_steps(of_camera, n))))
    return _missing_of_steps(seen.observations.log_exposure, per_stop)


def _missing_of_steps(log_exposure: FloatArray, per_stop: int) -> FloatArray:
    """Return ln of the closest exposure in steps of 2^(1/per_stop), counted from 1 s, relative to each exposure."""
    steps = (log_exposure - math.log(1000)) / math.log(2) * per_stop
    return np.asarray((np.rint(steps) - steps) / per_stop * math.log(2))


def _four_fold(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return R⁴ cos 4φ: positive along the axes, negative along the diagonals."""
    return np.asarray(x**4 - 6 * x**2 * y**2 + y**4)


def _step_name(number: int) -> str:
    return f"gain step {number + 1} of {STEP_EXPOSURES}"


GLARE_OF_WHITE = ("glare of white pixels", "glare of white pixels by exposure")
"""Glare by the light of white pixels, whose grey level does not show it, beyond the typical light that is assumed.
That of the sky and of lamps grows with the exposure."""

EXPOSURE_OFFSET, LOCAL_TONE_MAPPING = "exposure offset", "local tone mapping"
DRIFTING_RESPONSE, DRIFTING_BLACK, DRIFTING_VIGNETTE = (
    f"drifting {what}" for what in ("response", "black level", "vignette")
)
DRIFTING_LIGHT = "drifting light"
"""The light of the scene rises or falls evenly, as at dusk or while a lamp warms up."""

GAIN_STEPS = tuple(map(_step_name, range(STEP_EXPOSURES)))
"""The gain differs beyond an exposure, which so many sixteenths of the observations do not exceed."""

EFFECTS = {
    # Light is relative to that contained in the response.
    "veiling glare": _light(lambda seen: seen.light_of_frame, GLARE),
    "light scattered nearby": _light(lambda seen: seen.light_around(0), SCATTER),
    "light scattered widely": _light(lambda seen: seen.light_around(1), WIDE_SCATTER),
    GLARE_OF_WHITE[0]: _light(lambda seen: seen.white(0), WHITE_GLARE, -MOST_ADDED_LIGHT),
    GLARE_OF_WHITE[1]: _light(lambda seen: seen.white(1), WHITE_GLARE, -MOST_ADDED_LIGHT),
    **{
        name: _shaped_light(where, _mean_of_frame, GLARE_SHAPE, len(UNEVEN_GLARE))
        for name, where in UNEVEN_GLARE.items()
    },
    **{
        name: _shaped_light(where, lambda seen: seen.exposure, FIXED_LIGHT, len(SHAPES))
        for name, where in STRAY_LIGHT.items()
    },
    **{
        name: _shaped_light(where, lambda seen: np.ones_like(seen.exposure), FIXED_LIGHT, len(SHAPES))
        for name, where in DARK_SIGNAL.items()
    },
    EXPOSURE_OFFSET: Effect(
        "exposure", lambda seen: np.ones_like(seen.exposure), *OFFSET, least=-MOST_OFFSET, most=MOST_OFFSET
    ),
    LATE_EXPOSURES: Effect(
        "log",
        lambda seen: seen.observations.log_exposure_rate,
        *LATENESS,
        LATENESS_MODEL_ERROR,
        least=-MOST_LATE_FRAMES,
        most=MOST_LATE_FRAMES,
    ),
    DRIFTING_LIGHT: Effect("log", lambda seen: seen.part_of_recording, *LIGHT_DRIFT),
    NOMINAL_EXPOSURES: Effect("log", _missing_of_nominal, *NOMINAL, least=LEAST_NOMINAL, most=MOST_NOMINAL),
    **{name: _gain_step(number) for number, name in enumerate(GAIN_STEPS)},
    # The grey level is multiplied by a power θ of that of the surroundings.
    LOCAL_TONE_MAPPING: Effect("log", lambda seen: seen.gamma * np.log(seen.grey_around), *LOCAL_TONE),
    "curved exposures": Effect("log", lambda seen: np.log(seen.exposure) ** 2, *CURVATURE),
    # The grey level has a power of 1 + θ; it rises by θ.
    DRIFTING_RESPONSE: Effect("log", lambda seen: seen.time * seen.gamma * np.log(seen.grey), *RESPONSE_DRIFT),
    DRIFTING_BLACK: Effect("log", lambda seen: seen.time * seen.gamma / seen.grey, *BLACK_DRIFT),
    "black level by exposure": Effect(
        "log", lambda seen: np.log(seen.exposure) * seen.gamma / seen.grey, *BLACK_BY_EXPOSURE
    ),
    DRIFTING_VIGNETTE: Effect("log", lambda seen: seen.time * np.sum(seen.position**2, axis=1), *VIGNETTE_DRIFT),
    "vignette by exposure": Effect(
        "log", lambda seen: np.log(seen.exposure) * np.sum(seen.position**2, axis=1), *VIGNETTE_BY_EXPOSURE
    ),
    "square vignette": Effect("log", lambda seen: _four_fold(*seen.position.T), *SQUARE_VIGNETTE),
    "vignette moving sideways": Effect("log", lambda seen: seen.time * seen.position[:, 0], *VIGNETTE_DRIFT),
    "vignette moving vertically": Effect("log", lambda seen: seen.time * seen.position[:, 1], *VIGNETTE_DRIFT),
}
"""All effects by name."""

LIGHT_FIXED_TO_CAMERA = (*STRAY_LIGHT, *DARK_SIGNAL)
"""Light that does not come from the scene."""

SCATTERED_LIGHT = ("veiling glare", "light scattered nearby", "light scattered widely", *GLARE_OF_WHITE)
"""Light of the scene that reaches other parts of the image."""

OF_STATIONARY_CAMERA = (EXPOSURE_OFFSET, NOMINAL_EXPOSURES, DRIFTING_LIGHT)
"""Errors that each exposure has wherever it recurs, and light that drifts meanwhile. Most other effects also change
with place or other light, which a stationary camera does not vary independently."""

CORRECTED = (
    *SCATTERED_LIGHT,
    *UNEVEN_GLARE,
    *LIGHT_FIXED_TO_CAMERA,
    EXPOSURE_OFFSET,
    LATE_EXPOSURES,
    DRIFTING_LIGHT,
    NOMINAL_EXPOSURES,
    *GAIN_STEPS,
)
"""Effects of real cameras. Those that the observations show are corrected in the result."""

CORRECTED_EXPOSURES = (EXPOSURE_OFFSET, NOMINAL_EXPOSURES, *GAIN_STEPS)
"""Corrected errors of the exposures that depend on the exposure alone, so that exposures can be corrected by them."""

COMMON = (*SCATTERED_LIGHT, EXPOSURE_OFFSET, LATE_EXPOSURES, DRIFTING_LIGHT)
"""Effects that any recording may have. They imitate each other: found alone, one takes up a part of the others."""

CURVES_OF_EXPOSURES = (EXPOSURE_OFFSET, "curved exposures", *GAIN_STEPS)
"""Errors that depend on the exposure alone. With few different exposures, some of them fit any errors."""

ONLY_IF_FOUND = (
    "light scattered widely",
    *GLARE_OF_WHITE,
    *UNEVEN_GLARE,
    *LIGHT_FIXED_TO_CAMERA,
    NOMINAL_EXPOSURES,
    *GAIN_STEPS,
)
"""Effects of many kinds, or that are either there or not: their size is only stated if the observations clearly show
them."""

CONTRADICTIONS = tuple(name for name in EFFECTS if name not in CORRECTED)
"""Effects that contradict a camera with one response and one vignette."""
