"""Noise of single pixels, measured in the image blocks with the least structure."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from ospc.arrays import Float32Array, FloatArray, Image, IntArray
from ospc.numerics.least_squares import non_negative_least_squares
from ospc.numerics.robust import huber_weights, robust_scale
from ospc.observations import ExposureLookup
from ospc.photometry.noise import BRIGHTEST_EXPOSED, DARKEST_EXPOSED, NoiseModel
from ospc.recording.frame import Frame
from ospc.settings.sampling import (
    ASSUMED_NOISE_SIGMA,
    GAIN_BEGINS,
    GAIN_ITERATIONS,
    GAIN_SPREAD,
    MAX_BANDS,
    MAX_GAIN_POWER,
    MAX_GAIN_RESIDUAL,
    MIN_AMPLIFIED_RATIO,
    MIN_BAND_SPACING_ROWS,
    MIN_END_DISTANCE_SIGMAS,
    MIN_GAIN_POWER,
    MIN_GAIN_VARIANCES,
    MIN_NOISE_BLOCKS,
    NOISE_BINS,
    NOISE_BLOCK_PX,
    NOISE_FRAMES,
    NOISE_QUANTILE,
    NOISE_QUANTILE_RATIO,
    QUANTISATION_VARIANCE,
)

_LAPLACIANS = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float32) / 6
"""Insensitive to planes and to edges along rows and columns; preserves the variance of white noise (Immerkaer
1996)."""

_TINY = np.finfo(np.float64).tiny


@dataclass
class NoiseEstimator:
    """Collects the variances of blocks after filtering out structure; the lowest ones are due to noise alone."""

    max_grey: int
    _found: list[list[float]] = field(default_factory=lambda: [[] for _ in range(NOISE_BINS)], repr=False)
    """Variances of noise in each range of grey levels, the latest last."""
    _frames: list[list[int]] = field(default_factory=lambda: [[] for _ in range(NOISE_BINS)], repr=False)
    """Numbers of their frames."""
    _waiting: list[list[float]] = field(default_factory=lambda: [[] for _ in range(NOISE_BINS)], repr=False)
    """Variances of blocks that are not yet enough for the next value: small images have few blocks per range."""

    def observe(self, frame: Frame) -> None:
        """Measure some bands of a frame."""
        # Black pixels are ignored, so masked ones are made black.
        image = frame.image if frame.mask is None else np.where(frame.mask, frame.image, 0)
        if min(image.shape) < NOISE_BLOCK_PX + 2:
            return
        level, variance = self._blocks(image)
        number = np.minimum((level * NOISE_BINS).astype(np.int64), NOISE_BINS - 1)
        for b in range(NOISE_BINS):
            inside = np.sort(np.append(self._waiting[b], variance[number == b]))
            if len(inside) >= MIN_NOISE_BLOCKS:
                # Interpolated quantile; NumPy's function is many times slower for a few hundred values.
                lowest = np.interp(NOISE_QUANTILE * (len(inside) - 1), np.arange(len(inside)), inside)
                least = float(lowest) / NOISE_QUANTILE_RATIO
                self._found[b] = [*self._found[b], least][-NOISE_FRAMES:]
                self._frames[b] = [*self._frames[b], frame.index][-NOISE_FRAMES:]
                self._waiting[b] = []
            else:
                self._waiting[b] = inside.tolist()

    def _blocks(self, image: Image) -> FloatArray:
        """Return mean and variance of the exposed blocks of all bands, shape (2, blocks)."""
        last = image.shape[0] - NOISE_BLOCK_PX - 1
        tops = np.arange(0, last, max(MIN_BAND_SPACING_ROWS, -(-last // MAX_BANDS)))
        columns = (image.shape[1] - 2) // NOISE_BLOCK_PX
        # Process all bands at once, stacked vertically; the outermost rows of a band separate it from its neighbours.
        rows = (tops[:, None] + np.arange(NOISE_BLOCK_PX + 2)).ravel()
        grey = image[rows].astype(np.float32) / np.float32(self.max_grey)
        rough = cv2.filter2D(grey, cv2.CV_32F, _LAPLACIANS) ** 2
        clipped = ((grey <= np.float32(DARKEST_EXPOSED)) | (grey >= np.float32(BRIGHTEST_EXPOSED))).astype(np.float32)

        def means(values: Float32Array) -> FloatArray:
            bands = values.reshape(len(tops), NOISE_BLOCK_PX + 2, -1)[:, 1:-1, 1 : 1 + columns * NOISE_BLOCK_PX]
            inner = bands.reshape(len(tops) * NOISE_BLOCK_PX, columns * NOISE_BLOCK_PX)
            resized = cv2.resize(inner, (columns, len(tops)), interpolation=cv2.INTER_AREA)
            return np.asarray(resized, dtype=np.float64)

        return np.stack([means(grey), means(rough)])[:, means(clipped) == 0]

    def model(self, exposures: ExposureLookup) -> NoiseModel:
        """Return the noise model; an assumed one if nothing was measured."""
        floor = QUANTISATION_VARIANCE / self.max_grey**2
        number = np.repeat(np.arange(NOISE_BINS), [len(found) for found in self._found])
        if not len(number):
            return NoiseModel(max(floor, ASSUMED_NOISE_SIGMA**2), 0.0)
        log_variance = np.log(np.maximum(np.concatenate(self._found), floor))
        log_exposure = exposures.log_exposure_of(np.concatenate(self._frames).astype(np.int64))
        exposed = np.isfinite(log_exposure)
        amplified = exposed & (log_variance > np.log(MIN_AMPLIFIED_RATIO * floor))
        begin, power = _growth_with_gain(number[amplified], log_exposure[amplified], log_variance[amplified])
        growing = NoiseModel(floor, 0.0, gain_from_log_exposure=begin, gain_power=power)
        without_gain = np.exp(log_variance)
        without_gain[exposed] /= growing.growth(log_exposure[exposed])
        measured = _model_of(number, without_gain, floor)
        return replace(measured, gain_from_log_exposure=begin, gain_power=power)


def _model_of(number: IntArray, variances: FloatArray, floor: float) -> NoiseModel:
    """Return the noise model of variances without gain, given the grey range of each, (n,) each, and their floor."""
    known = np.unique(number)
    level = (known + 0.5) / NOISE_BINS
    variance = np.array([np.median(variances[number == b]) for b in known])
    rows = np.stack([1 / variance, level / variance], axis=1)
    read, shot = non_negative_least_squares(rows, np.ones(len(level)))
    affine = NoiseModel(max(float(read), floor), float(shot))
    trusted = MIN_END_DISTANCE_SIGMAS * np.sqrt(variance) < np.minimum(level, 1 - level)
    if not trusted.any():
        return affine
    table = np.interp(np.linspace(0, 1, NOISE_BINS + 1), level[trusted], variance[trusted])
    first, last = known[trusted][[0, -1]].tolist()
    return replace(affine, table=tuple(table.tolist()), measured=(first / NOISE_BINS, (last + 1) / NOISE_BINS))


def _growth_with_gain(number: IntArray, log_exposure: FloatArray, log_variance: FloatArray) -> tuple[float, float]:
    """Return ln of the exposure from which noise grows at the same grey level, and the power; 0, 0 without growth."""
    # Cameras lengthen the exposure time up to a limit, and then raise the gain. Shot noise grows with the gain, read
    # noise with its square.
    if len(number) < MIN_GAIN_VARIANCES:
        return 0.0, 0.0
    constant = _without_means(log_variance, number, np.ones(len(number)))
    best = (MAX_GAIN_RESIDUAL * float(np.abs(constant).sum()), 0.0, 0.0)
    for begin in np.quantile(log_exposure, GAIN_BEGINS).tolist():
        growth, weight = np.maximum(log_exposure - begin, 0.0), np.ones(len(number))
        for _ in range(GAIN_ITERATIONS):
            rise, deviation = (_without_means(one, number, weight) for one in (growth, log_variance))
            spread = float(np.sum(weight * rise**2))
            if spread < GAIN_SPREAD**2 * len(number):
                break
            power = float(np.sum(weight * rise * deviation)) / spread
            residual = np.abs(deviation - power * rise)
            weight = huber_weights(residual, max(robust_scale(residual), _TINY))
        else:
            best = min(best, (float(residual.sum()), begin, power))
    _, begin, power = best
    return (begin, min(power, MAX_GAIN_POWER)) if power > MIN_GAIN_POWER else (0.0, 0.0)


def _without_means(values: FloatArray, number: IntArray, weight: FloatArray) -> FloatArray:
    """Return values minus the weighted mean of their grey range, shape (n,)."""
    total, mean = (np.bincount(number, one, NOISE_BINS) for one in (weight, weight * values))
    return np.asarray(values - (mean / np.maximum(total, _TINY))[number])
