"""Response and vignette from one or a few photographs without known exposures, with realistic confidence bands.

The response is that of a typical camera. Published methods that estimate it from single images (Lin et al. 2004: the
colours of edges) found no suitable edges in any of 128 real pictures with known responses. The vignette is estimated
from radial gradients (Zheng et al. 2008) and shrunk towards a typical vignette, because the shading of a scene looks
like a vignette. The bands are the errors for measured responses and simulated photographs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ospc.arrays import FloatArray, Image, ImageSize
from ospc.errors import FrameError, NotObservableError, counted
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.response import Response
from ospc.photometry.verdict import Verdict
from ospc.photometry.vignette import PolynomialVignette
from ospc.recording import Recording
from ospc.recording.stream import usable_frames
from ospc.settings.unknown_exposures import (
    BRIGHTEST_PIXEL_8_BIT,
    CORNER_SIGMA,
    DARKEST_PIXEL_8_BIT,
    MAX_SINGLE_IMAGES,
    MIN_SHAPE_SIGMA,
    MIN_SINGLE_IMAGE_SIDE_PX,
    OWN_VIGNETTE_WEIGHT,
    SHAPE_SIGMA,
    TYPICAL_VIGNETTE,
)
from ospc.system.versions import versions
from ospc.unknown_exposures.response_model import family_of_inverses
from ospc.unknown_exposures.single_image.zheng_2008 import radial_gradient_vignette

_REMEDY = "record a video with changing, known exposures; check it with 'ospc check'"


def calibrate_single_images(recording: Recording) -> Calibration:
    """Estimate response and vignette from one photograph, or from several by the same camera, with wide bands.

    Of a recording with many frames, a few are used. FrameError if none can be read, or they are too small.
    """
    size = recording.size
    if min(size) < MIN_SINGLE_IMAGE_SIDE_PX:
        raise FrameError(
            f"an image of {size[0]}×{size[1]} pixels is too small; give one of at least "
            f"{MIN_SINGLE_IMAGE_SIDE_PX}×{MIN_SINGLE_IMAGE_SIDE_PX} pixels"
        )
    wanted = set(np.linspace(0, len(recording) - 1, MAX_SINGLE_IMAGES).astype(int).tolist())
    images = [frame.image_8_bit for frame in usable_frames(f for f in recording if f.index in wanted)]
    if not images:
        raise FrameError(f"{recording.path}: none of its images can be read")
    response = _response()
    vignette, shading = _vignette(size, images, response)
    count = counted(len(images), "image")
    reason = f"from {count} without known exposures, based on {{}}; its band is that of typical cameras"
    return Calibration(
        size,
        response,
        vignette,
        verdicts={
            "response": Verdict("marginal", reason.format("a typical curve"), _REMEDY),
            "vignette": Verdict("marginal", reason.format(shading), _REMEDY),
            "exposures": Verdict("not identifiable", "single images do not determine exposures", _REMEDY),
        },
        vignette_sigma=np.asarray(CORNER_SIGMA * PROFILE_RADII),
        max_grey=recording.max_grey,
        counts={"frames": len(images)},
        versions=versions(),
        advice=(_REMEDY,),
        rests_on=f"Guessed from {count} without exposures: g from a typical curve, V from {shading}",
    )


def _response() -> Response:
    """Return the mean response of typical cameras with its band."""
    sigma = np.full(256, MIN_SHAPE_SIGMA)
    usual = Response.from_values(family_of_inverses(256).mean(axis=0), model={"name": "usual"}, log_sigma=sigma)
    return usual.with_uncertain_exponent(SHAPE_SIGMA)


def _vignette(size: ImageSize, images: Sequence[Image], response: Response) -> tuple[PolynomialVignette, str]:
    """Return the vignette, and a description of its basis."""
    light: list[FloatArray] = [response.inverse(grey / 255) for grey in images]
    usual = PolynomialVignette(size, TYPICAL_VIGNETTE)
    try:
        own = radial_gradient_vignette(
            light, [(grey > DARKEST_PIXEL_8_BIT) & (grey < BRIGHTEST_PIXEL_8_BIT) for grey in images]
        )
    except NotObservableError:
        return usual, "typical curves, for lack of exposed pixels"
    both = zip(own.coefficients, TYPICAL_VIGNETTE, strict=True)
    blended = tuple(OWN_VIGNETTE_WEIGHT * a + (1 - OWN_VIGNETTE_WEIGHT) * b for a, b in both)
    return PolynomialVignette(size, blended), "radial gradients and typical curves"
