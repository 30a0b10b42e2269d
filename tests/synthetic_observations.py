"""Observations generated from the camera model, so that the truth is known and there are no other disturbances."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from log_polynomials import log_polynomial
from ospc.observations import ExposedObservations
from ospc.photometry.response import Response
from ospc.photometry.vignette import LogSplineVignette
from ospc.settings import DefaultSettings

SIZE = (640, 480)
POLYNOMIAL = log_polynomial(SIZE, (-0.5, 0.05, -0.2))
NONE = log_polynomial(SIZE, (0.0,))
ROUNDS = DefaultSettings().rounds


@dataclass(frozen=True)
class Camera:
    """A camera and how its frames are sampled.

    Attributes
    ----------
    response, vignette
        True response and vignette.
    read, shot
        Variance of a sampled grey level at black, and its increase from black to white, in full scale squared.
    registration_sigma_px
        Standard deviation of the registration error in pixels; gradients are up to 0.006 per pixel.
    outliers
        Fraction of observations with a random grey level.
    log_ratio
        Largest |ln k| of a pair; the pairs are spread evenly up to it, unless they are ``bracketed``: all have it.
    spread
        Standard deviation of log radiance.
    metadata_error
        Standard deviation of the error of ln k in the metadata, which all samples of a pair share.
    sideways
        Whether points move horizontally only.
    """

    response: Response
    vignette: LogSplineVignette = POLYNOMIAL
    read: float = (0.4 / 255) ** 2
    shot: float = (0.8 / 255) ** 2
    registration_sigma_px: float = 0.2
    outliers: float = 0.0
    log_ratio: float = 1.0
    bracketed: bool = False
    spread: float = 0.8
    metadata_error: float = 0.0
    sideways: bool = False

    def pairs(self, seed: int, groups: int = 40, points: int = 100) -> ExposedObservations:
        """Return pairs of observations well exposed in both frames; ``points`` are drawn for each frame pair."""
        random = np.random.default_rng(seed)
        n = groups * points
        group = np.repeat(np.arange(groups), points)
        log_k = self.log_ratio * np.where(self.bracketed, 1.0, (np.arange(groups) + 0.5) / groups)
        base = random.normal(0, 0.3, groups)
        # Exposures of about 10 ms; the brightest points of each pair are just below white in the longer exposure.
        log_exposure = np.log(10) + base[group, None] + np.stack([np.zeros(n), -log_k[group]], axis=1)
        log_radiance = np.log(0.25) - np.log(10) - base[group] + random.normal(0, self.spread, n)
        place = random.uniform(-1, 1, (n, 2, 2)) * np.array(SIZE) / np.hypot(*SIZE)
        if self.sideways:
            place[:, 1, 1] = place[:, 0, 1]
        attenuation = self.vignette.at_normalised(place)
        grey = self.response(np.exp(log_radiance[:, None] + log_exposure) * attenuation)
        gradient = random.uniform(0, 0.006, (n, 2))
        deviation = np.sqrt(self.read + self.shot * grey + (self.registration_sigma_px * gradient) ** 2)
        noisy = grey + deviation * random.standard_normal((n, 2))
        astray = random.random((n, 2)) < self.outliers
        noisy = np.where(astray, random.uniform(0.05, 0.95, (n, 2)), noisy)
        log_exposure[:, 1] += (self.metadata_error * random.standard_normal(groups))[group]
        # Select by the true values, because selecting by the noisy ones would bias the sample.
        exposed = np.all((grey > 4 / 255) & (grey < 0.985), axis=1)
        return ExposedObservations(
            grey=np.clip(noisy, 0, 1)[exposed].ravel(),
            log_exposure=log_exposure[exposed].ravel(),
            log_exposure_rate=np.zeros(2 * exposed.sum()),
            position=place[exposed].reshape(-1, 2),
            gradient=gradient[exposed].ravel(),
            grey_variance=np.zeros(2 * exposed.sum()),
            grey_third_moment=np.zeros(2 * exposed.sum()),
            frame_moments=np.zeros((2 * exposed.sum(), 6)),
            surround_moments=np.zeros((2 * exposed.sum(), 2, 7)),
            frame=np.stack([2 * group, 2 * group + 1], axis=1)[exposed].ravel(),
            point=np.repeat(np.arange(exposed.sum()), 2),
            group=np.repeat(group[exposed], 2),
        )


def reordered(observations: ExposedObservations, order: np.ndarray) -> ExposedObservations:
    """Return the pairs of observations with their points in another order."""
    index = (2 * order[:, None] + [0, 1]).ravel()
    return replace(observations.where(index), point=np.repeat(np.arange(len(order)), 2))
