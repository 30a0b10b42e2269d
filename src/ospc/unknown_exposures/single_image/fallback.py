"""Response and vignette from one or a few photographs without known exposures, with realistic confidence bands.

The response is that of a typical camera. Published methods that estimate it from single images (Lin et al. 2004: the
colours of edges) found no suitable edges in any of 128 real pictures with known responses. The vignette is estimated
from radial gradients (Zheng et al. 2008) and shrunk towards a typical vignette, because the shading of a scene looks
like a vignette. The bands are the errors for measured responses and simulated photographs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ospc.arrays import FloatArray, Image, ImageSize, size_of
from ospc.errors import FrameError, NotObservableError, counted
from ospc.formats.files import read_bytes
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.response import Response
from ospc.photometry.verdict import Verdict
from ospc.photometry.vignette import PolynomialVignette
from ospc.recording import open_recording
from ospc.recording.channel import Channel
from ospc.recording.image_source import MAX_FILE_BYTES, decode_stored, is_image_name
from ospc.recording.options import DEFAULT, ReadingOptions
from ospc.recording.pixel_layout import detect_bit_depth
from ospc.settings.single_image import (
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
from ospc.unknown_exposures.response_model import family_of_inverses
from ospc.unknown_exposures.single_image.zheng_2008 import radial_gradient_vignette
from ospc.versions import versions

_REMEDY = "record a video with changing, known exposures; check it with 'ospc check'"


def single_images(
    path: str | Path, kind: str | None = None, options: ReadingOptions = DEFAULT
) -> tuple[list[Image], int]:
    """Return the photograph at a path, or a few frames of the recording there, in colour if available.

    The second value is their largest possible grey value. RecordingError if it is neither, FrameError if an image is
    damaged.
    """
    place = Path(path)
    if place.is_file() and is_image_name(place.name):
        data = read_bytes(place, MAX_FILE_BYTES, FrameError)
        stored = decode_stored(data, str(place), Channel.ALL)
        depth = stored.depth or detect_bit_depth([stored.pixels])
        return [stored.pixels >> depth.shift], depth.max_grey
    recording = open_recording(place, kind, replace(options, unknown_exposures=True, channel=Channel.ALL))
    wanted = set(np.linspace(0, len(recording) - 1, MAX_SINGLE_IMAGES).astype(int).tolist())
    return [frame.image for number, frame in enumerate(recording) if number in wanted], recording.max_grey


def calibrate_single_images(images: Sequence[Image], max_grey: int | None = None) -> Calibration:
    """Estimate response and vignette from one photograph, or from several by the same camera, with wide bands.

    The images have 8 or 16 bits, equal sizes, and shape (height, width), or (height, width, 3) in the order blue,
    green, red. ``max_grey`` is their largest possible grey value; None to infer it. FrameError if there are none,
    they differ in size, or they are too small.
    """
    if len({image.shape for image in images}) != 1:
        raise FrameError("give at least one image, and images of equal size")
    size = size_of(images[0])
    if min(size) < MIN_SINGLE_IMAGE_SIDE_PX:
        raise FrameError(
            f"an image of {size[0]}x{size[1]} pixels is too small; give one of at least "
            f"{MIN_SINGLE_IMAGE_SIDE_PX}x{MIN_SINGLE_IMAGE_SIDE_PX} pixels"
        )
    if max_grey is None:
        depth = detect_bit_depth(images)
        images, max_grey = [image >> depth.shift for image in images], depth.max_grey
    eight = [np.rint(np.minimum(image, max_grey) * (255 / max_grey)).astype(np.uint8) for image in images]
    response = _response()
    vignette, shading = _vignette(size, eight, response)
    count = counted(len(eight), "image")
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
        max_grey=max_grey,
        counts={"frames": len(eight)},
        versions=versions(),
        advice=(_REMEDY,),
        rests_on=f"Guessed from {count} without exposures: g from a typical curve, V from {shading}",
    )


def _response() -> Response:
    """Return the mean response of typical cameras with its band."""
    found = Response.from_values(family_of_inverses(256).mean(axis=0), model={"name": "usual"})
    log_g = np.log(np.maximum(found.inverse_table, np.finfo(float).tiny))
    log_reference = float(np.log(found.inverse(found.reference_grey)))
    sigma = np.hypot(MIN_SHAPE_SIGMA, SHAPE_SIGMA * np.abs(log_g - log_reference))
    return replace(found, log_sigma=sigma, scale_sigma=float(SHAPE_SIGMA * abs(log_reference)))


def _vignette(size: ImageSize, images: Sequence[Image], response: Response) -> tuple[PolynomialVignette, str]:
    """Return the vignette, and a description of its basis."""
    greys = [image if image.ndim == 2 else image[..., 1] for image in images]
    light: list[FloatArray] = [response.inverse(grey / 255) for grey in greys]
    usual = PolynomialVignette(size, TYPICAL_VIGNETTE)
    try:
        own = radial_gradient_vignette(
            light, [(grey > DARKEST_PIXEL_8_BIT) & (grey < BRIGHTEST_PIXEL_8_BIT) for grey in greys]
        )
    except NotObservableError:
        return usual, "typical curves, for lack of exposed pixels"
    both = zip(own.coefficients, TYPICAL_VIGNETTE, strict=True)
    blended = tuple(OWN_VIGNETTE_WEIGHT * a + (1 - OWN_VIGNETTE_WEIGHT) * b for a, b in both)
    return PolynomialVignette(size, blended), "radial gradients and typical curves"
