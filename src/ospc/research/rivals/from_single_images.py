"""Methods for single images, run by studies on a few frames spread over a recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from ospc.arrays import Image
from ospc.photometry.response import Response
from ospc.recording.frame import Frame
from ospc.research.method import Estimate, Outcome, outcomes_of
from ospc.settings.single_image import PRIOR_COMPONENTS
from ospc.unknown_exposures.single_image.edges import EdgePatches
from ospc.unknown_exposures.single_image.fallback import calibrate_single_images
from ospc.unknown_exposures.single_image.response_prior import response_prior
from ospc.unknown_exposures.single_image.zheng_2008 import radial_gradient_vignette, segment_vignette

_IMAGES, _APART = 4, 40
"""Number of frames used, and their distance: closer ones show the same scene."""

_BRIGHTEST = 250
"""Grey level from which a pixel may be clipped."""


class FromSingleImages:
    """Stores a few frames and estimates at the end. Variants, by name, are functions of the 8-bit images."""

    def __init__(self, variants: dict[str, Callable[[Sequence[Image]], Estimate]]) -> None:
        self._variants = variants
        self._images: list[Image] = []
        self._count = 0

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        if self._count % _APART == 0 and len(self._images) < _IMAGES:
            self._images.append(frame.image if frame.image.ndim == 3 else frame.image_8_bit)
        self._count += 1

    def found(self) -> dict[str, Outcome]:
        """Return the outcomes."""
        return outcomes_of({name: partial(estimate, self._images) for name, estimate in self._variants.items()})


def from_edges(name: str, response_of: Callable[[EdgePatches], Response]) -> FromSingleImages:
    """Return a method that estimates the response from windows across edges."""
    return FromSingleImages({name: lambda images: Estimate(response_of(EdgePatches.of(images)))})


def zheng_2008(truth: Response | None) -> FromSingleImages:
    """Return the method of radial gradients for the vignette, with the true and with a typical response."""

    def vignette(response: Response, images: Sequence[Image]) -> Estimate:
        masks = [image < _BRIGHTEST for image in images]
        return Estimate(vignette=radial_gradient_vignette([response.inverse(i / 255) for i in images], masks))

    return _by_response("zheng-2008", truth, vignette)


def zheng_segments(truth: Response | None) -> FromSingleImages:
    """Return the method of segments for the vignette, on the first image, with the true and a typical response."""

    def vignette(response: Response, images: Sequence[Image]) -> Estimate:
        return Estimate(vignette=segment_vignette(response.inverse(images[0] / 255)))

    return _by_response("zheng-segments", truth, vignette)


def _by_response(
    name: str, truth: Response | None, vignette: Callable[[Response, Sequence[Image]], Estimate]
) -> FromSingleImages:
    usual = response_prior().response(np.zeros(PRIOR_COMPONENTS), "usual")
    responses = {"without": usual} if truth is None else {"with": truth, "without": usual}
    return FromSingleImages({f"{name}-{key}": partial(vignette, response) for key, response in responses.items()})


def fallback() -> FromSingleImages:
    """Return the method of ``ospc calibrate --fallback single-image``."""
    return FromSingleImages({"fallback-without": lambda images: Estimate.of(calibrate_single_images(images))})
