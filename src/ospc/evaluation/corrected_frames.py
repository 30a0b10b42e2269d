"""Frames as the camera would have recorded them without vignette and at equal exposure."""

from __future__ import annotations

import numpy as np

from ospc.arrays import Float32Array, FloatArray, Image
from ospc.photometry.correction import Corrector, look_up
from ospc.photometry.response import Response
from ospc.recording import Frame

_LEAST_HEADROOM = 0.25
"""Least factor by which corrected frames are darkened; beyond it, strongly vignetted corners are clipped."""

_LEVELS = 65536
"""Entries of the table from 16-bit irradiance to 8-bit grey values."""


class CorrectedFrames:
    """Both frames of a pair as if recorded at the longer of their exposures and without vignette, f(s·g(M')/V).

    M' is the frame warped to that exposure. The factor s ≤ 1 makes room for the corrected corners, which can be
    brighter than white in the middle of the image.
    """

    def __init__(self, corrector: Corrector) -> None:
        self._corrector = corrector
        self._response = corrector.response if isinstance(corrector.response, Response) else None
        darkest = 1.0 if corrector.vignette is None else float(corrector.vignette.image().min())
        self._headroom = min(max(darkest, _LEAST_HEADROOM), 1.0)
        self._greys = np.rint(255 * self._encoded(np.linspace(0.0, 1.0, _LEVELS))).astype(np.uint8)

    def pair(self, before: Frame, after: Frame) -> tuple[Image, Image]:
        """Return the images of two successive frames."""
        longer_ms = max(before.exposure_ms, after.exposure_ms)
        return self._at(before, longer_ms), self._at(after, longer_ms)

    def radiance(self, frame: Frame) -> Float32Array:
        """Return the radiance at every pixel, NaN if saturated."""
        return np.asarray(self._corrector.correct(frame.image, frame.exposure_ms), dtype=np.float32)

    def greys(self, radiance: FloatArray, exposure_ms: float) -> FloatArray:
        """Return the grey values, 0 to 255, that radiances have in corrected frames of an exposure."""
        return 255 * self._encoded(self._headroom * exposure_ms * radiance)

    def _at(self, frame: Frame, exposure_ms: float) -> Image:
        image = frame.image
        if exposure_ms != frame.exposure_ms:
            image = self._corrector.warp_exposure(image, frame.exposure_ms, exposure_ms)
        light = self._corrector.correct(image, dtype=np.uint16, white=1 / self._headroom, mark_saturated=False)
        return np.asarray(look_up(light, self._greys[:, None]))

    def _encoded(self, irradiance: FloatArray) -> FloatArray:
        if self._response is None:
            return np.clip(irradiance, 0.0, 1.0)
        return self._response(irradiance)
