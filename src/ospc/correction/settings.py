"""Settings of a correction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import ExposureError, SettingError

Output: TypeAlias = Literal["irradiance", "grey8", "grey16"]
"""32-bit float TIFF, or PNG of 8 or 16 bit; all are linear in the irradiance."""

DTYPES: dict[Output, type[np.generic]] = {"irradiance": np.float32, "grey8": np.uint8, "grey16": np.uint16}


@dataclass(frozen=True)
class CorrectionSettings:
    """How to correct a recording.

    Attributes
    ----------
    output
        Kind of output images.
    normalise_exposure
        Whether to bring all images to one exposure, e·L · reference/e, instead of keeping their own, e·L.
    reference_ms
        That exposure in milliseconds. If None: 1 for ``irradiance``, so that its values are radiance per
        millisecond; the shortest of the recording for ``grey16``, so that nothing is clipped; the median for
        ``grey8``, which has too few bits for that.
    white
        For ``grey8`` and ``grey16``: the irradiance that becomes the largest grey value. 1 saturates the camera where
        V = 1; only brighter places away from the centre are clipped.
    mask_saturated
        Whether saturated pixels become NaN (``irradiance``) or the largest grey value.
    assume_missing
        Whether an unknown response or vignette is taken to be the identity.
    """

    output: Output = "irradiance"
    normalise_exposure: bool = False
    reference_ms: float | None = None
    white: float = 1.0
    mask_saturated: bool = False
    assume_missing: bool = False

    def __post_init__(self) -> None:
        """Check the values."""
        if self.output not in DTYPES:
            raise SettingError(f"output is {self.output!r}; choose one of {', '.join(DTYPES)}")
        if self.reference_ms is not None and not self.normalise_exposure:
            raise SettingError("a reference exposure needs normalised exposures; add --normalise-exposure")
        if not (np.isfinite(self.white) and self.white > 0):
            raise SettingError(f"white is {self.white}; give the irradiance that becomes white, a positive number")
        if self.reference_ms is not None and not 1e-9 <= self.reference_ms <= 1e9:
            raise ExposureError(f"the reference exposure {self.reference_ms} ms is not a positive number below 1e9")

    @property
    def limit(self) -> int | None:
        """Largest grey value of the output; None for floats, which have none."""
        return {"grey8": 255, "grey16": 65535}.get(self.output)

    def reference_for(self, exposures_ms: FloatArray) -> float | None:
        """Return the exposure in milliseconds that all images are brought to; None if each keeps its own."""
        if not self.normalise_exposure:
            return None
        if self.reference_ms is not None:
            return self.reference_ms
        if self.output == "irradiance":
            return 1.0
        return float(exposures_ms.min() if self.output == "grey16" else np.median(exposures_ms))

    def formula(self, reference_ms: float | None) -> str:
        """Return the meaning of a pixel value, as a sentence; the exposure is that of :meth:`reference_for`."""
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
