"""Kim and Pollefeys, "Robust radiometric calibration and vignetting correction", 2008.

1. Scene points at the same radius in two images have the same vignette. Their grey levels give, for each pair of
   images, the brightness transfer function τ: the most likely increasing path through the joint histogram.
2. ln g(τ(M)) − ln g(M) = K for all pairs and grey levels is linear in the coefficients of an empirical model of ln g
   and in the exposures K. The solution is known up to an exponent, which one K fixes; the publication assumes a
   constant, and uses the model of Grossberg and Nayar, whose tables are not distributed here.
3. With both known, all points give V(r₁) = a·V(r₂), where a is the median of g(M₁)/g(M₂)e⁻ᴷ over points with similar
   radii. This is linear in the coefficients of V.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import cv2
import numpy as np
from scipy.optimize import isotonic_regression

from ospc.arrays import FloatArray, IntArray, members_of
from ospc.errors import NotObservableError
from ospc.methods.paper import Correspondences
from ospc.numerics.robust import huber_weights, robust_scale
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette
from ospc.recording.frame import Frame
from ospc.research.method import Estimate, Outcome, outcomes_of
from ospc.unknown_exposures.response_model import family_of_inverses
from ospc.unknown_exposures.tracking import equalised, log_brightness, sampled

_LEVELS = 256
_COMPONENTS, _DARKEST = 5, 1e-4
"""Number of components of the model, as published, and g at which ln g is cut off."""
_SAME_RADIUS, _MOVING = 0.03, 0.1
"""Largest |r₁ − r₂| of points for the response, and smallest for the vignette."""
_FEWEST, _FEWEST_LEVELS = 400, 60
"""Fewest points of a pair, and fewest grey levels of its transfer function."""
_RINGS, _FEWEST_IN_CELL = 25, 10
"""Number of radius bins, and fewest points in a cell of two bins that counts."""
_PULL = 3.0
"""Weight of the mean curve, needed because the errors of the grey levels of one pair are correlated."""
_ASSUMED_LOG_RATIO, _LEAST_LOG_CHANGE = float(np.log(1.5)), 0.03
"""ln of the exposure ratio that the publication assumes, and least change of ln brightness to fix the exponent."""
_FLOOR, _CEILING = 3, 250
"""Grey levels beyond which ratios are too noisy or saturated."""
_HUBER = 1.345
"""Huber's tuning constant: 95 % efficient for normal residuals."""
_STEP_PX, _BACK_PX, _SMOOTHING_PX = 3, 1.0, 1.2
"""Spacing of the points, largest forward-backward error of the flow, and smoothing of the grey levels."""

_EXPONENTS = 2 * np.arange(1, 4)


def estimate_decoupled(
    pairs: Sequence[Correspondences], log_ratios: Sequence[float] | None = None
) -> tuple[Estimate, FloatArray]:
    """Return response and vignette from points visible in both images of each pair, and the K of pairs, shape (n,).

    ``log_ratios`` are ln of the exposure ratio e₀/e₁ of each pair. Only the largest is used, which fixes the
    exponent. If None, the ratio of the pair with the largest change in brightness is assumed to be 1.5 or 1/1.5.

    Raises
    ------
    NotObservableError
        If the brightness of no pair changes, or too few points move radially.
    """
    found = [(number, _transfer(pair)) for number, pair in enumerate(pairs)]
    transfers = [(number, *transfer) for number, transfer in found if transfer is not None]
    if not transfers:
        raise NotObservableError("no pair of images has enough points at equal radius to show how brightness changes")
    response, by_pair = _solve_response(transfers, log_ratios)
    ratios = np.array([by_pair.get(number, np.nan) for number in range(len(pairs))])
    return Estimate(response, _solve_vignette(pairs, response, ratios)), ratios


