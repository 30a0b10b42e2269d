"""Contradictions of one response and one vignette, detected in the residuals of image regions and of frames.

Dirt, scratches and shading correction make regions of the image darker or brighter than a smooth vignette. Automatic
contrast and electronic stabilisation make response and vignette differ between frames; local contrast changes
individual points.
"""

from __future__ import annotations

import math

import numpy as np

from ospc.arrays import FloatArray, IntArray, members_of
from ospc.numerics.robust import median, medians, robust_scale
from ospc.observations import ExposedObservations
from ospc.photometry.geometry import cells_of
from ospc.photometry.verdict import EffectEstimate
from ospc.settings.error_model import DARKEST_GREY
from ospc.settings.fit import WEIGHT_CUT_SIGMAS
from ospc.settings.residuals import (
    MOST_RADIANCE_SIGMA,
    REJECTED_FEWEST,
    REJECTED_NOISE_SIGMAS,
    REJECTED_SCALES,
    REJECTED_TYPICAL_SCALES,
    UNEVEN_CELLS,
    UNEVEN_FEWEST,
    UNEVEN_FEWEST_BLOCKS,
    UNEVEN_GROUPS_PER_BLOCK,
    UNEVEN_SIGMAS,
    UNEVEN_SYSTEMATIC,
    UNSTEADY_FEWEST_PAIRS,
    UNSTEADY_FEWEST_POINTS,
    UNSTEADY_SIGMAS,
    UNSTEADY_SLOPE,
    UNSTEADY_SPREAD,
)

UNEVEN, UNSTEADY_RESPONSE, UNSTEADY_VIGNETTE = "uneven vignette", "unsteady response", "unsteady vignette"
UNSTEADY_RADIANCE = "unsteady radiance"
UNSTEADY_LIGHT = "unsteady light"
"""Names of the findings."""


