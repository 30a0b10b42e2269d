"""Mo, Shi, Yeung and Matsushita, "Ambiguity-free radiometric calibration for internet photo collections", 2019.

1. Irradiances of the same scene points in several images form a matrix of rank 1, A = (gᵢ(Mᵢₚ)): an exposure for each
   image times a radiance for each point. All gᵢ, of an empirical model, are found together by making the other
   singular values small against the first. g^γ fits as well: a common exponent remains.
2. Edge colours fix it: γ is such that colours on edges lie on lines between those of their regions, as in Lin et al.
   2004 (:mod:`ospc.unknown_exposures.single_image.edges`).

The publication compares points of equal normals, because the light differs from photograph to photograph; here it
does not, and any points will do. Each image has its own response, as published; the result is their mean in ln g. The
exponent can be fixed by one point of the true response instead, and has to be for grey images. There is no vignette.
Not verified: the publication's prior on coefficients, and its solver.
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
"""Images of the matrix, and frames from one to the next: tracks have to last through all."""

_FEWEST_POINTS, _EXPOSED = 25, (0.03, 0.97)
"""Points that must be exposed in all images of a set, and grey levels between which they are."""

_NOISE, _GAUGE = 0.01, 0.01
"""Relative error of an irradiance against which coefficients, whose variance is 1, are weighed, and tolerance of ln g
at the grey level that the common exponent is held by."""

_GAMMAS = (0.3, 3.0)
"""Exponents that edge colours choose from."""


def rank_one_response(grey: FloatArray) -> Response:
    """Return the response, up to an exponent, for which irradiances have rank 1; grey levels (images, points).

    The exponent is that of the mean curve of the model.
    """
    model, levels = log_model(), np.linspace(0, 1, 256)
    count = len(model.components)

    def residuals(unknown: FloatArray) -> FloatArray:
        coefficients = unknown.reshape(len(grey), count)
        curves = np.array([model.curve(c) for c in coefficients])
        log = np.array([np.interp(m, levels, curve) for m, curve in zip(grey, curves, strict=True)])
        # Exposures of the start keep bright images from outweighing dark ones.
        matrix = np.exp(log - np.median(log, axis=1, keepdims=True))
        matrix /= np.linalg.norm(matrix, axis=0)
        left, singular, right = np.linalg.svd(matrix, full_matrices=False)
        rest = (left[:, 1:] * singular[1:]) @ right[1:] / singular[0]
        gauge = curves[:, ANCHOR].mean() - model.mean[ANCHOR]
        # Columns have length 1: an element is 1/√images.
        relative = rest.ravel() * np.sqrt(len(grey))
        return np.concatenate([relative / _NOISE, unknown, [gauge / _GAUGE]])

    found = least_squares(residuals, np.zeros(len(grey) * count), method="trf").x.reshape(len(grey), count)
    return model.response(found.mean(axis=0), "mo")


def exponent_of_edges(response: Response, patches: EdgePatches) -> float:
    """Return the γ for which g^γ brings edge colours nearest to the lines between their regions."""
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
    """The method, with one point of the true response, and with edge colours where frames have colours."""

    def __init__(self, truth: Response | None) -> None:
        self._truth = truth
        self._tracker = GainRobustTracker()
        self._recent: deque[tuple[IntArray, FloatArray]] = deque(maxlen=_IMAGES)
        self._best: tuple[float, FloatArray] = (-1.0, np.empty((0, 0)))
        self._colour: list[Image] = []
        self._count = 0

    def push(self, frame: Frame) -> None:
        """Take the next frame; of a colour image the green channel is tracked."""
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
            # Of all sets of images, the one whose brightness changes most shows most of the response.
            self._best = max(self._best, (change, grey), key=lambda one: one[0])

    def found(self) -> dict[str, Outcome]:
        """Return the variants that are possible."""
        if not self._best[1].size:
            raise NotObservableError(f"no {_FEWEST_POINTS} points are seen and exposed in {_IMAGES} images")
        free = rank_one_response(self._best[1])
        variants = {"mo-without": lambda: self._by_edges(free)}
        if (truth := self._truth) is not None:
            gamma = float(np.log(truth.inverse(0.5)) / np.log(free.inverse(0.5)))
            variants = {"mo-with": lambda: Estimate(powered(free, gamma))} | variants
        return outcomes_of(variants)

    def _by_edges(self, free: Response) -> Estimate:
        if not self._colour:
            raise NotObservableError("the colours of edges are needed, and the images are grey")
        return Estimate(powered(free, exponent_of_edges(free, EdgePatches.of(self._colour))))
