"""The sensor: from irradiance to grey values by noise, clipping, response and quantisation."""

from __future__ import annotations

import math

import numpy as np

from ospc.arrays import Float32Array, Image
from ospc.photometry.response import Response
from ospc.simulation.settings import SimulationSettings

_TABLE = 2**16
"""Entries of the table of 8-bit grey values: indices fit 16 bits, and errors stay far below a grey level."""


class Sensor:
    """Turns irradiance into grey values, M = f(I + noise).

    The noise is that of counted electrons. With gain G, full well F and read noise r, the irradiance I (1 saturates)
    corresponds to I·F/G electrons, and their count has the variance I·F/G + r². It is drawn from a normal
    distribution, which a Poisson distribution resembles from about ten electrons on.
    """

    def __init__(self, response: Response, settings: SimulationSettings) -> None:
        self._response = response
        self._max_grey = settings.max_grey
        self._full_well, self._read_noise = settings.sensor
        self._seed = settings.seed
        # Tabulated over the square root of the irradiance: as a function of it, no usual response is steep.
        root = np.linspace(0.0, 1.0, _TABLE)
        self._grey = np.rint(response(root**2) * self._max_grey).astype(
            np.uint8 if self._max_grey < 256 else np.uint16
        )

    def expose(self, irradiance: Float32Array, *, frame: int, gain: float = 1.0) -> Image:
        """Return the uint8 or uint16 image of an irradiance e V L, a share of saturation, shape (height, width).

        The index of the frame seeds the noise; e includes the linear gain.
        """
        noisy = self._with_noise(irradiance, frame, gain)
        np.clip(noisy, 0, 1, out=noisy)
        if self._max_grey > 255:
            return np.rint(self._response(noisy) * self._max_grey).astype(np.uint16)
        index = np.sqrt(noisy) * np.float32(_TABLE - 1) + np.float32(0.5)
        return np.take(self._grey, index.astype(np.uint16))

    def _with_noise(self, irradiance: Float32Array, frame: int, gain: float) -> Float32Array:
        if math.isinf(self._full_well):
            return irradiance.copy()
        rng = np.random.default_rng([self._seed, 3, frame])
        noise = rng.standard_normal(irradiance.shape, dtype=np.float32)
        electrons = np.maximum(irradiance, 0) * np.float32(self._full_well / gain)
        noise *= np.sqrt(electrons + np.float32(self._read_noise**2)) * np.float32(gain / self._full_well)
        return irradiance + noise
