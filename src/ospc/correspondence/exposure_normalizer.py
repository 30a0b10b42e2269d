"""Normalisation of two frames to equal brightness, based on their exposures or their images."""

from __future__ import annotations

import cv2
import numpy as np

from ospc.arrays import Float32Array, FloatArray, Image, ImageSize
from ospc.correspondence.preprocessing import ReducedFrame
from ospc.correspondence.thumbnail_registration import ThumbnailRegistration, exposed_in_both, values_at
from ospc.numerics.robust import median, robust_scale
from ospc.photometry.geometry import pixel_grid
from ospc.photometry.vignette import Vignette
from ospc.settings.error_model import DARKEST_GREY
from ospc.settings.registration import (
    BRIGHTEST_QUANTILE_8_BIT,
    CLEAR_LOG_RATIO_AGREEMENT,
    DARKEST_QUANTILE_8_BIT,
    DISPLAY_GAMMA,
    MAX_LOG_DISPLAY,
    MAX_LOG_RATIO_DISAGREEMENT,
    MAX_LOG_RATIO_SPREAD,
    MAX_TRUSTED_LOG_RATIO,
    MIN_KEPT_BRIGHTNESS,
    MIN_SHARED_PLACES,
)


class ExposureNormalizer:
    """Normalises two small images to equal brightness, without vignette, on a display scale.

    The brightness ratio is that of the stated exposures, unless the images clearly contradict it. If the stated
    exposures are trusted, only large ratios are checked. Without exposures, the ratio is measured in the images. An
    unknown response is replaced by the typical display gamma, an unknown vignette by V ≡ 1.

    Parameters
    ----------
    log_response
        ln g at the grey values 0 … 255, in any scale, shape (256,); None if unknown.
    vignette
        The vignette; None if unknown.
    trusts_stated
        Whether the stated exposures are trusted.
    """

    def __init__(
        self, log_response: FloatArray | None = None, vignette: Vignette | None = None, *, trusts_stated: bool = False
    ) -> None:
        self._trusts_stated = trusts_stated
        self._log_display = DISPLAY_GAMMA * np.log(np.maximum(np.arange(256) / 255, DARKEST_GREY))
        self._log_irradiance = self._log_display if log_response is None else log_response
        self._vignette = vignette
        self._lift: dict[tuple[int, ...], Float32Array] = {}
        self._register = ThumbnailRegistration()

    def __call__(self, frame0: ReducedFrame, frame1: ReducedFrame, stated_log_ratio: float) -> tuple[Image, Image]:
        """Return both small images as they would appear at the longer exposure, 8 bit, shapes (h, w).

        ``stated_log_ratio`` is ln of the exposure of the second over that of the first, NaN if unknown.
        """
        log_ratio = stated_log_ratio
        if np.isnan(stated_log_ratio) or not (
            (self._trusts_stated and abs(stated_log_ratio) < MAX_TRUSTED_LOG_RATIO)
            or abs(self._log_ratio_of_quantiles(frame0, frame1) - stated_log_ratio) < CLEAR_LOG_RATIO_AGREEMENT
        ):
            shown, sure = self.log_ratio(frame0, frame1)
            contradicted = sure and abs(stated_log_ratio - shown) > MAX_LOG_RATIO_DISAGREEMENT
            log_ratio = shown if contradicted or np.isnan(stated_log_ratio) else stated_log_ratio
        # At the longer exposure both images clip at the same radiance, so clipped regions have the same edges.
        log_gain = self._log_gain(frame1 if log_ratio > 0 else frame0)
        return (
            self._brightened(frame0, log_gain + max(0.0, log_ratio)),
            self._brightened(frame1, log_gain + max(0.0, -log_ratio)),
        )

    def log_ratio(self, frame0: ReducedFrame, frame1: ReducedFrame) -> tuple[float, bool]:
        """Return ln of the irradiance of the second frame over the first, and whether it is certain."""
        small0, small1 = frame0.thumbnail, frame1.thumbnail
        there, found = self._register(small0, small1)
        shared = exposed_in_both(small0, small1, there, found)
        if np.count_nonzero(shared) < MIN_SHARED_PLACES * shared.size:
            return self._log_ratio_of_quantiles(frame0, frame1), False
        log0 = self._log_radiance(small0.grey, frame0.size)
        log1 = values_at(self._log_radiance(small1.grey, frame1.size), there)
        difference = (log1 - log0)[shared]
        middle = median(difference)
        return float(middle), robust_scale(difference - middle) < MAX_LOG_RATIO_SPREAD

    def _log_ratio_of_quantiles(self, frame0: ReducedFrame, frame1: ReducedFrame) -> float:
        """Return ln of the same ratio for frames with little overlap: the median over quantiles exposed in both."""
        grey0, grey1 = frame0.grey_quantiles, frame1.grey_quantiles
        darkest, brightest = np.minimum(grey0, grey1), np.maximum(grey0, grey1)
        exposed = (darkest > DARKEST_QUANTILE_8_BIT) & (brightest < BRIGHTEST_QUANTILE_8_BIT)
        log0, log1 = (np.interp(grey, np.arange(256), self._log_irradiance) for grey in (grey0, grey1))
        return float(np.median((log1 - log0)[exposed] if exposed.any() else log1 - log0))

    def _log_radiance(self, grey: Float32Array, size: ImageSize) -> Float32Array:
        log_irradiance = np.interp(grey * 255, np.arange(256), self._log_irradiance).astype(np.float32)
        if self._vignette is None:
            return log_irradiance
        return np.asarray(log_irradiance + DISPLAY_GAMMA * np.log(self._lift_of(grey.shape, size)), dtype=np.float32)

    def _log_gain(self, frame: ReducedFrame) -> float:
        """Return the gain, in ln, that keeps the middle grey level of a frame visible."""
        # The scale of g follows from grey levels next to white: if these are never observed, g may be almost zero at
        # all others.
        middle = max(float(np.median(frame.grey_quantiles)), DARKEST_QUANTILE_8_BIT)
        log_kept = np.interp(middle, np.arange(256), self._log_display) + DISPLAY_GAMMA * np.log(MIN_KEPT_BRIGHTNESS)
        return max(0.0, float(log_kept - np.interp(middle, np.arange(256), self._log_irradiance)))

    def _brightened(self, frame: ReducedFrame, log_gain: float) -> Image:
        # Nothing brighter is needed, and the conversion to bytes below would turn very large numbers to black.
        log_display = np.minimum((self._log_irradiance + log_gain) / DISPLAY_GAMMA, MAX_LOG_DISPLAY)
        table = (np.exp(log_display) * 255).astype(np.float32)
        table[0] = 0  # ln g tends to −∞ at black
        if self._vignette is None:
            return np.asarray(cv2.LUT(frame.small, np.clip(table, 0, 255).astype(np.uint8)))
        bright = cv2.LUT(frame.small, table) * self._lift_of(frame.small.shape, frame.size)
        return np.asarray(cv2.convertScaleAbs(bright), dtype=np.uint8)

    def _lift_of(self, shape: tuple[int, ...], size: ImageSize) -> Float32Array:
        if shape not in self._lift and self._vignette is not None:
            scale = np.array(size) / np.array(shape[::-1])
            places = (pixel_grid((shape[1], shape[0])) + 0.5) * scale - 0.5
            self._lift[shape] = (self._vignette.at(places) ** (-1 / DISPLAY_GAMMA)).astype(np.float32)
        return self._lift[shape]
