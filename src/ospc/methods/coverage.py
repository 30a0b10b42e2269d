"""Coverage of the observations, and their residuals from a fit."""

from __future__ import annotations

import numpy as np

from ospc.arrays import FloatArray, ImageSize, IntArray
from ospc.estimation.fit import Fit
from ospc.observations import ExposedObservations
from ospc.photometry.coverage import QUANTILES, Coverage
from ospc.photometry.geometry import pixels_of
from ospc.photometry.grey_range import FULL_RANGE, GreyRange
from ospc.settings.methods import (
    GREY_CLASSES,
    MAX_EXPOSURE_CLASSES,
    MIN_CLASS_RESIDUALS,
    PLACE_COLUMNS,
    RADIUS_CLASSES,
    RESIDUAL_DECIMALS,
)


def coverage_of(
    observations: ExposedObservations, fit: Fit | None, size: ImageSize, grey_range: GreyRange = FULL_RANGE
) -> Coverage:
    """Return the tables of a report: counts of observations and, with a fit to them, their residuals.

    ``size`` is the frame size in pixels, ``grey_range`` the range to which the observations are stretched.
    """
    radius = np.linalg.norm(observations.position, axis=1)
    ring = np.clip((radius * RADIUS_CLASSES).astype(np.int64), 0, RADIUS_CLASSES - 1)
    original = grey_range.grey(observations.grey)
    grey = np.clip((original * GREY_CLASSES).astype(np.int64), 0, GREY_CLASSES - 1)
    edges = _exposure_edges(observations.log_exposure)
    exposure = np.clip(np.searchsorted(edges, observations.log_exposure, "right") - 1, 0, len(edges) - 2)
    later = np.flatnonzero(np.diff(observations.point) == 0) + 1
    by_exposure = _counts(exposure, grey, (len(edges) - 1, GREY_CLASSES))
    by_radii = _counts(ring[later - 1], ring[later], (RADIUS_CLASSES, RADIUS_CLASSES))
    if fit is None:
        return Coverage(np.exp(edges), by_exposure, by_radii)
    residual = fit.residuals(observations)
    rows = max(1, round(PLACE_COLUMNS * size[1] / size[0]))
    by_place = _quantiles(residual, _place(observations, size, rows), rows * PLACE_COLUMNS)
    return Coverage(
        np.exp(edges),
        by_exposure,
        by_radii,
        residual_by_grey=_quantiles(residual, grey, GREY_CLASSES),
        residual_by_radius=_quantiles(residual, ring, RADIUS_CLASSES),
        residual_by_place=by_place[:, QUANTILES.index(0.5)].reshape(rows, PLACE_COLUMNS),
    )


def _exposure_edges(log_exposure: FloatArray) -> FloatArray:
    """Return limits of equal classes of ln e, at most as many as there are values."""
    low, high = float(log_exposure.min()), float(log_exposure.max())
    classes = min(MAX_EXPOSURE_CLASSES, len(np.unique(log_exposure)))
    room = max(1e-3, 1e-6 * abs(high))  # to include the highest value in the last class
    return np.linspace(low, high + room, classes + 1)


def _counts(first: IntArray, second: IntArray, shape: tuple[int, int]) -> IntArray:
    return np.bincount(first * shape[1] + second, minlength=shape[0] * shape[1]).reshape(shape)


def _place(observations: ExposedObservations, size: ImageSize, rows: int) -> IntArray:
    pixel = pixels_of(observations.position, size)
    cells = np.array([PLACE_COLUMNS, rows])
    cell = np.clip((pixel / np.array(size) * cells).astype(np.int64), 0, cells - 1)
    return np.asarray(cell[:, 1] * PLACE_COLUMNS + cell[:, 0])


def _quantiles(residual: FloatArray, member: IntArray, classes: int) -> FloatArray:
    """Return :data:`QUANTILES` of the residuals of each class, shape (classes, 3)."""
    known = np.isfinite(residual)
    residual, member = residual[known], member[known]
    order = np.argsort(member, kind="stable")
    parts = np.split(residual[order], np.cumsum(np.bincount(member, minlength=classes))[:-1])
    found = np.full((classes, len(QUANTILES)), np.nan)
    for row, part in zip(found, parts, strict=True):
        if len(part) >= MIN_CLASS_RESIDUALS:
            row[:] = np.quantile(part, QUANTILES)
    return np.round(found, RESIDUAL_DECIMALS)  # so that a calibration equals that in its file
