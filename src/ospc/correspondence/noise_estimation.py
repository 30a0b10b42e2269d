"""Noise of single pixels, measured where the image has the least structure."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from scipy.optimize import nnls

from ospc.arrays import Float32Array, FloatArray, Image
from ospc.photometry.noise import BRIGHTEST_EXPOSED, DARKEST_EXPOSED, NoiseModel
from ospc.recording.frame import Frame

BINS = 16
"""Equal ranges of grey level in which noise is measured: it changes little within one, and enough blocks fall into
it."""

_BLOCK = 8
"""Side of a block in pixels: small enough to fit between structures, and its 64 values give a variance to a fifth."""

_BAND_SPACING, _MOST_BANDS = 24, 20
"""Fewest rows from one band of blocks to the next, and most bands: a third of an image of 640×480 is enough."""

_SHARE = 0.1
"""Quantile of the blocks' variances that is taken for noise alone: hardly any image has structure in more than nine
tenths of its blocks."""

_QUANTILE_OF_NOISE = 0.627
"""A tenth of blocks of pure noise have a variance below this share of the true one."""

_MIN_BLOCKS = 40
"""Fewest blocks of a grey range in a frame: a tenth of them are then four."""

REMEMBERED = 64
"""Latest frames whose variances are kept; the median over them hardly changes with more."""

_TRUSTED_SIGMAS = 4
"""Distance from black and white, in standard deviations of the noise, at which a range shows all of its noise.
Nearer, only blocks with little noise pass as exposed."""

_QUANTISATION_VARIANCE = 1 / 12
"""Variance of rounding to whole grey values: the least noise of any image."""

_ASSUMED_SIGMA = 0.5 / 255
"""Standard deviation assumed where nothing was measured: half an 8-bit grey level."""

_LAPLACIANS = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float32) / 6
"""Blind to planes and to edges along rows and columns; passes white noise with its variance (Immerkaer 1996)."""


@dataclass
class NoiseEstimator:
    """Collects the variance of blocks after filtering out their structure; the lowest ones are due to noise alone."""

    max_grey: int
    _found: list[list[float]] = field(default_factory=lambda: [[] for _ in range(BINS)], repr=False)

    def observe(self, frame: Frame) -> None:
        """Measure some bands of a frame."""
        # Black pixels are not used for the noise, so masked ones are made black.
        image = frame.image if frame.mask is None else np.where(frame.mask, frame.image, 0)
        if min(image.shape) < _BLOCK + 2:
            return
        level, variance = self._blocks(image)
        number = np.minimum((level * BINS).astype(np.int64), BINS - 1)
        for b in range(BINS):
            inside = variance[number == b]
            if len(inside) >= _MIN_BLOCKS:
                least = float(np.quantile(inside, _SHARE)) / _QUANTILE_OF_NOISE
                self._found[b] = [*self._found[b], least][-REMEMBERED:]

    def _blocks(self, image: Image) -> FloatArray:
        """Return mean and variance of the exposed blocks of all bands, shape (2, blocks)."""
        last = image.shape[0] - _BLOCK - 1
        tops = np.arange(0, last, max(_BAND_SPACING, -(-last // _MOST_BANDS)))
        columns = (image.shape[1] - 2) // _BLOCK
        # All bands at once, one below the other; a band's outermost rows keep its neighbours out of its blocks.
        rows = (tops[:, None] + np.arange(_BLOCK + 2)).ravel()
        grey = image[rows].astype(np.float32) / np.float32(self.max_grey)
        rough = cv2.filter2D(grey, cv2.CV_32F, _LAPLACIANS) ** 2
        clipped = ((grey <= np.float32(DARKEST_EXPOSED)) | (grey >= np.float32(BRIGHTEST_EXPOSED))).astype(np.float32)

        def means(values: Float32Array) -> FloatArray:
            bands = values.reshape(len(tops), _BLOCK + 2, -1)[:, 1:-1, 1 : 1 + columns * _BLOCK]
            inner = bands.reshape(len(tops) * _BLOCK, columns * _BLOCK)
            resized = cv2.resize(inner, (columns, len(tops)), interpolation=cv2.INTER_AREA)
            return np.asarray(resized, dtype=np.float64)

        return np.stack([means(grey), means(rough)])[:, means(clipped) == 0]

    def model(self) -> NoiseModel:
        """Return the noise; an assumed one where nothing was measured."""
        floor = _QUANTISATION_VARIANCE / self.max_grey**2
        known = np.array([len(found) > 0 for found in self._found])
        if not known.any():
            return NoiseModel(max(floor, _ASSUMED_SIGMA**2), 0.0)
        level = (np.arange(BINS)[known] + 0.5) / BINS
        variance = np.maximum([np.median(found) for found in self._found if found], floor)
        read, shot = nnls(np.stack([1 / variance, level / variance], axis=1), np.ones(len(level)))[0]
        trusted = _TRUSTED_SIGMAS * np.sqrt(variance) < np.minimum(level, 1 - level)
        table: tuple[float, ...] = ()
        if trusted.any():
            table = tuple(np.interp(np.linspace(0, 1, BINS + 1), level[trusted], variance[trusted]))
        return NoiseModel(max(float(read), floor), float(shot), table)