def _transfer(pair: Correspondences) -> tuple[IntArray, IntArray, FloatArray] | None:
    """Return grey levels M₁, τ(M₁) and the number of points that support them; None if there are too few."""
    still = pair.select(pair.radial_displacement < _SAME_RADIUS)
    if len(still) < _FEWEST:
        return None
    first, second = (np.clip(np.rint(255 * grey), 0, 255).astype(np.int64) for grey in (still.grey0, still.grey1))
    histogram = np.bincount(first * _LEVELS + second, minlength=_LEVELS**2).reshape(_LEVELS, _LEVELS)
    smooth = cv2.GaussianBlur(histogram.astype(np.float64), (0, 0), 2.0)
    likely = np.log1p(20 * smooth)
    # Dynamic programming: the best increasing path that ends at (M₁, M₂).
    total = np.empty_like(likely)
    origin = np.empty(likely.shape, dtype=np.int64)
    total[0], origin[0] = likely[0], np.arange(_LEVELS)
    for level in range(1, _LEVELS):
        best = np.maximum.accumulate(total[level - 1])
        changes = total[level - 1] >= best
        origin[level] = np.maximum.accumulate(np.where(changes, np.arange(_LEVELS), 0))
        total[level] = likely[level] + best
    path = np.empty(_LEVELS, dtype=np.int64)
    path[-1] = int(np.argmax(total[-1]))
    for level in range(_LEVELS - 1, 0, -1):
        path[level - 1] = origin[level][path[level]]
    support = cv2.boxFilter(smooth, -1, (5, 1), normalize=False)[np.arange(_LEVELS), path]
    levels = np.arange(_LEVELS)
    kept = (support > 1) & (levels >= _FLOOR) & (path >= _FLOOR) & (levels < _CEILING) & (path < _CEILING)
    if np.count_nonzero(kept) < _FEWEST_LEVELS:
        return None
    return levels[kept], path[kept], support[kept]


def _solve_response(
    transfers: Sequence[tuple[int, IntArray, IntArray, FloatArray]], log_ratios: Sequence[float] | None
) -> tuple[Response, dict[int, float]]:
    """Solve Σ cₖ(hₖ(M₁) − hₖ(τ)) − K = −(g₀(M₁) − g₀(τ)), all in ln, with one K fixed."""
    mean, components = _log_model()
    changes = [float(np.average(np.log(m1 / m2), weights=w)) for _, m1, m2, w in transfers]
    numbers = [number for number, *_ in transfers]
    known = changes if log_ratios is None else [log_ratios[number] for number in numbers]
    fixed = int(np.argmax(np.abs(known)))
    value = known[fixed] if log_ratios is not None else float(np.sign(changes[fixed])) * _ASSUMED_LOG_RATIO
    if abs(changes[fixed]) < _LEAST_LOG_CHANGE:
        raise NotObservableError("brightness changes in no pair of images; the response cannot be determined")
    count = len(components)
    rows, targets = [], []
    for column, (_, first, second, support) in enumerate(transfers):
        inner = np.zeros((first.size, count + len(transfers)))
        inner[:, :count] = (components[:, first] - components[:, second]).T
        inner[:, count + column] = -1
        root = np.sqrt(np.minimum(support, 50))
        rows.append(inner * root[:, None])
        targets.append((mean[second] - mean[first]) * root)
    matrix, target = np.concatenate(rows), np.concatenate(targets)
    target = target - matrix[:, count + fixed] * value
    # A weak pull towards the mean curve determines what no pair does.
    pull = _PULL * np.eye(count, count + len(transfers) - 1)
    found = _robust(np.delete(matrix, count + fixed, axis=1), target, pull)
    ratios = np.insert(found[count:], fixed, value)
    curve = np.exp(mean + found[:count] @ components)
    rising = isotonic_regression(curve).x + 1e-9 * np.arange(_LEVELS)
    rising[0] = 0.0
    response = Response.from_values(rising, model={"name": "kim-pollefeys", "coefficients": found[:count].tolist()})
    return response, dict(zip(numbers, ratios.tolist(), strict=True))


@cache
def _log_model() -> tuple[FloatArray, FloatArray]:
    """Return g₀, shape (256,), and hₖ, shape (5, 256), all in ln, learned from analytic families of curves."""
    curves = np.log(np.maximum(family_of_inverses(_LEVELS), _DARKEST))
    mean = curves.mean(axis=0)
    _, singular, directions = np.linalg.svd(curves - mean, full_matrices=False)
    # Coefficients of typical curves have unit variance.
    scale = singular[:_COMPONENTS, None] / np.sqrt(len(curves))
    return np.asarray(mean), np.asarray(directions[:_COMPONENTS] * scale)


