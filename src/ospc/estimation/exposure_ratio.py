"""Exposure ratios re-estimated from grey values: the test of response and vignette (paper, eq. mean)."""

from __future__ import annotations

import numpy as np

from ospc.arrays import FloatArray
from ospc.correspondence.correspondences import Correspondences
from ospc.photometry.calibration import ExposureRatios
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette


def irradiance_ratios(pairs: Correspondences, response: Response, vignette: Vignette | None) -> FloatArray:
    """Return g(M₀)V(x₁) / (g(M₁)V(x₀)) of each correspondence, shape (n,), V ≡ 1 where it is None."""
    ratio = response.inverse(pairs.grey0) / response.inverse(pairs.grey1)
    if vignette is not None:
        ratio = ratio * vignette.at(pairs.points1) / vignette.at(pairs.points0)
    return np.asarray(ratio)


def mean_exposure_ratio(pairs: Correspondences, response: Response, vignette: Vignette | None) -> float:
    """Return k̂, the mean ratio over the correspondences of a pair (paper, eq. mean)."""
    return float(np.mean(irradiance_ratios(pairs, response, vignette)))


def estimate_ratios(pairs: list[Correspondences], response: Response, vignette: Vignette | None) -> ExposureRatios:
    """Return the mean exposure ratio of every pair of frames against the metadata."""
    used = [p for p in pairs if len(p)]
    if not used:
        return ExposureRatios.none()
    return ExposureRatios(
        np.array([p.frames for p in used], dtype=np.int64),
        np.array([p.exposure_ratio for p in used]),
        np.array([mean_exposure_ratio(p, response, vignette) for p in used]),
        np.array([len(p) for p in used], dtype=np.int64),
    )


def disagreement(ratios: ExposureRatios) -> float:
    """Return the median of |ln k̂ − ln k| over the pairs; infinite without pairs."""
    residual = np.abs(ratios.log_residual)
    return float(np.median(residual)) if residual.size else float("inf")
