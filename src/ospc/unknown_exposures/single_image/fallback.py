"""Response and vignette where nothing is known: from one photograph or a few, with bands as wide as their errors.

The response is that of edge colours (Lin et al. 2004) where there are enough even regions in colour, drawn towards
the usual one, which is all there is otherwise. The vignette is that of radial gradients (Zheng et al. 2008), drawn
towards a usual one, because the shading of a scene looks like a vignette. Edge histograms and segments, which these
methods compete with, were farther off on simulated photographs. The bands are the errors found there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ospc.arrays import FloatArray, Image, ImageSize
from ospc.errors import FrameError, NotObservableError, counted
from ospc.formats.files import read_bytes
from ospc.photometry.calibration import PROFILE_RADII, Calibration, Verdict
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette
from ospc.recording import open_recording
from ospc.recording.channel import Channel
from ospc.recording.frame import size_of
from ospc.recording.image_source import MAX_FILE_BYTES, decode_stored, is_image_name
from ospc.recording.options import DEFAULT, ReadingOptions
from ospc.recording.pixel_layout import detect_bit_depth
from ospc.unknown_exposures.single_image.edges import EdgePatches, edge_colour_response
from ospc.unknown_exposures.single_image.response_prior import COMPONENTS, response_prior
from ospc.unknown_exposures.single_image.zheng_2008 import radial_gradient_vignette
from ospc.versions import versions

_MOST_IMAGES = 8
"""Images of a recording that are used, spread evenly: more show the same surfaces again."""

_SHAPE_SIGMA = 0.4
"""Standard deviation of ln g(M)/g(½) over its size, as of an exponent, on simulated photographs."""

_LEAST_LOG_SIGMA = 0.08
"""Standard deviation of ln g(M)/g(½) next to ½: curves differ there by more than an exponent."""

_CORNER_SIGMA = 0.2
"""Standard deviation of V in the corners; it grows as the radius. 0.11 on simulated photographs by usual lenses, but
wide ones lose more."""

_OWN_RESPONSE, _OWN_VIGNETTE = 0.5, 0.2
"""Shares of the estimates against usual curves: errors are smallest so on simulated photographs."""

_USUAL_VIGNETTE = (-0.2, -0.1, -0.05)
"""v₁, v₂, v₃ of a usual vignette."""

_DARKEST, _BRIGHTEST = 2, 250
"""Grey levels outside of which a pixel may be clipped."""

_SMALLEST_PX = 32
"""Width and height that an image needs: with less, neither edges nor rings show."""

_REMEDY = "record a video whose exposure changes and is known: 'ospc check' says what it takes"


def single_images(path: str | Path, kind: str | None = None, options: ReadingOptions = DEFAULT) -> list[Image]:
    """Return the photograph at a path, or a few frames of the recording there, in colour if they have colours.

    RecordingError if it is neither, FrameError if an image is damaged.
    """
    place = Path(path)
    if place.is_file() and is_image_name(place.name):
        data = read_bytes(place, MAX_FILE_BYTES, FrameError)
        return [decode_stored(data, str(place), Channel.ALL).pixels]
    recording = open_recording(place, kind, replace(options, unknown_exposures=True, channel=Channel.ALL))
    wanted = set(np.linspace(0, len(recording) - 1, _MOST_IMAGES).astype(int).tolist())
    return [frame.image_8_bit for number, frame in enumerate(recording) if number in wanted]


def calibrate_single_images(images: Sequence[Image]) -> Calibration:
    """Return response and vignette of one photograph, or of several by the same camera, with wide bands.

    The images have 8 or 16 bits, one size, and the shape (height, width), or (height, width, 3) in the order blue,
    green, red. FrameError if there is none, or they differ in size, or are tiny.
    """
    if len({image.shape for image in images}) != 1:
        raise FrameError("single images must be at least one, and of one size")
    size = size_of(images[0])
    if min(size) < _SMALLEST_PX:
        raise FrameError(
            f"an image of {size[0]}x{size[1]} pixels shows too little; give one of {_SMALLEST_PX}x"
            f"{_SMALLEST_PX} or more"
        )
    eight = _in_8_bits(images)
    response, basis = _response(eight)
    vignette, shading = _vignette(size, eight, response)
    count = counted(len(eight), "image")
    reason = f"from {count} without known exposures: it rests on {{}}, and its band is that of simulated photographs"
    return Calibration(
        size,
        response,
        vignette,
        verdicts={
            "response": Verdict("marginal", reason.format(basis), _REMEDY),
            "vignette": Verdict("marginal", reason.format(shading), _REMEDY),
            "exposures": Verdict("not identifiable", "single images say nothing of exposures", _REMEDY),
        },
        vignette_sigma=np.asarray(_CORNER_SIGMA * PROFILE_RADII),
        counts={"frames": len(eight)},
        versions=versions(),
        advice=(_REMEDY,),
        rests_on=f"Guessed from {count} without exposures: g from {basis}, V from {shading}",
    )


def _in_8_bits(images: Sequence[Image]) -> list[Image]:
    if images[0].dtype == np.uint8:
        return list(images)
    depth = detect_bit_depth(images)
    whole = depth.max_grey << depth.shift
    return [np.rint(np.minimum(image, whole) * (255 / whole)).astype(np.uint8) for image in images]


def _response(images: Sequence[Image]) -> tuple[Response, str]:
    """Return the response with its band, and what it rests on."""
    try:
        patches = EdgePatches.of(images)
        own = np.array(edge_colour_response(patches).model["coefficients"])
        found = response_prior().response(_OWN_RESPONSE * own, "edge-colours")
        basis = f"{len(patches.first)} edges in colour and usual curves"
    except NotObservableError:
        found = response_prior().response(np.zeros(COMPONENTS), "usual")
        basis = "usual curves, for want of edges in colour"
    log_g = np.log(np.maximum(found.inverse_table, np.finfo(float).tiny))
    log_reference = float(np.log(found.inverse(found.reference_grey)))
    sigma = np.hypot(_LEAST_LOG_SIGMA, _SHAPE_SIGMA * np.abs(log_g - log_reference))
    return replace(found, log_sigma=sigma, scale_sigma=float(_SHAPE_SIGMA * abs(log_reference))), basis


def _vignette(size: ImageSize, images: Sequence[Image], response: Response) -> tuple[PolynomialVignette, str]:
    """Return the vignette, and what it rests on."""
    greys = [image if image.ndim == 2 else image[..., 1] for image in images]
    light: list[FloatArray] = [response.inverse(grey / 255) for grey in greys]
    usual = PolynomialVignette(size, _USUAL_VIGNETTE)
    try:
        own = radial_gradient_vignette(light, [(grey > _DARKEST) & (grey < _BRIGHTEST) for grey in greys])
    except NotObservableError:
        return usual, "usual curves, for want of exposed pixels"
    both = zip(own.coefficients, _USUAL_VIGNETTE, strict=True)
    blended = tuple(_OWN_VIGNETTE * a + (1 - _OWN_VIGNETTE) * b for a, b in both)
    return PolynomialVignette(size, blended), "radial gradients and usual curves"
