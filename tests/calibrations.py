"""Calibrations for tests of the code that uses them."""

from __future__ import annotations

import numpy as np

from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.coverage import ExposureRatios
from ospc.photometry.response import Response
from ospc.photometry.verdict import Verdict
from ospc.photometry.vignette import PolynomialVignette

SIZE = (64, 48)


def ratios(pairs: int = 40) -> ExposureRatios:
    """Return noisy ratios from 1/4 to 4; every fifth one is based on few samples."""
    metadata = np.geomspace(0.25, 4, pairs)
    noise = np.random.default_rng(0).normal(0, 0.01, pairs)
    frames = np.stack([np.arange(pairs), np.arange(pairs) + 1], axis=1)
    samples = np.where(np.arange(pairs) % 5 == 0, 10, 300)
    return ExposureRatios(frames, metadata, metadata * np.exp(noise), samples)


def calibration(*, response: bool = True, vignette: bool = True, max_grey: int = 255, **changes) -> Calibration:
    """Return a calibration with the requested parts."""
    levels = min(max_grey + 1, 4096)
    sigma = 0.01 * np.sin(np.pi * np.linspace(0, 1, levels))
    table = np.linspace(0, 1, levels) ** 2
    known, unknown = Verdict("identifiable", "it was seen"), Verdict("not identifiable", "nothing moved", "move")
    content = {
        "size": SIZE,
        "response": Response(table, sigma, 0.02, (0.03, 0.95)) if response else None,
        "vignette": PolynomialVignette(SIZE, (-0.3, 0.1, -0.1)) if vignette else None,
        "vignette_sigma": 0.02 * PROFILE_RADII if vignette else None,
        "verdicts": {"response": known if response else unknown, "vignette": known if vignette else unknown},
        "exposure_ratios": ratios(),
        "max_grey": max_grey,
        "counts": {"frames": 12, "skipped": 0, "pairs": 40, "samples": 9000},
        "source": {"name": "somewhere"},
    }
    return Calibration(**(content | changes))
