"""Settings of a correction."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import SettingError
from ospc.photometry.correction import checked_exposure, checked_white

Output: TypeAlias = Literal["irradiance", "grey8", "grey16"]
"""32-bit float TIFF, or PNG with 8 or 16 bits; all are linear in the irradiance."""

DTYPES: dict[Output, type[np.generic]] = {"irradiance": np.float32, "grey8": np.uint8, "grey16": np.uint16}


@dataclass(frozen=True)
class CorrectionSettings:
    """How to correct a recording."""

    output: Output | None = None
    """Kind of output images. If None: ``irradiance``, or with ``keep_response`` the bit depth of the originals."""
    keep_response: bool = False
    """Whether to remove only the vignette. The output then has the grey levels that the camera would have recorded
    without it, scaled to all 8 or 16 bits, instead of values linear in the irradiance."""
    normalise_exposure: bool = False
    """Whether to bring all images to the same exposure, e·L · reference/e, instead of keeping their own, e·L."""
    reference_ms: float | None = None
    """That exposure. If None: 1 ms for ``irradiance``, so that values are radiance per millisecond; the shortest of
    the recording for ``grey16``, so that nothing is clipped; the median for ``grey8``, which has too few bits for the
    shortest."""
    white: float = 1.0
    """For integers: the irradiance that becomes the largest grey value. 1 saturates the camera where V = 1; only
    brighter values away from the centre are then clipped."""
    mask_saturated: bool = False
    """Whether saturated pixels become NaN (``irradiance``) or the largest grey value."""
    assume_missing: bool = False
    """Whether an unknown response or vignette is replaced by the identity."""

    def __post_init__(self) -> None:
        """Check the values."""
        if self.output is not None and self.output not in DTYPES:
            raise SettingError(f"output is {self.output!r}; choose one of {', '.join(DTYPES)}")
        if self.keep_response and self.output == "irradiance":
            raise SettingError(
                "irradiance output cannot keep the response; choose grey8 or grey16, or do not keep the response"
            )
        if self.reference_ms is not None and not self.normalise_exposure:
            raise SettingError("a reference exposure requires normalised exposures; add --normalise-exposure")
        checked_white(self.white)
        if self.white != 1 and self.output in (None, "irradiance") and not self.keep_response:
            raise SettingError("irradiance output has no white; leave out --white, or choose grey8 or grey16")
        if self.reference_ms is not None:
            checked_exposure(self.reference_ms, "the reference exposure", "give another one, or none")

    def for_images(self, max_grey: int, exposures_ms: FloatArray) -> CorrectionSettings:
        """Return the settings with defaults for ``output`` and, if exposures are normalised, ``reference_ms``."""
        same_depth: Output = "grey8" if max_grey <= 255 else "grey16"
        output = self.output or (same_depth if self.keep_response else "irradiance")
        reference_ms = self.reference_ms
        if self.normalise_exposure and reference_ms is None:
            choices = {"irradiance": 1.0, "grey16": np.nanmin(exposures_ms), "grey8": np.nanmedian(exposures_ms)}
            reference_ms = float(choices[output])
        return replace(self, output=output, reference_ms=reference_ms)

    @property
    def dtype(self) -> type[np.generic]:
        """Data type of the output."""
        return DTYPES[self.output or "irradiance"]

    @property
    def limit(self) -> int | None:
        """Largest grey value of the output; None for floats."""
        return {"grey8": 255, "grey16": 65535}.get(self.output or "")

    @property
    def formula(self) -> str:
        """The meaning of a pixel value as a sentence, for settings from :meth:`for_images`."""
        reference_ms = self.reference_ms
        if self.keep_response:
            exposure = "" if reference_ms is None else f" at an exposure of {reference_ms:g} ms"
            white = "" if self.white == 1 else f", where an irradiance of {self.white:g} becomes white"
            grey = f"the grey level that the camera would have recorded without vignette, f(g(M)/V){exposure}{white}"
            return f"{grey}, scaled to at most {self.limit}"
        if reference_ms is None:
            light = "irradiance e·L = g(M)/V"
        elif reference_ms == 1 and self.limit is None:
            light = "radiance L per ms = g(M)/V / exposure"
        else:
            light = f"irradiance at an exposure of {reference_ms:g} ms = g(M)/V · {reference_ms:g} ms / exposure"
        if self.limit is None:
            saturated = "; saturated pixels are NaN" if self.mask_saturated else ""
            return f"{light}, as 32-bit float; 1 saturates the camera where V = 1{saturated}"
        scale = f"{self.limit}" if self.white == 1 else f"{self.limit} / {self.white:g}"
        saturated = f"; saturated pixels are {self.limit}" if self.mask_saturated else ""
        return f"{scale} times the {light}, linear, at most {self.limit}{saturated}"
