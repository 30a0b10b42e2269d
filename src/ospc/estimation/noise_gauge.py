"""Noise of single pixels, measured where the image is flat."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import nnls

from ospc.arrays import FloatArray, Image
from ospc.photometry.noise import NoiseModel

_BINS = 16
_ROWS = 48


@dataclass
class NoiseGauge:
    """Collects second differences along rows, whose variance at flat places is that of the noise.

    Attributes
    ----------
    max_grey
        Largest grey value of the images.
    """

    max_grey: int
    _sum: FloatArray = field(default_factory=lambda: np.zeros(_BINS), repr=False)
    _weight: FloatArray = field(default_factory=lambda: np.zeros(_BINS), repr=False)

    def watch(self, image: Image) -> None:
        """Take an image: some of its rows."""
        rows = image[:: max(1, image.shape[0] // _ROWS)].astype(np.float64) / self.max_grey
        groups = rows[:, : rows.shape[1] // 9 * 9].reshape(-1, 9)
        middle = groups.mean(axis=1)
        # Nine pixels in a row are flat if their halves agree: a test that does not look at the differences measured.
        slope = np.abs(groups[:, :3].mean(axis=1) - groups[:, 6:].mean(axis=1))
        exposed = (groups.min(axis=1) > 1.5 / 255) & (groups.max(axis=1) < 253.5 / 255)
        second = (groups[:, 1:8:2] - 0.5 * (groups[:, 0:7:2] + groups[:, 2:9:2])) ** 2 / 1.5
        index = np.minimum((middle * _BINS).astype(np.int64), _BINS - 1)
        for b in range(_BINS):
            inside = exposed & (index == b)
            if np.count_nonzero(inside) < 30:
                continue
            flattest = slope[inside] <= np.quantile(slope[inside], 0.25)
            values = second[inside][flattest].mean(axis=1)
            # Structure makes a tail, so the median decides; four correlated differences have that of a χ² of 3.
            self._sum[b] += float(np.median(values)) / 0.830 * values.size
            self._weight[b] += values.size

    def model(self) -> NoiseModel:
        """Return read and shot noise; plain quantisation noise where nothing was measured."""
        floor = 1 / 12 / self.max_grey**2
        known = self._weight > 100
        if not known.any():
            return NoiseModel(max(floor, (0.5 / 255) ** 2), 0.0)
        level = (np.arange(_BINS)[known] + 0.5) / _BINS
        variance = np.maximum(self._sum[known] / self._weight[known], floor)
        matrix = np.stack([np.ones_like(level), level], axis=1)
        confidence = np.sqrt(self._weight[known])
        read, shot = nnls(matrix / variance[:, None] * confidence[:, None], confidence)[0]
        return NoiseModel(max(float(read), floor), float(shot))
