"""Noise of single pixels, measured where the image has the least structure."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from scipy.optimize import nnls

from ospc.arrays import Float32Array, FloatArray, Image
from ospc.photometry.noise import NoiseModel
from ospc.recording.frame import Frame

_BINS = 16
_BLOCK = 8
_BAND_SPACING = 24
_SHARE = 0.1
_QUANTILE_OF_NOISE = 0.627
"""A tenth of blocks of pure noise have a variance below this share of the true one."""

_MIN_BLOCKS = 40
_REMEMBERED = 64

_LAPLACIANS = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float32) / 6
"""Blind to planes and to edges along rows and columns; passes white noise with its variance (Immerkaer 1996)."""


@dataclass
class NoiseEstimator:
    """Collects the variance of blocks after their structure is filtered out; the least of many is that of the noise.

    Attributes
    ----------
    max_grey
        Largest grey value of the images.
    """

    max_grey: int
    _found: list[list[float]] = field(default_factory=lambda: [[] for _ in range(_BINS)], repr=False)

    def observe(self, frame: Frame) -> None:
        """Take a frame: some bands of it."""
        # Black pixels tell nothing about noise, and masked ones must not.
        image = frame.image if frame.mask is None else np.where(frame.mask, frame.image, 0)
        if min(image.shape) < _BLOCK + 2:
            return
        level, variance = self._blocks(image)
        number = np.minimum((level * _BINS).astype(np.int64), _BINS - 1)
        for b in range(_BINS):
            inside = variance[number == b]
            if len(inside) >= _MIN_BLOCKS:
                least = float(np.quantile(inside, _SHARE)) / _QUANTILE_OF_NOISE
                self._found[b] = [*self._found[b], least][-_REMEMBERED:]

    def _blocks(self, image: Image) -> FloatArray:
        """Return mean and variance of the exposed blocks of all bands, shape (2, blocks)."""
        tops = np.arange(0, image.shape[0] - _BLOCK - 1, _BAND_SPACING)
        columns = (image.shape[1] - 2) // _BLOCK
        # All bands at once, one below the other; a band's outermost rows keep its neighbours out of its blocks.
        rows = (tops[:, None] + np.arange(_BLOCK + 2)).ravel()
        grey = image[rows].astype(np.float32) / np.float32(self.max_grey)
        rough = cv2.filter2D(grey, cv2.CV_32F, _LAPLACIANS) ** 2
        clipped = ((grey <= np.float32(1.5 / 255)) | (grey >= np.float32(253.5 / 255))).astype(np.float32)

        def means(values: Float32Array) -> FloatArray:
            bands = values.reshape(len(tops), _BLOCK + 2, -1)[:, 1:-1, 1 : 1 + columns * _BLOCK]
            inner = bands.reshape(len(tops) * _BLOCK, columns * _BLOCK)
            resized = cv2.resize(inner, (columns, len(tops)), interpolation=cv2.INTER_AREA)
            return np.asarray(resized, dtype=np.float64)

        return np.stack([means(grey), means(rough)])[:, means(clipped) == 0]

    def model(self) -> NoiseModel:
        """Return the noise; plain quantisation noise where nothing was measured."""
        floor = 1 / 12 / self.max_grey**2
        known = np.array([len(found) > 0 for found in self._found])
        if not known.any():
            return NoiseModel(max(floor, (0.5 / 255) ** 2), 0.0)
        level = (np.arange(_BINS)[known] + 0.5) / _BINS
        variance = np.maximum([np.median(found) for found in self._found if found], floor)
        read, shot = nnls(np.stack([1 / variance, level / variance], axis=1), np.ones(len(level)))[0]
        # Where noise reaches the ends, only blocks with little of it pass as exposed: their neighbours tell better.
        trusted = 4 * np.sqrt(variance) < np.minimum(level, 1 - level)
        table: tuple[float, ...] = ()
        if trusted.any():
            table = tuple(np.interp(np.linspace(0, 1, _BINS + 1), level[trusted], variance[trusted]))
        return NoiseModel(max(float(read), floor), float(shot), table)
