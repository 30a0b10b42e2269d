"""Photometric correction of images: from grey values to irradiance or radiance.

**Correct images first; undistort, rectify, scale or crop them afterwards.** Response and vignette apply to original
sensor pixels. The inverse response of an interpolated grey value is not the interpolated irradiance, and the vignette
at the new position is different.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ospc.arrays import BoolArray, Float32Array, FloatArray, Image, ImageSize, IntArray, number_of
from ospc.errors import ExposureError, FrameError, NotObservableError, SettingError, counted, plain
from ospc.photometry.geometry import same_aspect
from ospc.photometry.grey_range import checked_max_grey
from ospc.photometry.look_up import look_up
from ospc.photometry.response import Response
from ospc.photometry.used_bits import UsedBits
from ospc.photometry.vignette import Vignette

LEAST_ATTENUATION = 1e-3
"""Attenuation below which there is no image, as outside the image circle of a fisheye: dividing by it would only
amplify noise."""
EXPOSURE_RANGE_MS = (1e-9, 1e9)
"""Accepted exposures, from a picosecond to eleven days: no camera comes close to a limit, and results stay finite in
float32."""
_WHITE_RANGE = (1e-12, 1e12)
"""Irradiances or radiances accepted as white, for the same reason."""
_BEYOND = float(2**20)
"""Stands for saturation in integer output: far above 65535, also after division by V ≤ 1, and far below the overflow
of a conversion to integers."""

_OUTPUT_TYPES = (np.dtype(np.float32), np.dtype(np.uint8), np.dtype(np.uint16))


@dataclass(frozen=True)
class Corrector:
    """Removes response and vignette from images: e·L = g(M) / V(x) (paper, image formation M = f(e V L)).

    Create one per camera: an image then takes one table look-up and one multiplication per pixel. It is thread-safe.
    """

    response: Response | Sequence[Response] | None
    """The response, or three for the channels of colour images, in the order of the images. None if unknown."""
    vignette: Vignette | None
    """The vignette; None if unknown."""
    max_grey: int = 255
    """Largest grey value of the images; pixels that reach it are saturated."""
    assume_missing: bool = False
    """Whether to replace an unknown part by the identity (g(M) = M, V = 1) instead of raising an error.
    :attr:`assumed` lists these parts; state them with the result."""

    def __post_init__(self) -> None:
        """Check the bit depth and the number of responses."""
        checked_max_grey(self.max_grey, "correction", SettingError)
        if isinstance(self.response, Sequence) and len(self.response) != 3:
            raise SettingError(
                f"{counted(len(self.response), 'response')} given; give one, or three for colour images"
            )
        if not all(isinstance(response, Response | None) for response in self._responses):
            raise SettingError("a response to correct with must be a Response, or None if it is unknown")

    @property
    def assumed(self) -> tuple[str, ...]:
        """Names of the unknown parts that are replaced by the identity."""
        return tuple(part for part in ("response", "vignette") if self.assume_missing and self._lacks(part))

    def correct(
        self,
        image: Image,
        exposure_ms: float | None = None,
        *,
        dtype: npt.DTypeLike = np.float32,
        white: float = 1.0,
        mark_saturated: bool = True,
    ) -> npt.NDArray[np.generic]:
        """Return the irradiance of every pixel corrected for the vignette, or the radiance if the exposure is given.

        Apply it to the original images of the sensor, before any undistortion, scaling or filtering.

        Parameters
        ----------
        image
            Shape (height, width) or (height, width, 3); uint16, or uint8 if ``max_grey`` is at most 255. The values
            are right-aligned: up to 4095 for 12 bits.
        exposure_ms
            Exposure time times linear gain. If given, the result is divided by it, which makes images of different
            exposures comparable.
        dtype
            float32, or uint8 or uint16 for programs that only read these. The scale stays linear, so 8 bits lose the
            darkest grey levels of a camera with a gamma curve.
        white
            For uint8 and uint16: the irradiance (or radiance) that becomes the largest value. Brighter pixels are
            clipped.
        mark_saturated
            Whether saturated pixels become NaN (float32) or the largest value (integers). Otherwise they have the
            lower bound of their irradiance, g(1)/V(x).

        Returns
        -------
        numpy.ndarray
            e·L, or L per millisecond, with the shape of the image. The unit is the irradiance that saturates the
            camera where V = 1. Where V is below :data:`LEAST_ATTENUATION`, the result is NaN, or 0 for integers.

        Raises
        ------
        NotObservableError
            If response or vignette is unknown.
        SettingError
            If an option or the size of the image is wrong.
        FrameError
            If the type or the bit depth of the image is wrong.
        ExposureError
            If the exposure is wrong.
        """
        pixels = self._checked(image)
        self._require("response", "vignette")
        kind, scale = _checked_type(dtype, _OUTPUT_TYPES), 1.0
        if exposure_ms is not None:
            scale = 1.0 / checked_exposure(exposure_ms)
        inverse = self._inverse_vignette(pixels)
        if kind == np.float32:
            bound = np.nan if mark_saturated else scale
            light = look_up(pixels, self._filled(self._inverse_columns * scale, bound, pixels).astype(np.float32))
            return light if inverse is None else np.asarray(cv2.multiply(light, inverse, light))
        limit = float(np.iinfo(kind).max)
        scale *= limit / checked_white(white)
        table = self._filled(self._inverse_columns * scale, _BEYOND if mark_saturated else scale, pixels)
        if inverse is None:
            return look_up(pixels, np.rint(np.minimum(table, limit)).astype(kind))
        light = look_up(pixels, np.minimum(table, _BEYOND).astype(np.float32))
        return np.asarray(cv2.multiply(light, inverse, dtype=cv2.CV_8U if kind == np.uint8 else cv2.CV_16U))

    def without_vignette(
        self,
        image: Image,
        exposure_ms: float | None = None,
        *,
        dtype: npt.DTypeLike = np.uint8,
        white: float = 1.0,
        mark_saturated: bool = True,
    ) -> Image:
        """Return the grey levels that the camera would have recorded without its vignette: f(g(M)/V).

        Parameters and errors are those of :meth:`correct`, but ``dtype`` must be uint8 or uint16. The largest grey
        level of the camera becomes the largest value of this type. The image is unchanged where V = 1, and 0 where V
        is below :data:`LEAST_ATTENUATION`.
        """
        kind = _checked_type(dtype, _OUTPUT_TYPES[1:])
        pixels = self._checked(image)
        self._require("response", "vignette")
        scale = (1.0 if exposure_ms is None else 1.0 / checked_exposure(exposure_ms)) / checked_white(white)
        # In 16 bits, the square root of the irradiance still resolves the darkest grey levels of a gamma curve.
        saturated = _BEYOND if mark_saturated else scale
        table = 65535 * np.sqrt(np.minimum(self._filled(self._inverse_columns * scale, saturated, pixels), _BEYOND))
        root = look_up(pixels, table.astype(np.float32))
        inverse = self._inverse_vignette(pixels)
        ones = np.ones(root.shape, np.float32)
        roots = np.asarray(cv2.multiply(root, ones if inverse is None else np.sqrt(inverse), dtype=cv2.CV_16U))
        irradiance = (np.arange(65536) / 65535) ** 2
        greys = [irradiance if response is None else response(irradiance) for response in self._responses]
        return look_up(roots, np.rint(np.stack(greys, axis=-1) * np.iinfo(kind).max).astype(kind))

    def saturated(self, image: Image) -> BoolArray:
        """Return which pixels are saturated, so that their grey value is only a lower bound of their irradiance.

        These have the largest grey value, or at least the white level of a limited range.

        Raises
        ------
        FrameError
            If the type or the bit depth of the image is wrong.
        """
        pixels = self._checked(image)
        # In the type of the pixels: NumPy would convert all of them to a wider one.
        return np.asarray(pixels >= self._saturated_from.astype(pixels.dtype))

    def warp_exposure(self, image: Image, from_ms: float, to_ms: float) -> Image:
        """Return the image the camera would have recorded of the same scene at another exposure: f(g(M) · to / from).

        Exposures are in milliseconds times linear gain. The vignette cancels and may be unknown; otherwise errors are
        those of :meth:`correct`. Pixels that saturate at the new exposure get the largest grey value. Pixels that are
        already saturated keep it, because their irradiance is unknown. :meth:`saturated` finds both.
        """
        pixels = self._checked(image)
        self._require("response")
        ratio = checked_exposure(to_ms) / checked_exposure(from_ms)
        levels = np.linspace(0.0, 1.0, self.max_grey + 1)
        columns = [np.interp(inverse * ratio, inverse, levels) for inverse in self._inverse_columns.T]
        warped = np.rint(np.stack(columns, axis=-1) * self.max_grey)
        return look_up(pixels, self._filled(warped, self.max_grey, pixels).astype(pixels.dtype))

    @property
    def _responses(self) -> tuple[Response | None, ...]:
        return tuple(self.response) if isinstance(self.response, Sequence) else (self.response,)

    @cached_property
    def _saturated_from(self) -> IntArray:
        """Smallest grey value of saturated pixels, shape (channels or 1,)."""
        levels = np.array([1.0 if response is None else response.white for response in self._responses])
        return np.asarray(np.rint(levels * self.max_grey), dtype=np.int64)

    @cached_property
    def _inverse_columns(self) -> FloatArray:
        """Values of g at all grey levels, shape (max_grey + 1, channels or 1)."""
        levels = np.linspace(0.0, 1.0, self.max_grey + 1)
        return np.stack([levels if r is None else r.inverse(levels) for r in self._responses], axis=-1)

    def _filled(self, columns: FloatArray, saturated: float, pixels: Image) -> FloatArray:
        """Return tables with an entry for every value of the pixel type, so that no index is out of bounds."""
        greys = np.iinfo(pixels.dtype).max + 1
        filled = np.full((greys, columns.shape[1]), saturated)
        exposed = np.arange(len(columns))[:, None] < self._saturated_from
        filled[: len(columns)] = np.where(exposed, columns, saturated)
        return filled

    def _inverse_vignette(self, pixels: Image) -> Float32Array | None:
        """Return 1/V for every value of an image; None if V is assumed to be 1."""
        if self.vignette is None:
            return None
        found, expected = (pixels.shape[1], pixels.shape[0]), self.vignette.size
        if found != expected:
            raise SettingError(wrong_size("the image", found, "the calibration", expected))
        return self._inverse_map if pixels.ndim == 2 else self._inverse_map_of_colour

    @cached_property
    def _inverse_map(self) -> Float32Array:
        assert self.vignette is not None
        attenuation = self.vignette.image()
        lit = attenuation >= LEAST_ATTENUATION
        return np.where(lit, 1 / np.where(lit, attenuation, 1), np.nan).astype(np.float32)

    @cached_property
    def _inverse_map_of_colour(self) -> Float32Array:
        return np.repeat(self._inverse_map[:, :, None], 3, axis=2)

    def _lacks(self, part: str) -> bool:
        """Return whether the vignette is unknown, or the response of any channel."""
        return None in (self._responses if part == "response" else (self.vignette,))

    def _require(self, *parts: str) -> None:
        for part in parts:
            if self._lacks(part) and not self.assume_missing:
                raise NotObservableError(
                    f"the calibration has no {part}; calibrate from a recording that determines it, or allow it to "
                    f"be replaced by the identity"
                )

    def _checked(self, image: Image) -> Image:
        pixels = np.asarray(image)
        pixels = pixels.astype(pixels.dtype.newbyteorder("="), copy=False)
        if pixels.dtype not in (np.uint8, np.uint16) or pixels.size == 0:
            raise FrameError(
                f"an image to correct must be of type uint8 or uint16, not {pixels.dtype}, shape {pixels.shape}"
            )
        if pixels.ndim != 2 and not (pixels.ndim == 3 and pixels.shape[2] == 3):
            raise FrameError(f"an image to correct must be grey or have three channels, not shape {pixels.shape}")
        if len(self._responses) > 1 and pixels.ndim == 2:
            raise FrameError("three responses need an image with three channels, but this one is grey")
        self._check_depth(pixels)
        return pixels

    def _check_depth(self, pixels: Image) -> None:
        """Raise a FrameError if the bits of an image do not match the calibration."""
        if pixels.dtype == np.uint8:
            shift = None if self.max_grey > 255 else 0
        else:
            # Some recorders store 8-bit grey values in 16-bit words, and some store fewer than 16 bits left-aligned.
            shift = UsedBits.of([pixels]).shift_for(self.max_grey)
        if shift == 0:
            return
        remedy = (
            f"which does not match this {pixels.dtype} image; pass max_grey if the response is also valid for its "
            f"bit depth"
            if shift is None
            else f"but those of this image look left-aligned: all are multiples of {1 << shift}; correct "
            f"image >> {shift}"
        )
        raise FrameError(f"the calibration is for grey values up to {self.max_grey}, {remedy}")


def wrong_size(what: str, found: ImageSize, calibration: str, expected: ImageSize) -> str:
    """Return the error message for images whose size differs from the calibration."""
    (width, height), (full_width, full_height) = found, expected
    if same_aspect(found, expected):
        remedy = f"adapt it with 'ospc export --to json --size {width}x{height}'"
    elif same_aspect((height, width), expected):
        remedy = "turn the images as they were when calibrated"
    else:
        remedy = (
            "if they are cropped, adapt it with 'ospc export --to json --crop X,Y,W,H', where the region is that of "
            "the images, and --size if they are also scaled"
        )
    return f"{what} has {width}×{height} pixels, {calibration} is for {full_width}×{full_height}; {remedy}"


def _checked_type(dtype: npt.DTypeLike, allowed: Sequence[np.dtype[Any]]) -> np.dtype[Any]:
    with suppress(TypeError, ValueError):
        if (kind := np.dtype(dtype)) in allowed:
            return kind
    raise SettingError(f"dtype is {dtype!r}; choose {' or '.join(map(str, allowed))}")


def checked_exposure(exposure_ms: float, what: str = "exposure", remedy: str = "give that of the image") -> float:
    """Return an exposure as float; ExposureError if it is outside the :data:`EXPOSURE_RANGE_MS`."""
    number, (low, high) = number_of(exposure_ms), EXPOSURE_RANGE_MS
    if number is None or not low <= number <= high:
        raise ExposureError(f"{what} {exposure_ms} ms is not a positive number below {plain(high)}; {remedy}")
    return number


def checked_white(white: float) -> float:
    """Return the irradiance that becomes white as float; SettingError if it is no positive number."""
    number, (low, high) = number_of(white), _WHITE_RANGE
    if number is None or not low < number < high:
        raise SettingError(f"white is {white}; give a positive number, the irradiance that becomes white")
    return number
