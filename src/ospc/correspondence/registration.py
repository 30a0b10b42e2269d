"""Dense registration of frames normalised to equal brightness: the position of each pixel of one in the other.

To add another registration method, write a class that implements :class:`Registrar` and add it to :data:`REGISTRARS`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np

from ospc.arrays import Float32Array, FloatArray
from ospc.correspondence.exposure_normalizer import ExposureNormalizer
from ospc.correspondence.preprocessing import ReducedFrame
from ospc.correspondence.thumbnail_registration import (
    OUTSIDE_PX,
    optical_flow,
    pixel_places,
    rescaled,
    there_and_back,
    values_at,
)
from ospc.correspondence.view_motion import view_motion
from ospc.settings.registration import (
    DISPLACEMENT_CELL_PX,
    DISPLACEMENT_SPREAD_SIGMA_PX,
    JACOBIAN_CELL_PX,
    MAX_DISPLACEMENT_SPREAD_PX,
    REFINEMENT_GRADIENT_WEIGHT,
    REFINEMENT_ITERATIONS,
    SECOND_SEARCH_STEPS,
    SECOND_SEARCH_STRIDE_PX,
)
from ospc.system.second_thread import SecondThread


@dataclass(frozen=True)
class Registration:
    """Displacements between two views."""

    forward: Float32Array
    """Displacement (x, y) from each pixel of the first to the second, in small pixels, shape (h, w, 2)."""
    forward_backward_error: Float32Array
    """Distance between each pixel and the end of registering it forward and back, in the same pixels, shape (h,
    w)."""


class Registrar(Protocol):
    """Registers pairs of frames; the result must not depend on earlier pairs."""

    def __call__(
        self,
        frame0: ReducedFrame,
        frame1: ReducedFrame,
        normalize: ExposureNormalizer,
        stated_log_ratio: float = np.nan,
    ) -> Registration | None:
        """Return the displacements between two frames, or None if they have too little overlap.

        The error of a lost pixel is large; that of pixels that do not show the scene, see ``frame0.shown``, does not
        matter. Displacements are in pixels of the small images, shape (h, w), that ``normalize`` returns for equal
        exposure. ``stated_log_ratio`` is ln of the exposure of the second over that of the first, NaN if unknown.
        """
        ...


class DenseRegistration:
    """Dense inverse search (Kroeger et al. 2016), in OpenCV's implementation, on images of equal brightness.

    Its smoothness term underestimates displacements that vary across the image, as when the camera moves forward or
    rotates. A coarse search therefore comes first, and the second image is warped by the homography that explains
    most of the scene; the remaining displacements are small and nearly constant. If a surround or a mask hides the
    corners, the motion may also be curved. If no motion explains a quarter of the scene, the search ends: of 524 such
    pairs, only one could have been registered. The backward search only detects forward errors of several pixels, so
    it is coarser. It runs in parallel in a second thread.

    On a plain object in front of the background, both searches find the displacement of the background. Points with
    very different displacements around them are therefore discarded, too.
    """

    def __init__(self, second: SecondThread) -> None:
        self._second = second
        self._first = optical_flow(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM, finest_scale=2)
        self._there, self._back = _refined(_short_search(finest_scale=1)), _short_search(finest_scale=2)

    def __call__(
        self,
        frame0: ReducedFrame,
        frame1: ReducedFrame,
        normalize: ExposureNormalizer,
        stated_log_ratio: float = np.nan,
    ) -> Registration | None:
        """Register two frames in both directions; see :class:`Registrar`."""
        image0, image1 = normalize(frame0, frame1, stated_log_ratio)
        motion = view_motion(self._first.calc(image0, image1, None), frame0.shown)
        if motion is None:
            return None
        size, warped = image0.shape[::-1], motion.warped(image1)
        returning = self._second.submit(self._back.calc, warped, image0, None)
        forward = self._there.calc(image0, warped, None)
        in_warped, error = there_and_back(forward, returning.result())
        error[_spread(forward) > MAX_DISPLACEMENT_SPREAD_PX] = OUTSIDE_PX
        there = motion.at(in_warped)
        # The warped image repeats the border of the second one beyond its edge: points there have left the view.
        error[cv2.inRange(there, (0, 0, 0, 0), (size[0] - 1, size[1] - 1, 0, 0)) == 0] = OUTSIDE_PX
        there -= pixel_places(size)
        return Registration(there, error)


REGISTRARS: dict[str, Callable[[SecondThread], Registrar]] = {"dense": DenseRegistration}
"""The available registrars, which may use a second thread, by their name in the settings."""


def _short_search(finest_scale: int) -> cv2.DISOpticalFlow:
    flow = optical_flow(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM, finest_scale)
    flow.setGradientDescentIterations(SECOND_SEARCH_STEPS)
    flow.setPatchStride(SECOND_SEARCH_STRIDE_PX)
    return flow


def _refined(flow: cv2.DISOpticalFlow) -> cv2.DISOpticalFlow:
    """Enable refinement of a search by gradient constancy, and return it."""
    # Brightness constancy, which is included by default, would shift flat regions towards equal brightness: grey
    # values sampled there would no longer show the difference to be measured.
    flow.setVariationalRefinementIterations(REFINEMENT_ITERATIONS)
    flow.setVariationalRefinementDelta(0.0)
    flow.setVariationalRefinementGamma(REFINEMENT_GRADIENT_WEIGHT)
    return flow


def _spread(displacement: Float32Array) -> Float32Array:
    """Return the standard deviation of the displacements around each pixel, (h, w, 2) -> (h, w)."""
    height, width = displacement.shape[:2]
    coarse = tuple(max(1, side // DISPLACEMENT_CELL_PX) for side in (width, height))
    sigma = DISPLACEMENT_SPREAD_SIGMA_PX / DISPLACEMENT_CELL_PX
    means = (cv2.resize(values, coarse, interpolation=cv2.INTER_AREA) for values in (displacement, displacement**2))
    mean, squared = (cv2.GaussianBlur(values, (0, 0), sigma) for values in means)
    variance = np.sum(squared - mean**2, axis=-1)
    return np.asarray(cv2.resize(np.sqrt(np.maximum(variance, 0)), (width, height)))


def displacement_at(registration: Registration, points: FloatArray, scale: float) -> tuple[FloatArray, FloatArray]:
    """Return displacement, (n, 2), and forward-backward error, (n,), at points (x, y) of the reduced image, (n, 2).

    Both are in reduced pixels; ``scale`` is the number of these, along each side, per pixel of the small image that
    was registered.
    """
    small = rescaled(points, 1 / scale)
    forward, error = (
        values_at(image, small) for image in (registration.forward, registration.forward_backward_error)
    )
    return forward.astype(np.float64) * scale, error.astype(np.float64) * scale


def jacobian_at(registration: Registration, points: FloatArray, scale: float) -> FloatArray:
    """Return the Jacobian of the mapping from the first to the second view, shape (n, 2, 2).

    The points of the first view, shape (n, 2), and the scale are as in :func:`displacement_at`.
    """
    height, width = registration.forward.shape[:2]
    cells = max(3, width // JACOBIAN_CELL_PX), max(3, height // JACOBIAN_CELL_PX)
    coarse = cv2.resize(registration.forward, cells, interpolation=cv2.INTER_AREA)
    by_y, by_x = np.gradient(coarse, height / cells[1], width / cells[0], axis=(0, 1), edge_order=2)
    there = rescaled(points, np.divide(cells, (width * scale, height * scale)))
    slopes = values_at(np.concatenate([by_x, by_y], axis=-1), there).astype(np.float64)
    return np.eye(2) + np.swapaxes(slopes.reshape(-1, 2, 2), 1, 2)
