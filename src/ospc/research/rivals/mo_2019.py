"""Mo, Shi, Yeung and Matsushita, "Ambiguity-free radiometric calibration for internet photo collections", 2019.

1. Irradiances of the same scene points in several images form a matrix of rank 1, A = (gᵢ(Mᵢₚ)): an exposure for each
   image times a radiance for each point. All gᵢ, given by an empirical model, are found jointly by making the other
   singular values small relative to the first. g^γ fits equally well, so a common exponent remains unknown.
2. Edge colours determine the exponent: γ is such that colours on edges lie on lines between the colours of the
   adjacent regions, as in Lin et al. 2004 (:mod:`ospc.unknown_exposures.single_image.edges`).

The publication compares points with equal normals, because the light differs between photographs; here it does not,
and any points can be used. Each image has its own response, as published; the result is their mean in ln g. For grey
images, the exponent has to come from one point of the true response. There is no vignette. Not verified: the
publication's prior on coefficients, and its solver.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from scipy.optimize import least_squares, minimize_scalar

from ospc.arrays import FloatArray, Image, IntArray
from ospc.errors import NotObservableError
from ospc.photometry.response import Response
from ospc.recording.frame import Frame
from ospc.research.method import Estimate, Outcome, outcomes_of
from ospc.research.rivals.log_response import ANCHOR, log_model
from ospc.unknown_exposures.single_image.edges import EdgePatches, edge_colour_distance
from ospc.unknown_exposures.tracking import GainRobustTracker

_IMAGES, _APART = 6, 4
"""Images of the matrix, and frames from one to the next; tracks have to last through all of them."""

_FEWEST_POINTS, _EXPOSED = 25, (0.03, 0.97)
"""Points that must be well exposed in all images of a set, and the range of grey levels that counts as such."""

_NOISE, _GAUGE = 0.01, 0.01
"""Relative error of an irradiance, weighed against coefficients of unit variance, and tolerance of ln g at the grey
level that fixes the common exponent."""

_GAMMAS = (0.3, 3.0)
"""Range of exponents."""


def rank_one_response(grey: FloatArray) -> Response:
    """Return the response, up to an exponent, for which the irradiances of ``grey`` (images, points) have rank 1.

    The exponent is that of the model's mean curve.
    """
    model, levels = log_model(), np.linspace(0, 1, 256)
    count = len(model.components)

    def residuals(unknown: FloatArray) -> FloatArray:
        coefficients = unknown.reshape(len(grey), count)
        curves = np.array([model.curve(c) for c in coefficients])
        log = np.array([np.interp(m, levels, curve) for m, curve in zip(grey, curves, strict=True)])
        # Initial exposures keep bright images from outweighing dark ones.
        matrix = np.exp(log - np.median(log, axis=1, keepdims=True))
        matrix /= np.linalg.norm(matrix, axis=0)
        left, singular, right = np.linalg.svd(matrix, full_matrices=False)
        rest = (left[:, 1:] * singular[1:]) @ right[1:] / singular[0]
        gauge = curves[:, ANCHOR].mean() - model.mean[ANCHOR]
        # Columns have length 1, so a typical element is 1/√images.
        relative = rest.ravel() * np.sqrt(len(grey))
        return np.concatenate([relative / _NOISE, unknown, [gauge / _GAUGE]])

    found = least_squares(residuals, np.zeros(len(grey) * count), method="trf").x.reshape(len(grey), count)
    return model.response(found.mean(axis=0), "mo")


def exponent_of_edges(response: Response, patches: EdgePatches) -> float:
    """Return the γ for which g^γ brings edge colours closest to the lines between their regions."""
    table = np.maximum(response.resampled(256), 1e-9)
    found = minimize_scalar(
        lambda log_gamma: edge_colour_distance(patches, table ** np.exp(log_gamma)),
        bounds=tuple(np.log(_GAMMAS)),
        method="bounded",
    )
    return float(np.exp(found.x))


def powered(response: Response, gamma: float) -> Response:
    """Return the response with g^γ."""
    table = response.resampled(256) ** gamma + 1e-9 * np.arange(256)
    return Response.from_values(table, model={"name": "mo", "exponent": gamma})


class Mo:
    """The method, with one point of the true response, and with edge colours if frames are in colour."""

    def __init__(self, truth: Response | None) -> None:
        self._truth = truth
        self._tracker = GainRobustTracker()
        self._recent: deque[tuple[IntArray, FloatArray]] = deque(maxlen=_IMAGES)
        self._best: tuple[float, FloatArray] = (-1.0, np.empty((0, 0)))
        self._colour: list[Image] = []
        self._count = 0

    def push(self, frame: Frame) -> None:
        """Take the next frame; the green channel of a colour image is tracked."""
        image = frame.image
        grey = frame
        if image.ndim == 3:
            grey = Frame.of_array(np.ascontiguousarray(image[..., 1]), frame.exposure_ms, index=frame.index)
        self._tracker.push(grey)
        if self._count % _APART == 0:
            self._keep(grey)
            if image.ndim == 3 and len(self._colour) < _IMAGES:
                self._colour.append(image)
        self._count += 1

    def _keep(self, frame: Frame) -> None:
        self._recent.append((self._tracker.current[0], self._tracker.grey_at_current(frame)))
        if len(self._recent) < _IMAGES:
            return
        common = self._recent[0][0]
        for others, _ in self._recent:
            common = np.intersect1d(common, others)
        grey = np.array([values[np.searchsorted(ids, common)] for ids, values in self._recent])
        grey = grey[:, np.all((grey > _EXPOSED[0]) & (grey < _EXPOSED[1]), axis=0)]
        if grey.shape[1] >= _FEWEST_POINTS:
            change = float(np.std(np.median(np.log(grey), axis=1)))
            # The set of images with the largest change in brightness shows the response best.
            self._best = max(self._best, (change, grey), key=lambda one: one[0])

    def found(self) -> dict[str, Outcome]:
        """Return the possible variants."""
        if not self._best[1].size:
            raise NotObservableError(f"fewer than {_FEWEST_POINTS} points are well exposed in {_IMAGES} images")
        free = rank_one_response(self._best[1])
        variants = {"mo-without": lambda: self._by_edges(free)}
        if (truth := self._truth) is not None:
            gamma = float(np.log(truth.inverse(0.5)) / np.log(free.inverse(0.5)))
            variants = {"mo-with": lambda: Estimate(powered(free, gamma))} | variants
        return outcomes_of(variants)

    def _by_edges(self, free: Response) -> Estimate:
        if not self._colour:
            raise NotObservableError("edge colours are needed, but the images are grey")
        return Estimate(powered(free, exponent_of_edges(free, EdgePatches.of(self._colour))))