def uneven_vignette(
    residual: FloatArray, sigma: FloatArray, observations: ExposedObservations
) -> tuple[EffectEstimate, ...]:
    """Return the image region that a smooth vignette explains worst; empty if all regions are explained.

    Its value is ln of its brightness over that of the vignette: twice the residual, because a residual is relative to
    the mean of two observations. ``residual`` contains the :meth:`~ospc.estimation.fit.Fit.residuals` of a fit to the
    observations, and ``sigma`` their standard deviations by the fit's error model, shape (n,) each.
    """
    known = np.isfinite(residual)
    if not known.any():
        return ()
    cell = cells_of(observations.position, UNEVEN_CELLS)
    which = cell.astype(np.float64)
    leaves = observations.combined(np.minimum, which) < observations.combined(np.maximum, which)
    leaves, cell = np.repeat(leaves, observations.counts)[known], cell[known]
    residual, sigma, scale = residual[known], sigma[known], robust_scale(residual[known])
    _, block = np.unique(observations.group[known] // UNEVEN_GROUPS_PER_BLOCK, return_inverse=True)
    shape = (*UNEVEN_CELLS, block.max() + 1)
    number, limit = cell * shape[2] + block, WEIGHT_CUT_SIGMAS * scale
    count, leaving, total = (
        np.bincount(number, weights, math.prod(shape)).reshape(shape)
        for weights in (None, leaves, np.clip(residual, -limit, limit))
    )
    # A point that stays within a cell does not show how bright the cell is, and is often registered wrongly: where a
    # camera drives to, the texture is fine and hardly moves.
    rejected = _rejected_cell(residual[leaves], sigma[leaves], cell[leaves], leaving.reshape(-1, shape[2]), scale)
    found = rejected or _uneven_region(_in_regions(count), _in_regions(total), observations.error_factor)
    return () if found is None else (found,)


def _rejected_cell(
    residual: FloatArray, sigma: FloatArray, cell: IntArray, count: FloatArray, scale: float
) -> EffectEstimate | None:
    """Return the image cell whose points disagree most with the fit, if it rejects most of them as outliers."""
    # ``count`` has the number of residuals per cell and block, (cells, blocks); ``scale`` is the scatter of them all.
    if not len(residual):
        return None
    cells, member = np.unique(cell, return_inverse=True)
    points, blocks = count[cells].sum(axis=1), np.count_nonzero(count[cells], axis=1)
    judged = (points >= REJECTED_FEWEST) & (blocks >= UNEVEN_FEWEST_BLOCKS)
    # Where a cell is dark, noise alone may make residuals larger than in the rest of the image.
    judged &= medians(np.abs(residual) / sigma, member) > REJECTED_NOISE_SIGMAS
    middle, typical = (np.where(judged, medians(of, member), 0.0) for of in (residual, np.abs(residual)))
    excess = np.maximum(np.abs(middle) / REJECTED_SCALES, typical / REJECTED_TYPICAL_SCALES)
    worst = int(np.argmax(excess))
    if excess[worst] <= scale:
        return None
    size, sign = float(typical[worst]), math.copysign(1, middle[worst])
    of_size = robust_scale(np.abs(residual[member == worst]) - size) / math.sqrt(points[worst])
    return EffectEstimate(UNEVEN, 2 * sign * size, 2 * of_size, contradicts=True)


def _in_regions(cells: FloatArray | IntArray) -> FloatArray:
    """Return sums over all squares of four cells, which overlap, shape (across, down, b) -> (regions, b)."""
    squares = cells[:-1, :-1] + cells[1:, :-1] + cells[:-1, 1:] + cells[1:, 1:]
    return squares.reshape(-1, cells.shape[2]).astype(np.float64)


def _uneven_region(count: FloatArray, total: FloatArray, error_factor: float) -> EffectEstimate | None:
    """Return the region with the most significant mean; number and sum of residuals have shape (regions, blocks)."""
    points, blocks = count.sum(axis=1), np.count_nonzero(count, axis=1)
    judged = (points >= UNEVEN_FEWEST) & (blocks >= UNEVEN_FEWEST_BLOCKS)
    if not judged.any():
        return None
    count, total, points, blocks = count[judged], total[judged], points[judged], blocks[judged]
    mean = total.sum(axis=1) / points
    deviation = total - mean[:, None] * count
    sigma = error_factor * np.sqrt(np.sum(deviation**2, axis=1) * blocks / (blocks - 1)) / points
    sigmas = np.abs(mean) / np.hypot(sigma, UNEVEN_SYSTEMATIC)
    if sigmas.max() < UNEVEN_SIGMAS:
        return None
    from scipy.special import ndtri, stdtr  # slow to import and rarely needed

    # The scatter between few blocks is itself uncertain: the normal deviate of equal probability is smaller.
    freedom = points**2 / np.sum(count**2, axis=1) - 1
    sigmas = -ndtri(stdtr(freedom, -sigmas))
    worst = int(np.argmax(sigmas))
    if sigmas[worst] < UNEVEN_SIGMAS:
        return None
    return EffectEstimate(UNEVEN, 2 * float(mean[worst]), 2 * float(sigma[worst]), contradicts=True)


def unsteadiness(
    residual: FloatArray, sigma: FloatArray, observations: ExposedObservations
) -> tuple[EffectEstimate, ...]:
    """Return differences between the frames of a pair, from the residuals of a fit; empty if the pairs agree.

    With one response and one vignette, the radiances of the same points in two frames differ only by chance. If the
    exponent of one frame differs, their logarithms differ in proportion to ln M; if the vignette moved, in proportion
    to x and y. The value is the standard deviation of this slope between pairs, in excess of that expected from the
    scatter within pairs. Residuals and their standard deviations ``sigma`` are as in :func:`uneven_vignette`.
    """
    first = observations.starts
    last = first + observations.counts - 1
    change, weight = residual[last] - residual[first], 1 / (sigma[first] ** 2 + sigma[last] ** 2)
    known = np.flatnonzero(np.isfinite(change))
    pairs = [known[members] for members in members_of(observations.group[first][known])]
    log_grey = np.log(np.maximum(observations.grey, DARKEST_GREY))
    x, y = ((observations.position[first] + observations.position[last]) / 2).T
    found = []
    for name, covariates in (
        (UNSTEADY_RESPONSE, [(log_grey[first] + log_grey[last]) / 2]),
        (UNSTEADY_VIGNETTE, [x, y]),
    ):
        excess, slopes = max(
            _excess(covariate, change, weight, pairs, observations.error_factor) for covariate in covariates
        )
        if excess > UNSTEADY_SLOPE:
            found.append(EffectEstimate(name, excess, excess / math.sqrt(2 * slopes), contradicts=True))
    return tuple(found)


def unsteady_radiance(radiance_sigma: float, groups: int) -> tuple[EffectEstimate, ...]:
    """Return the variation of a point's radiance between frames, beyond noise; empty if it is normal.

    This is the variation without a known cause: ``radiance_sigma`` is that of the
    :class:`~ospc.estimation.error_model.ErrorModel` of a fit to ``groups`` groups.
    """
    if radiance_sigma < MOST_RADIANCE_SIGMA:
        return ()
    return (
        EffectEstimate(UNSTEADY_RADIANCE, radiance_sigma, radiance_sigma / math.sqrt(2 * groups), contradicts=True),
    )


def _excess(
    covariate: FloatArray, change: FloatArray, weight: FloatArray, pairs: list[IntArray], error_factor: float
) -> tuple[float, int]:
    """Return the standard deviation of the slope between pairs, 0 if chance explains it, and the number of slopes."""
    found = (_slope(covariate[pair], change[pair], weight[pair]) for pair in pairs)
    slopes = [one for one in found if one is not None]
    if len(slopes) < UNSTEADY_FEWEST_PAIRS:
        return 0.0, len(slopes)
    slope, by_scatter = np.array(slopes).T
    sigma = error_factor * by_scatter
    if robust_scale(slope / sigma) < UNSTEADY_SIGMAS:
        return 0.0, len(slopes)
    return float(np.sqrt(max(robust_scale(slope) ** 2 - float(np.median(sigma)) ** 2, 0.0))), len(slopes)


def _slope(x: FloatArray, change: FloatArray, weight: FloatArray) -> tuple[float, float] | None:
    """Return the slope of the changes of a pair and its standard deviation; None if it has too few points."""
    # Late in a long run most pairs have only one or two points left, and their medians would be slow.
    if len(x) < UNSTEADY_FEWEST_POINTS:
        return None
    deviation = (change - median(change)) * np.sqrt(weight)
    usual = np.abs(deviation) <= WEIGHT_CUT_SIGMAS * robust_scale(deviation)
    # Dark points with much noise or texture, which is corrected inexactly, hardly count.
    x, change, weight = x[usual], change[usual], weight[usual] / weight[usual].sum()
    x, y = x - x @ weight, change - change @ weight
    spread = float(x**2 @ weight)
    if len(x) < UNSTEADY_FEWEST_POINTS or spread < UNSTEADY_SPREAD**2:
        return None
    slope = float(x * y @ weight) / spread
    variance = float((y - slope * x) ** 2 @ weight) / (len(x) - 2) / spread
    return (slope, np.sqrt(variance)) if variance > 0 else None