def _robust(matrix: FloatArray, target: FloatArray, pull: FloatArray) -> FloatArray:
    """Solve least squares with Huber weights on the rows."""
    weight = np.ones(len(target))
    found: FloatArray = np.zeros(matrix.shape[1])
    for _ in range(10):
        normal = (matrix * weight[:, None]).T @ matrix + pull.T @ pull
        found = np.asarray(np.linalg.lstsq(normal, matrix.T @ (weight * target), rcond=None)[0], dtype=np.float64)
        residual = matrix @ found - target
        weight = huber_weights(residual, _HUBER * (robust_scale(residual) + 1e-9))
    return found


def _solve_vignette(pairs: Sequence[Correspondences], response: Response, ratios: FloatArray) -> PolynomialVignette:
    parts = []
    for pair, ratio in zip(pairs, ratios, strict=True):
        if np.isfinite(ratio):
            lowest, highest = np.minimum(pair.grey0, pair.grey1), np.maximum(pair.grey0, pair.grey1)
            some = pair.select((lowest > _FLOOR / 255) & (highest < 0.98))
            log = np.log(response.inverse(some.grey0)) - np.log(response.inverse(some.grey1)) - ratio
            parts.append((log, some.radius0, some.radius1))
    log, r1, r2 = (np.concatenate(one) for one in zip(*parts, strict=True))
    if np.count_nonzero(np.abs(r1 - r2) > _MOVING) < _FEWEST:
        raise NotObservableError("too few points move radially; the vignette cannot be determined")
    ring1, ring2 = (np.minimum(radius * _RINGS, _RINGS - 1).astype(int) for radius in (r1, r2))
    cell = ring1 * _RINGS + ring2
    rows, targets = [], []
    for members in members_of(cell):
        if members.size < _FEWEST_IN_CELL:
            continue
        ratio, weight = float(np.exp(np.median(log[members]))), np.sqrt(members.size)
        a, b = (np.mean(radius[members, None] ** _EXPONENTS, axis=0) for radius in (r1, r2))
        rows.append(weight * (a - ratio * b))
        targets.append(weight * (ratio - 1))
    found = np.linalg.lstsq(np.array(rows), np.array(targets), rcond=None)[0]
    return PolynomialVignette(pairs[0].size, tuple(found.tolist()))


class KimPollefeys:
    """The method, with the largest exposure ratio known and with it assumed."""

    EVERY, OFFSET = 5, 10
    """Frames between pairs, and between the two frames of a pair."""

    def __init__(self) -> None:
        self._waiting: dict[int, Frame] = {}
        self._pairs: list[Correspondences] = []
        self._log_ratios: list[float] = []
        self._count = 0

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        number = self._count
        self._count += 1
        if number % self.EVERY:
            return
        self._waiting[number] = frame
        earlier = self._waiting.pop(number - self.OFFSET, None)
        if earlier is not None:
            self._pairs.append(_registered(earlier, frame))
            self._log_ratios.append(float(np.log(earlier.exposure_ms / frame.exposure_ms)))

    def found(self) -> dict[str, Outcome]:
        """Return both variants."""
        return outcomes_of(
            {
                "kim-pollefeys-known": lambda: estimate_decoupled(self._pairs, self._log_ratios)[0],
                "kim-pollefeys-assumed": lambda: estimate_decoupled(self._pairs)[0],
            }
        )


def _registered(frame0: Frame, frame1: Frame) -> Correspondences:
    """Return grid points with their positions in the other image, if forward and backward flow agree."""
    image0, image1 = frame0.image_8_bit, frame1.image_8_bit
    first, second = equalised(image0, image1, log_brightness(image1) - log_brightness(image0))
    flow = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    there, back = flow.calc(first, second, None), flow.calc(second, first, None)
    height, width = image0.shape
    y, x = np.mgrid[4 : height - 4 : _STEP_PX, 4 : width - 4 : _STEP_PX].reshape(2, -1)
    points0 = np.column_stack([x, y]).astype(np.float32)
    points1 = points0 + there[y, x]
    returned = points1 + sampled(back, points1) - points0
    good = np.linalg.norm(returned, axis=1) < _BACK_PX
    good &= np.all((points1 > 3) & (points1 < np.array([width, height]) - 4), axis=1)
    points0, points1 = points0[good], points1[good]
    grey0, grey1 = (
        sampled(cv2.GaussianBlur(image, (0, 0), _SMOOTHING_PX).astype(np.float32), points) / 255
        for image, points in ((image0, points0), (image1, points1))
    )
    places = (points0.astype(np.float64), points1.astype(np.float64))
    return Correspondences((frame0.index, frame1.index), (width, height), *places, grey0, grey1)
