"""Where every place of one frame is in another: dense registration of frames brought to equal brightness."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ospc.arrays import Float32Array, FloatArray, ImageSize
from ospc.correspondence.preprocessing import PreprocessedFrame
from ospc.photometry.geometry import pixel_grid
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette

_DISPLAY_GAMMA = 2.2


@dataclass(frozen=True)
class Registration:
    """Displacements between two views.

    Attributes
    ----------
    forward
        Displacement (x, y) from each place of the first to the second, in small pixels, shape (h, w, 2).
    forward_backward_error
        How far going there and back ends from where it began, in the same pixels, shape (h, w).
    """

    forward: Float32Array
    forward_backward_error: Float32Array


class ExposureNormalizer:
    """Brings small images to what they would show at one exposure, without vignette, on a display's scale.

    Parameters
    ----------
    response
        What is known of the response; the typical display gamma where nothing is.
    vignette
        What is known of the vignette; None for V ≡ 1.
    """

    def __init__(self, response: Response | None = None, vignette: Vignette | None = None) -> None:
        known = response if response is not None else Response.gamma(_DISPLAY_GAMMA)
        self._root = known.inverse(np.arange(256) / 255) ** (1 / _DISPLAY_GAMMA)
        self._vignette = vignette
        self._lift: dict[tuple[int, ...], Float32Array] = {}

    def __call__(self, view: PreprocessedFrame, log_exposure: float) -> npt.NDArray[np.uint8]:
        """Return the small image of a view as it would be at another exposure, shape (h, w)."""
        gain = np.exp((log_exposure - view.log_exposure) / _DISPLAY_GAMMA) * 255
        table = (self._root * gain).astype(np.float32)
        if self._vignette is None:
            # The look-up of bytes gives bytes: clipped here, as the multiplication below clips by itself.
            return np.asarray(cv2.LUT(view.small, np.clip(table, 0, 255).astype(np.uint8)))
        bright = cv2.LUT(view.small, table) * self._lift_of(view.small.shape, view.size)
        return np.asarray(cv2.convertScaleAbs(bright), dtype=np.uint8)

    def _lift_of(self, shape: tuple[int, ...], size: ImageSize) -> Float32Array:
        if shape not in self._lift and self._vignette is not None:
            scale = np.array(size) / np.array(shape[::-1])
            places = (pixel_grid((shape[1], shape[0])) + 0.5) * scale - 0.5
            self._lift[shape] = (self._vignette.at(places) ** (-1 / _DISPLAY_GAMMA)).astype(np.float32)
        return self._lift[shape]


class DenseRegistration:
    """Dense inverse search (Kroeger et al. 2016), OpenCV's implementation, on equalised images.

    The variational refinement weighs the constancy of the gradient only. Constancy of brightness, weighed too by
    default, pulls flat places to where the brightness agrees: with the vignette not yet known that is a wrong place,
    and grey values sampled there have lost the very difference they were meant to show.

    The way back only tells where the way there is wrong, by pixels: it is computed more coarsely.

    Parameters
    ----------
    second
        Where the way back is computed while this thread computes the way there; None for one after the other. The
        result is the same.
    """

    def __init__(self, second: Executor | None = None) -> None:
        self._second = second
        self._there, self._back = _flow(finest=1), _flow(finest=2)

    def __call__(
        self, view0: PreprocessedFrame, view1: PreprocessedFrame, normalizer: ExposureNormalizer
    ) -> Registration:
        """Register two views in both directions."""
        # At the longer exposure both images clip at the same radiance, and no edge of a clipped area misleads.
        target = max(view0.log_exposure, view1.log_exposure)
        image0, image1 = normalizer(view0, target), normalizer(view1, target)
        if self._second is None:
            forward, backward = self._there.calc(image0, image1, None), self._back.calc(image1, image0, None)
        else:
            returning = self._second.submit(self._back.calc, image1, image0, None)
            forward = self._there.calc(image0, image1, None)
            backward = returning.result()
        return Registration(forward, _forward_backward_error(forward, backward))


def _flow(finest: int) -> Any:
    """Return a registration down to the image halved so many times; places between are interpolated."""
    flow = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    # Half the steps on a coarser lattice of patches: flat places, where grey values are sampled, forgive the rest.
    flow.setGradientDescentIterations(12)
    flow.setPatchStride(4)
    flow.setFinestScale(finest)
    flow.setVariationalRefinementDelta(0.0)
    flow.setVariationalRefinementGamma(20.0)
    return flow


def _forward_backward_error(forward: Float32Array, backward: Float32Array) -> Float32Array:
    height, width = forward.shape[:2]
    there = _places(width, height) + forward
    # Outside the image there is no way back: a far displacement says so.
    away = (1e4, 1e4, 0.0, 0.0)
    back = cv2.remap(backward, there, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=away)
    back += forward
    return np.asarray(cv2.magnitude(*cv2.split(back)), dtype=np.float32)


@lru_cache(maxsize=4)
def _places(width: int, height: int) -> Float32Array:
    places = pixel_grid((width, height)).astype(np.float32)
    places.setflags(write=False)
    return places


def displacement_at(registration: Registration, points: FloatArray, scale: float) -> tuple[FloatArray, FloatArray]:
    """Return displacement, (n, 2), and forward-backward error, (n,), at places of the reduced image, in its pixels.

    Parameters
    ----------
    registration
        Registration of the small images.
    points
        Places (x, y) of the reduced image, shape (n, 2).
    scale
        Size of the reduced over that of the small image.
    """
    if len(points) == 0:
        return np.empty((0, 2)), np.empty(0)
    small = ((points + 0.5) / scale - 0.5).astype(np.float32).reshape(-1, 1, 2)
    forward = cv2.remap(registration.forward, small, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    forward_backward_error = cv2.remap(
        registration.forward_backward_error, small, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return forward.reshape(-1, 2).astype(np.float64) * scale, forward_backward_error.reshape(-1).astype(
        np.float64
    ) * scale
