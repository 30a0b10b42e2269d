"""Calibrations for images that are cropped or scaled after the calibration.

The response does not change, and the vignette moves with the pixels. Parts that are no longer valid are left out: the
noise of averaged pixels, and the uncertainty of a profile about another centre.
"""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np

from ospc.arrays import Image, ImageSize
from ospc.errors import SettingError
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.geometry import half_diagonal, image_size, same_aspect
from ospc.photometry.vignette import RasterVignette, Vignette, VignetteModel

_CENTRED_PX = 1.0
"""Largest difference between the margins of a centred part: they cannot be equal for an odd number of pixels."""


def resampled(image: Image, size: ImageSize) -> Image:
    """Return an image scaled to another size, of the same type."""
    how = cv2.INTER_AREA if size[0] < image.shape[1] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, size, interpolation=how))


def resize_calibration(calibration: Calibration, size: ImageSize) -> Calibration:
    """Return the calibration for the same field of view at another resolution, without noise.

    Raises
    ------
    SettingError
        If the aspect ratio differs by more than 1 %, because the images are also cropped.
    """
    image_size(*size, SettingError)
    whole = calibration.size
    if not same_aspect(size, whole):
        raise SettingError(
            f"{whole[0]}×{whole[1]} cannot be scaled to {size[0]}×{size[1]}, which has another aspect ratio; crop it "
            "first"
        )
    vignette = None if calibration.vignette is None else _resized(calibration.vignette, size)
    return _changed(calibration, size, vignette, {"resized_to": list(size)})


def _resized(vignette: Vignette, size: ImageSize) -> Vignette:
    if isinstance(vignette, VignetteModel):
        scale = math.hypot(*vignette.size) / math.hypot(*size)
        unit = scale * half_diagonal(size) / half_diagonal(vignette.size)
        centre = (vignette.centre[0] / unit, vignette.centre[1] / unit)
        return vignette.moved(size, centre, unit)
    source = vignette.source if isinstance(vignette, RasterVignette) else vignette.as_dict()
    return RasterVignette(resampled(vignette.image(), size), source)


def crop_calibration(calibration: Calibration, offset: tuple[int, int], size: ImageSize) -> Calibration:
    """Return the calibration for a part of the images; ``offset`` is the column and row of its first pixel.

    Each pixel keeps its attenuation, so the centre moves in the image. If the part is centred, the uncertainty of the
    profile is kept for the remaining radii.

    Raises
    ------
    SettingError
        If the part is not inside the image.
    """
    image_size(*size, SettingError)
    whole = calibration.size
    if not all(o >= 0 and o + s <= w for o, s, w in zip(offset, size, whole, strict=True)):
        raise SettingError(
            f"{size[0]}×{size[1]} pixels from ({offset[0]}, {offset[1]}) are not inside {whole[0]}×{whole[1]}"
        )
    vignette = None if calibration.vignette is None else _cropped(calibration.vignette, offset, size)
    margins = [w - o - s - o for w, o, s in zip(whole, offset, size, strict=True)]
    sigma = calibration.vignette_sigma
    if max(map(abs, margins)) > _CENTRED_PX:
        sigma = None
    if sigma is not None:
        radii = PROFILE_RADII * (half_diagonal(size) / half_diagonal(whole))
        sigma = np.interp(radii, PROFILE_RADII, sigma)
    changed = _changed(calibration, size, vignette, {"cropped_to": [*offset, *size]})
    return replace(changed, vignette_sigma=sigma, noise=calibration.noise)


def _cropped(vignette: Vignette, offset: tuple[int, int], size: ImageSize) -> Vignette:
    if isinstance(vignette, VignetteModel):
        half, new_half = half_diagonal(vignette.size), half_diagonal(size)
        shift = [(w - 1) / 2 - o - (s - 1) / 2 for w, o, s in zip(vignette.size, offset, size, strict=True)]
        centre = tuple((c * half + move) / new_half for c, move in zip(vignette.centre, shift, strict=True))
        return vignette.moved(size, (centre[0], centre[1]), new_half / half)
    values = vignette.image()[offset[1] :, offset[0] :][: size[1], : size[0]]
    return RasterVignette(values, {**vignette.as_dict(), "crop": [*offset, *size]})


def _changed(
    calibration: Calibration, size: ImageSize, vignette: Vignette | None, change: dict[str, list[int]]
) -> Calibration:
    return replace(
        calibration,
        size=size,
        vignette=vignette,
        noise=None,
        covariance={name: part for name, part in calibration.covariance.items() if name == "response"},
        source={**calibration.source, **change},
    )
