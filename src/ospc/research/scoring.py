"""Errors of an estimate against known truth, and of the exposure ratios it predicts for held-out frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ospc.arrays import FloatArray, ImageSize
from ospc.errors import ExposureError, counted
from ospc.evaluation.comparison import compare
from ospc.evaluation.metrics import Coverage, response_shape_rmse
from ospc.formats.opening import Photometry
from ospc.methods.paper import Correspondences, irradiance_ratios
from ospc.photometry.geometry import half_diagonal
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette, radial_profile
from ospc.research.measurement import METRICS
from ospc.research.method import Estimate
from ospc.simulation import SimulationSettings, irradiances
from ospc.simulation.responses import make_response, make_vignette


@dataclass(frozen=True)
class HeldOutPair(Correspondences):
    """The same scene points in two frames with a known exposure ratio k = e₀/e₁, which is to be predicted."""

    exposure_ratio: float


@dataclass(frozen=True)
class Truth:
    """What is known about the camera of a recording.

    If ``greys`` are given, the response is known only between these two grey values, and only its shape is compared.
    Exposures are by frame index; ``limits`` are those of :class:`Measurement`.
    """

    response: Response | None = None
    vignette: Vignette | None = None
    greys: tuple[int, int] | None = None
    exposures_ms: Mapping[int, float] = field(default_factory=dict)
    limits: dict[str, float] = field(default_factory=dict)


def score(estimate: Estimate, truth: Truth, held_out: Sequence[HeldOutPair] = ()) -> dict[str, float]:
    """Return the known figures of an estimate, by the names in :data:`~ospc.research.measurement.METRICS`.

    If the response is identical to the assumed truth, only its predictions are judged.
    """
    figures: dict[str, float] = {}
    response, vignette, true = estimate.response, estimate.vignette, truth.response
    if response is None or true is None or np.array_equal(response.inverse_table, true.inverse_table):
        true = None
    elif truth.greys is not None:
        figures["response_shape_rmse"] = response_shape_rmse(response, true, *truth.greys)
        true = None
    if true is not None or (vignette is not None and truth.vignette is not None):
        estimated = Photometry("estimate", response, vignette, estimate.calibration)
        found = compare(estimated, Photometry("truth", true, truth.vignette))
        values = {metric.figure: getattr(found, metric.figure, None) for metric in METRICS}
        figures |= {name: value for name, value in values.items() if value is not None}
        figures |= _shares("response", found.response_coverage)
        figures |= _shares("vignette", found.vignette_coverage)
    if response is not None and held_out:
        figures["ratio_median_abs"], figures["ratio_bias"] = prediction_error(held_out, response, vignette)
    if estimate.exposures is not None:
        figures["exposure_error"] = exposure_error(estimate.exposures, truth.exposures_ms)
    return figures


def _shares(part: str, found: Coverage | None) -> dict[str, float]:
    return {} if found is None else {f"{part}_{name}": share for name, share in found._asdict().items()}


def exposure_error(estimate: Mapping[int, float], truth: Mapping[int, float]) -> float:
    """Return the RMS error of ln e over the frames after removing the best common factor, which is unobservable.

    Raises
    ------
    ExposureError
        If an estimate is not positive, or belongs to a frame that the recording does not have.
    """
    values = np.array(list(estimate.values()), dtype=np.float64)
    if not np.all(np.isfinite(values) & (values > 0)):
        raise ExposureError("estimated exposures must be finite and above 0")
    unknown = len(estimate.keys() - truth.keys())
    if unknown or not estimate:
        raise ExposureError(
            f"exposures were estimated for {counted(len(estimate), 'frame')}, {unknown} of which are not in the "
            f"recording; give one for each frame"
        )
    return float(np.std(np.log(values) - np.log([truth[frame] for frame in estimate])))


def curves_of(found: Estimate | Truth) -> dict[str, list[float]]:
    """Return g at 256 grey levels and the profile of V in 50 rings, 1 at the centre, if they are known."""
    curves: dict[str, list[float]] = {}
    if found.response is not None:
        curves["response"] = found.response.inverse(np.arange(256) / 255).tolist()
    if found.vignette is not None:
        curves["vignette"] = radial_profile(found.vignette).tolist()
    return curves


PAIRS, _VIEWS = 400, 12
"""Pairs of a simulated recording, enough for a median error accurate to a few percent, and views they come from."""
_POINTS, _FEWEST_POINTS = 400, 50
"""Points of a pair, and how many of them must be well exposed in both frames."""
_DARKEST, _BRIGHTEST = 5 / 255, 250 / 255
"""Grey levels beyond which a point counts as clipped."""
_METERED_GREY, _METER_SPREAD = 0.42, 0.35
"""Grey level the simulated light meter aims at, and the standard deviation of its error in ln exposure."""
_LOG_RATIOS = (0.1, 1.0)
"""Smallest and largest |ln k| of a pair."""
_PART, _LONGEST_SHIFT = 0.15, 0.5
"""Half the edge of the scene part that a pair shows, and its largest displacement, in half diagonals."""
_OTHER_SCENE = 10_007
"""Added to the seed to get a room that the recording does not show."""


def predicted_ratio(pair: HeldOutPair, response: Response, vignette: Vignette | None) -> float:
    """Return k̂, the median over the points (paper, eq. mean); V ≡ 1 if it is None."""
    return float(np.exp(np.median(np.log(irradiance_ratios(pair, response, vignette)))))


def prediction_error(
    pairs: Sequence[HeldOutPair], response: Response, vignette: Vignette | None
) -> tuple[float, float]:
    """Return the medians of |ln k̂ − ln k| and of (ln k̂ − ln k)·sign(ln k), positive if changes are overestimated."""
    log_true = np.log([pair.exposure_ratio for pair in pairs])
    residual = np.log([predicted_ratio(pair, response, vignette) for pair in pairs]) - log_true
    return float(np.median(np.abs(residual))), float(np.median(residual * np.sign(log_true)))


def simulated_pairs(settings: SimulationSettings) -> list[HeldOutPair]:
    """Return frame pairs that the simulated camera would take of another scene, without noise and quantisation.

    The radiance comes from rendered views of a room that the recording does not show. An imperfect light meter
    exposes the first frame of a pair; |ln k| is between 0.1 and 1. All points lie on one part of the scene, which the
    turning camera displaces by up to half of the half diagonal; over the whole image, vignette errors would cancel. A
    camera that is static in the recording is static here. Clipped points are left out, which causes no selection bias
    without noise.
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
            pair = HeldOutPair((0, 1), settings.size, points0, points1, grey0, grey1, ratio)
            pairs.append(pair.select(kept))
        if len(pairs) == PAIRS:
            break
    return pairs


def _places(random: np.random.Generator, size: ImageSize, longest_shift: float) -> tuple[FloatArray, FloatArray]:
    """Return point positions in the two frames, shape (n, 2) each; n may be zero."""
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
    """Return the radiance of a few views of another scene, in saturation levels per millisecond."""
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
