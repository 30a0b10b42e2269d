"""Exposure ratios that a calibration predicts for pairs of frames it was not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ospc.arrays import FloatArray, ImageSize
from ospc.evaluation.metrics import RatioError, exposure_ratio_error
from ospc.photometry.geometry import half_diagonal
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette
from ospc.simulation import SimulationSettings, irradiances
from ospc.simulation.responses import make_response, make_vignette

PAIRS, _VIEWS = 400, 12
"""Pairs of a simulated recording, enough to know the median error to a few percent, and views they are drawn from."""

_POINTS, _FEWEST_POINTS = 400, 50
"""Points of a pair, and how many of them must be exposed in both frames."""

_DARKEST, _BRIGHTEST = 5 / 255, 250 / 255
"""Grey levels outside of which a point counts as clipped."""

_METERED_GREY, _METER_SPREAD = 0.42, 0.35
"""Grey level that the simulated light meter aims at, and the standard deviation of ln of its error."""

_LOG_RATIOS = (0.1, 1.0)
"""Smallest and largest |ln k| of a pair."""

_PART, _LONGEST_SHIFT = 0.15, 0.5
"""Half the edge of the part of the scene that a pair shows, and its largest displacement, in half diagonals."""

_OTHER_SCENE = 10_007
"""Added to the seed for a room that the recording does not show."""


@dataclass(frozen=True)
class HeldOutPair:
    """Grey levels in [0, 1] of scene points in two frames, shape (n,), and where, in pixels (x, y), shape (n, 2).

    The exposure ratio is the true k = e₀/e₁.
    """

    grey0: FloatArray
    grey1: FloatArray
    points0: FloatArray
    points1: FloatArray
    exposure_ratio: float


@dataclass(frozen=True)
class HeldOut:
    """The pairs of a recording whose ratio is to be predicted, and those for the error of factors in percent."""

    pairs: Sequence[HeldOutPair] = ()
    factor_pairs: Sequence[HeldOutPair] = ()


def predicted_ratio(pair: HeldOutPair, response: Response, vignette: Vignette | None) -> float:
    """Return k̂, the median of g(M₀)V(x₁) / (g(M₁)V(x₀)) (paper, eq. mean); V ≡ 1 where it is None."""
    log_k = np.log(response.inverse(pair.grey0)) - np.log(response.inverse(pair.grey1))
    if vignette is not None:
        log_k += np.log(vignette.at(pair.points1)) - np.log(vignette.at(pair.points0))
    return float(np.exp(np.median(log_k)))


def prediction_error(pairs: Sequence[HeldOutPair], response: Response, vignette: Vignette | None) -> RatioError:
    """Return the error of predicted exposure ratios."""
    predicted = [predicted_ratio(pair, response, vignette) for pair in pairs]
    return exposure_ratio_error(predicted, [pair.exposure_ratio for pair in pairs])


def simulated_pairs(settings: SimulationSettings) -> list[HeldOutPair]:
    """Return pairs of frames that the simulated camera would take of another scene, without noise and quantisation.

    The radiance comes from rendered views of a room that the recording does not show. A light meter with some error
    exposes the first frame of a pair; |ln k| of the second is between 0.1 and 1. All points lie on one part of the
    scene, which the turning camera displaces by up to half of the half diagonal: over the whole image, an error of
    the vignette would cancel. A camera that is at rest in the recording is so here. Clipped points are left out;
    without noise this causes no selection bias.
    """
    response, vignette = make_response(settings.response), make_vignette(settings)
    views = _radiances(settings)
    typical = [float(np.median(radiance)) for radiance in views]
    longest_shift = 0.0 if settings.motion == "static" else _LONGEST_SHIFT
    random = np.random.default_rng([settings.seed, 77])
    pairs: list[HeldOutPair] = []
    for number in range(4 * PAIRS):
        radiance = views[number % len(views)]
        metered = float(response.inverse(_METERED_GREY)) / typical[number % len(views)]
        exposure0 = metered * np.exp(_METER_SPREAD * random.standard_normal())
        ratio = float(np.exp(random.choice([-1, 1]) * random.uniform(*_LOG_RATIOS)))
        points0, points1 = _places(random, settings.size, longest_shift)
        light = radiance[points0[:, 1].astype(int), points0[:, 0].astype(int)]
        grey0 = response(exposure0 * vignette.at(points0) * light)
        grey1 = response(exposure0 / ratio * vignette.at(points1) * light)
        kept = (np.minimum(grey0, grey1) >= _DARKEST) & (np.maximum(grey0, grey1) <= _BRIGHTEST)
        if np.count_nonzero(kept) >= _FEWEST_POINTS:
            pairs.append(HeldOutPair(grey0[kept], grey1[kept], points0[kept], points1[kept], ratio))
        if len(pairs) == PAIRS:
            break
    return pairs


def _places(random: np.random.Generator, size: ImageSize, longest_shift: float) -> tuple[FloatArray, FloatArray]:
    """Return the places of points in the two frames, shape (n, 2) each; n may be zero."""
    unit = half_diagonal(size)
    middle = random.uniform(0, size)
    points0 = np.rint(middle + random.uniform(-_PART, _PART, (_POINTS, 2)) * unit)
    angle = random.uniform(0, 2 * np.pi)
    shift = random.uniform(0, longest_shift) * unit * np.array([np.cos(angle), np.sin(angle)])
    points1 = points0 + shift
    last = np.array(size) - 1
    inside = np.all((points0 >= 0) & (points0 <= last) & (points1 >= 0) & (points1 <= last), axis=1)
    return points0[inside], points1[inside]


def _radiances(settings: SimulationSettings) -> list[FloatArray]:
    """Return the radiance of a few views of another scene, in saturations per millisecond."""
    other = replace(
        settings,
        seed=settings.seed + _OTHER_SCENE,
        scene_seed=None,
        frames=_VIEWS,
        fps=0.5,
        motion="handheld",
        vignette="none",
        exposure="constant",
        exposure_ms=1.0,
        flicker=0.0,
        moving_objects=0,
    )
    return [view.astype(np.float64) for view in irradiances(other)]
