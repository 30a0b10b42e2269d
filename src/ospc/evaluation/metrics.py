"""Metrics: errors of an estimated response or vignette against the truth.

Curves are normalised to g(0) = 0, g(255) = 1, and V = 1 at the centre. No metric aligns by an exponent.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ospc.arrays import FloatArray
from ospc.errors import FormatError
from ospc.photometry.geometry import normalised, pixel_grid
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette, radial_profile
from ospc.settings.evaluation import CENTRE_BINS, METRIC_GREYS, PROFILE_BINS, RANDOM_PAIRS
from ospc.settings.fit import RATIO_BRIGHTEST_GREY, RATIO_DARKEST_GREY, RATIO_LOG_GREY_SPREAD


class Coverage(NamedTuple):
    """Share of values within one and two standard deviations of the truth."""

    within_1_sigma: float
    within_2_sigma: float


def response_rmse(estimate: Response, truth: Response) -> float:
    """Return the root mean square of g − G over the 256 grey levels.

    g is the inverse response of the estimate and G that of the truth, both from 0 to 1.
    """
    return _rms(estimate.resampled(METRIC_GREYS) - truth.resampled(METRIC_GREYS))


def response_shape_rmse(estimate: Response, truth: Response, low: int = 5, high: int = 250) -> float:
    """Return the root mean square of s·g − G over the grey values low to high of 255, with the best scale s.

    The scale of a response is not observable, and the brightest grey levels, which fix it by convention, are rarely
    measured.
    """
    g, truth_g = (r.resampled(METRIC_GREYS)[low : high + 1] for r in (estimate, truth))
    scale = float(g @ truth_g) / float(g @ g)
    return _rms(scale * g - truth_g)


def log_ratio_error(estimate: Response, truth: Response, seed: int = 0, brightest: float = 1.0) -> float:
    """Return κ, the median over random pairs of grey values a and b of |ln g(a)/g(b) − ln G(a)/G(b)|.

    g is the inverse response of the estimate and G that of the truth. There are 20 000 pairs: a is uniform from 15 to
    245, or to the ``brightest`` grey value that occurs, of 1; b = a·exp(N(0, 0.3)) is clipped to the same range.
    Direct methods compare such pairs.
    """
    random = np.random.default_rng(seed)
    darkest, brightest = RATIO_DARKEST_GREY, min(brightest, RATIO_BRIGHTEST_GREY)
    a = random.uniform(darkest, brightest, RANDOM_PAIRS)
    factor = np.exp(random.normal(0.0, RATIO_LOG_GREY_SPREAD, RANDOM_PAIRS))
    b = np.clip(a * factor, darkest, brightest)
    grey = np.linspace(0, 1, METRIC_GREYS)
    log_ratios = [
        np.log(np.interp(a, grey, table) / np.interp(b, grey, table))
        for table in (estimate.resampled(METRIC_GREYS), truth.resampled(METRIC_GREYS))
    ]
    return float(np.median(np.abs(log_ratios[0] - log_ratios[1])))


def vignette_rmse(estimate: Vignette, truth: Vignette, max_radius: float = 1.0) -> float:
    """Return the RMS difference of the radial profiles, each divided by the mean of its first three bins.

    The sizes may differ, because the radius is 1 at the corner of each. Bins without pixels and bins beyond the
    radius ``max_radius`` do not count.
    """
    difference = (radial_profile(estimate, PROFILE_BINS) - radial_profile(truth, PROFILE_BINS))[
        : max(1, int(max_radius * PROFILE_BINS))
    ]
    return _rms(difference[np.isfinite(difference)])


def vignette_pixel_rmse(estimate: Vignette, truth: Vignette) -> float:
    """Return the root mean square difference over all pixels, each vignette divided by its mean at the centre.

    Raises
    ------
    FormatError
        If their sizes differ.
    """
    if estimate.size != truth.size:
        raise FormatError(
            f"vignettes of {estimate.size[0]}x{estimate.size[1]} and {truth.size[0]}x{truth.size[1]} pixels cannot "
            "be compared pixel by pixel; resize one of them"
        )
    radius = np.linalg.norm(normalised(pixel_grid(truth.size), truth.size), axis=-1)
    centre = (radius < CENTRE_BINS / PROFILE_BINS) | (radius == radius.min())  # the latter for tiny images
    images = [vignette.image().astype(np.float64) for vignette in (estimate, truth)]
    first, second = (image / image[centre].mean() for image in images)
    return _rms(first - second)


def coverage(estimate: npt.ArrayLike, sigma: npt.ArrayLike, truth: npt.ArrayLike) -> Coverage:
    """Return the share of curve points within ±1σ and ±2σ of the truth: 0.683 and 0.954 if σ is right.

    Points without error and with σ = 0 do not count, such as the ends of a response, which are fixed by convention.

    Parameters
    ----------
    estimate, sigma, truth
        Curves, standard deviations and true curves; their shapes broadcast, such as (recordings, points).

    Raises
    ------
    FormatError
        If a standard deviation is negative, a value is not finite, or no point counts.
    """
    e, s, t = np.broadcast_arrays(*(np.asarray(array, dtype=np.float64) for array in (estimate, sigma, truth)))
    if not all(np.all(np.isfinite(array)) for array in (e, s, t)) or np.any(s < 0):
        raise FormatError("coverage needs finite curves and finite, non-negative standard deviations")
    error = np.abs(e - t)
    counted = (s > 0) | (error > 0)
    if not counted.any():
        raise FormatError("coverage needs at least one point that is not fixed by convention")
    error, s = error[counted], s[counted]
    return Coverage(float(np.mean(error <= s)), float(np.mean(error <= 2 * s)))


def _rms(difference: FloatArray) -> float:
    return float(np.sqrt(np.mean(difference**2)))
