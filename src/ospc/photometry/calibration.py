"""A photometric calibration with its uncertainties and verdicts."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ospc.arrays import BoolArray, ByValue, FloatArray, Image, ImageSize, read_only
from ospc.errors import FormatError, SettingError, counted, os_error_as, path_of
from ospc.photometry.coverage import Coverage, ExposureRatios
from ospc.photometry.grey_range import checked_max_grey
from ospc.photometry.noise import NoiseModel
from ospc.photometry.notebook import curve_as_svg
from ospc.photometry.response import Response
from ospc.photometry.verdict import EffectEstimate, Verdict
from ospc.photometry.vignette import RasterVignette, Vignette, diagonal_profile
from ospc.system.atomic import write_atomically

if TYPE_CHECKING:
    from ospc.photometry.correction import Corrector

SCHEMA = "ospc-calibration/1"
PROFILE_RADII = read_only(np.linspace(0.0, 1.0, 51))
"""Radii in half diagonals at which the uncertainty of the vignette is given: 0, 0.02, … 1, finer than it varies."""
_MAX_BYTES = 100_000_000
"""Largest calibration file that is read; one with a covariance of 100 parameters is smaller than a megabyte."""


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(ByValue):
    """Response and vignette of a camera with their uncertainties. Unknown parts are None.

    Attributes
    ----------
    size
        Width and height of the images in pixels.
    response
        The camera response; None if it is not identifiable.
    vignette
        The vignette; None if it is not identifiable.
    verdicts
        For ``"response"``, ``"vignette"`` and ``"exposures"``: whether each is identifiable, marginal or not
        identifiable, why, and what to record instead.
    vignette_sigma
        Standard deviation of the radial profile at the 51 radii 0, 0.02, … 1, shape (51,).
    noise
        Noise of a grey value, estimated from the recording.
    exposure_ratios
        Re-estimated exposure ratios compared with the metadata.
    covariance
        For each estimated part, its parameter names and covariance matrix.
    max_grey
        Largest grey value of the images: 255 for 8 bit.
    converged
        Whether response and vignette are identifiable and there are no warnings about the exposures; with preset
        "paper", whether two estimates of each were accepted.
    partial
        Whether the run was interrupted, or failed before the end of the recording.
    counts
        Numbers of frames, skipped frames, pairs and samples used.
    settings
        All settings of the method.
    source
        Identification of the recording.
    versions
        Versions of the software used.
    advice
        How to reduce the uncertainty, most helpful first.
    notes
        Findings about exposures, optics and sensor that were corrected.
    warnings
        Reasons not to rely on the result, such as contradictions between the images and the exposures or the model.
    effects
        Estimates of effects other than response and vignette, such as veiling glare.
    coverage
        Coverage of the observations and their residuals; None if the method keeps no tables.
    exponent_sigma
        Standard deviation of ln γ if no exposures were given, because response, vignette and exposures are then only
        known up to a common exponent γ; otherwise 0. It is included in the other standard deviations, but not in the
        covariance.
    rests_on
        The assumptions behind a guess from single images, or the caveat of imported files; empty for a calibration
        from measurements.
    """

    size: ImageSize
    response: Response | None = None
    vignette: Vignette | None = None
    verdicts: dict[str, Verdict] = field(default_factory=dict)
    vignette_sigma: FloatArray | None = None
    noise: NoiseModel | None = None
    exposure_ratios: ExposureRatios = field(default_factory=ExposureRatios.none)
    covariance: dict[str, dict[str, Any]] = field(default_factory=dict)
    max_grey: int = 255
    converged: bool = False
    partial: bool = False
    counts: dict[str, int] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    source: dict[str, Any] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    advice: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    effects: tuple[EffectEstimate, ...] = ()
    coverage: Coverage | None = None
    exponent_sigma: float = 0.0
    rests_on: str = ""

    @property
    def complete(self) -> bool:
        """Whether response, vignette and exposures are identifiable and there are no warnings."""
        known = self.response is not None and self.vignette is not None
        sure = all(verdict.state == "identifiable" for verdict in self.verdicts.values())
        return known and sure and not self.warnings

    @property
    def caveat(self) -> str:
        """Caveat to include in all output if the exposures were unknown or the calibration is a guess; or ""."""
        if not self.exponent_sigma:
            return self.rests_on
        return (
            "The exposures were unknown: response, vignette and exposures are estimated up to one common exponent γ "
            f"(ln γ ± {self.exponent_sigma:.2f})"
        )

    def __repr__(self) -> str:
        """Return the source and the verdicts on one line."""
        states = [f"{name} {verdict.state}" for name, verdict in self.verdicts.items()]
        return f"<Calibration of {', '.join([self._basis, *states])}>"

    def _repr_html_(self) -> str:
        """Return the HTML that notebooks show: the source, the verdicts with their reasons, and the curves."""
        rows = "".join(
            f"<tr><th>{escape(name)}</th><td>{escape(verdict.state)}</td><td>{escape(verdict.reason)}</td></tr>"
            for name, verdict in self.verdicts.items()
        )
        return f"<table><caption>Calibration of {escape(self._basis)}</caption>{rows}</table>{self.curves_as_svg()}"

    def curves_as_svg(self) -> str:
        """Return small SVG plots of the known curves with their confidence bands."""
        shown = ""
        if self.response is not None:
            grey = np.linspace(0, 1, len(PROFILE_RADII))
            sigma = self.response.inverse_sigma
            spread = None if sigma is None else np.interp(grey, self.response.levels, sigma)
            shown += curve_as_svg("response g(M)", "grey level M", grey, self.response.inverse(grey), spread)
        if self.vignette is not None:
            profile = diagonal_profile(self.vignette, PROFILE_RADII)
            shown += curve_as_svg("vignette V(R)", "radius R", PROFILE_RADII, profile, self.vignette_sigma)
        return shown

    @property
    def _basis(self) -> str:
        parts = [str(self.source.get("name") or "a camera"), f"{self.size[0]}×{self.size[1]} pixels"]
        if "frames" in self.counts:
            parts.append(counted(self.counts["frames"], "frame"))
        return ", ".join([*parts, "partial"] if self.partial else parts)

    def correct(
        self,
        image: Image,
        exposure_ms: float | None = None,
        *,
        dtype: npt.DTypeLike = np.float32,
        white: float = 1.0,
        mark_saturated: bool = True,
        max_grey: int | None = None,
        assume_missing: bool = False,
    ) -> npt.NDArray[Any]:
        """Return the irradiance of every pixel, corrected for the vignette, or the radiance if the exposure is given.

        The irradiance is e·L = g(M)/V(x), with exposure e, radiance L, grey level M, inverse response g and vignette
        V. Apply it before any undistortion or scaling.

        Parameters
        ----------
        image, exposure_ms, dtype, white, mark_saturated
            As for :meth:`Corrector.correct <ospc.photometry.correction.Corrector.correct>`.
        max_grey
            Largest grey value of the image; None for that of the calibration.
        assume_missing
            Whether to replace an unknown response or vignette by the identity instead of raising an error.

        Raises
        ------
        NotObservableError, SettingError, FrameError, ExposureError
            As for :meth:`Corrector.correct <ospc.photometry.correction.Corrector.correct>`.
        """
        corrector = self._corrector(max_grey, assume_missing)
        return corrector.correct(image, exposure_ms, dtype=dtype, white=white, mark_saturated=mark_saturated)

    def saturated(self, image: Image, *, max_grey: int | None = None) -> BoolArray:
        """Return which pixels are saturated, so that their grey value is only a lower bound of their irradiance.

        ``image`` and ``max_grey`` are as for :meth:`correct`. The result has the shape of the image.

        Raises
        ------
        FrameError
            If the type or the bit depth of the image is wrong.
        SettingError
            If ``max_grey`` is not a grey value.
        """
        return self._corrector(max_grey, assume_missing=True).saturated(image)

    def warp_exposure(self, image: Image, from_ms: float, to_ms: float, *, max_grey: int | None = None) -> Image:
        """Return the image the camera would have recorded of the same scene at another exposure.

        ``from_ms`` and ``to_ms`` are its exposure and the new one, in milliseconds times linear gain; ``image`` and
        ``max_grey`` are as for :meth:`correct`. The result has the shape and type of the image. Details and errors
        are those of :meth:`Corrector.warp_exposure <ospc.photometry.correction.Corrector.warp_exposure>`.
        """
        return self._corrector(max_grey, assume_missing=False).warp_exposure(image, from_ms, to_ms)

    def _corrector(self, max_grey: int | None, assume_missing: bool) -> Corrector:
        from ospc.photometry.correction import Corrector  # loads OpenCV, which is not needed otherwise

        grey = self.max_grey if max_grey is None else checked_max_grey(max_grey, "correction", SettingError)
        key = (grey, assume_missing)
        if key not in self._correctors:
            self._correctors[key] = Corrector(self.response, self.vignette, *key)
        return self._correctors[key]

    @cached_property
    def _correctors(self) -> dict[tuple[int, bool], Corrector]:
        return {}

    def save(self, path: str | Path) -> Path:
        """Write the calibration to a JSON file atomically and return its path.

        A raster vignette is written next to it as ``.vignette.npz``.

        Raises
        ------
        FormatError
            If the file cannot be written, or the calibration contains a value that JSON has no form for; an earlier
            file is then unchanged.
        """
        place = path_of(path, FormatError, "a calibration")
        try:
            content = json.dumps(self.as_dict(), indent=1, allow_nan=False) + "\n"
        except (TypeError, ValueError) as error:
            raise FormatError(f"{place}: not written, because JSON has no form for it ({error})") from None
        with os_error_as(FormatError, f"{place}: cannot be written", "check that the folder exists and is writable"):
            if isinstance(self.vignette, RasterVignette):
                self.vignette.write_map(map_beside(place))
            return write_atomically(place, content.encode("utf-8"))

    @classmethod
    def load(cls, path: str | Path) -> Calibration:
        """Read a calibration written by :meth:`save`: a JSON file, or a folder with ``calibration.json``.

        Raises
        ------
        FormatError
            If the file is not a calibration, or its version is unknown.
        """
        from ospc.photometry.calibration_content import from_dict

        place = path_of(path, FormatError, "a calibration")
        if place.is_dir():
            place = place / "calibration.json"
        try:
            if place.stat().st_size > _MAX_BYTES:
                raise ValueError(f"larger than {_MAX_BYTES // 10**6} MB")
            text = place.read_text(encoding="utf-8")
            content = json.loads(text, parse_constant=_finite, parse_float=_finite)
        except FileNotFoundError:
            raise FormatError(f"{place}: there is no such calibration; give calibration.json or its folder") from None
        except (OSError, ValueError, RecursionError) as error:
            raise FormatError(
                f"{place}: not readable as a calibration ({error}); give calibration.json, or convert the file with "
                "'ospc import'"
            ) from None
        found = content.get("schema") if isinstance(content, dict) else None
        if found != SCHEMA:
            raise FormatError(
                f"{place}: not a calibration that this version can read (schema {found!r}, expected {SCHEMA!r})"
            )
        try:
            return from_dict(content, map_beside(place))
        except FormatError as error:
            raise FormatError(f"{place}: damaged calibration ({error})") from None

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> Calibration:
        """Return a calibration from the values of :meth:`as_dict`.

        Raises
        ------
        FormatError
            If a value is missing or impossible, or the vignette is a raster, whose map is in a file.
        """
        from ospc.photometry.calibration_content import from_dict

        return from_dict(content, None)

    def as_dict(self) -> dict[str, Any]:
        """Return all fields as JSON-compatible values, the documented content of ``calibration.json``."""
        from ospc.photometry.calibration_content import to_dict

        return to_dict(self)


def map_beside(file: Path) -> Path:
    """Return the path of the raster vignette of a calibration file: its name with ``.vignette.npz`` for ``.json``."""
    return file.with_name(f"{file.name.removesuffix('.json')}.vignette.npz")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is not a finite number")
    return value
