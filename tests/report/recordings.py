"""Recordings of a wall by a static camera with different exposures and known grey values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.coverage import Coverage, ExposureRatios
from ospc.photometry.response import Response
from ospc.photometry.verdict import Verdict
from ospc.photometry.vignette import PolynomialVignette
from ospc.recording.recording import ArrayRecording

SIZE = (160, 120)
RESPONSE = Response.gamma(2.0)
VIGNETTE = PolynomialVignette(SIZE, (-0.4, 0.0, 0.0))


def before_a_wall(exposures_ms, *, max_grey=255):
    """Return a recording of a static scene without saturation at 10 ms."""
    wall = 0.08 * np.random.default_rng(3).uniform(0.2, 1.0, (12, 16)).repeat(10, axis=0).repeat(10, axis=1)
    images = [np.rint(RESPONSE(np.clip(wall * e * VIGNETTE.image(), 0, 1)) * max_grey) for e in exposures_ms]
    kind = np.uint8 if max_grey <= 255 else np.uint16
    return ArrayRecording(np.array(images).astype(kind), exposures_ms, max_grey=max_grey, name="wall")


def coverage(*, still=False, residuals=True):
    """Return a coverage without the darkest grey levels and the corners."""
    rng = np.random.default_rng(1)
    grey, radius = rng.integers(0, 500, (6, 32)), rng.integers(0, 300, (20, 20))
    grey[:, :4] = 0
    radius[:, -2:] = radius[-2:] = 0
    if still:
        radius = np.diag(np.full(20, 100))
    by_grey, by_radius = (np.sort(rng.normal(0, 0.01, (n, 3))) for n in (32, 20))
    by_grey[:4] = np.nan
    place = rng.normal(0, 0.01, (6, 8))
    place[0, 0] = np.nan
    found = (by_grey, by_radius, place) if residuals else (None, None, None)
    return Coverage(np.geomspace(1, 10, 7), grey, radius, *found)


def calibration(**changes):
    pairs = np.stack([np.arange(11), np.arange(11) + 1], axis=1)
    k = np.geomspace(0.5, 2, 11)
    sigma = 0.02 * np.sin(np.pi * RESPONSE.levels)
    content = {
        "size": SIZE,
        "response": replace(RESPONSE, log_sigma=sigma, scale_sigma=0.03, support=(0.05, 0.9)),
        "vignette": VIGNETTE,
        "vignette_sigma": 0.02 * PROFILE_RADII,
        "verdicts": {part: Verdict("identifiable", "it was seen") for part in ("response", "vignette")},
        "exposure_ratios": ExposureRatios(pairs, k, k * 1.01, np.full(11, 200)),
        "coverage": coverage(),
        "counts": {"frames": 24, "skipped": 0, "pairs": 11, "samples": 9000},
        "settings": {"preset": "default", "views": 20},
        "source": {"name": "somewhere"},
    }
    return Calibration(**(content | changes))
