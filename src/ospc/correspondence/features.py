"""Feature points of an image, and their matches in another image.

To add another kind of feature, write a class like those below and add it to :data:`EXTRACTORS`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from ospc.arrays import FloatArray, IntArray
from ospc.errors import needs_extra
from ospc.recording.frame import Frame


@dataclass(frozen=True)
class Features:
    """Feature points of a frame, without its image."""

    frame: int
    points: FloatArray
    """Pixel coordinates (x, y), shape (n, 2)."""
    grey: FloatArray
    """Grey levels in [0, 1] at the nearest pixels, shape (n,)."""
    descriptors: npt.NDArray[Any]
    """One row per point, shape (n, d); uint8, or float32 for SURF."""


class FeatureExtractor(Protocol):
    """Detects and describes feature points."""

    @property
    def norm(self) -> int:
        """OpenCV's norm for comparing the descriptors."""
        ...

    def detect(self, image: npt.NDArray[np.uint8]) -> tuple[FloatArray, npt.NDArray[Any]]:
        """Return points, shape (n, 2), and descriptors, shape (n, d)."""
        ...


class OpenCvExtractor:
    """A feature detector of OpenCV."""

    norm: int
    _create: Any

    def __init__(self, max_features: int) -> None:
        self._detector = self._create(nfeatures=max_features)

    def detect(self, image: npt.NDArray[np.uint8]) -> tuple[FloatArray, npt.NDArray[Any]]:
        """Return points, shape (n, 2), and descriptors, shape (n, d), as uint8; SIFT's values are integers."""
        keypoints, descriptors = self._detector.detectAndCompute(image, None)
        if descriptors is None:
            return np.empty((0, 2)), np.empty((0, self._detector.descriptorSize()), np.uint8)
        return cv2.KeyPoint_convert(keypoints).astype(np.float64).reshape(-1, 2), descriptors.astype(np.uint8)


class SiftExtractor(OpenCvExtractor):
    """Scale-invariant features (Lowe 2004); keeps the ``max_features`` strongest."""

    norm, _create = cv2.NORM_L2, staticmethod(cv2.SIFT_create)


class OrbExtractor(OpenCvExtractor):
    """Oriented FAST and rotated BRIEF (Rublee et al. 2011); keeps the ``max_features`` strongest."""

    norm, _create = cv2.NORM_HAMMING, staticmethod(cv2.ORB_create)


class SurfExtractor:
    """Speeded-up robust features (Bay et al. 2006) from the package mahotas; keeps the ``max_features`` strongest.

    Raises
    ------
    MissingExtraError
        If mahotas is not installed.
    """

    norm = cv2.NORM_L2

    def __init__(self, max_features: int) -> None:
        with needs_extra("SURF", "surf"):
            from mahotas.features import surf
        self._surf, self._max_features = surf.surf, max_features

    def detect(self, image: npt.NDArray[np.uint8]) -> tuple[FloatArray, npt.NDArray[Any]]:
        """Return points, shape (n, 2), and descriptors, shape (n, 64)."""
        # Rows contain y, x, scale, score, sign of the Laplacian, angle, and the 64 values of the descriptor.
        rows = np.asarray(self._surf(image, max_points=self._max_features, descriptor_only=False), dtype=np.float64)
        if rows.size == 0:
            return np.empty((0, 2)), np.empty((0, 64), np.float32)
        return rows[:, 1::-1].copy(), rows[:, 6:].astype(np.float32)


EXTRACTORS: dict[str, Callable[[int], FeatureExtractor]] = {
    "sift": SiftExtractor,
    "orb": OrbExtractor,
    "surf": SurfExtractor,
}
"""The available extractors, by their name in the settings."""


def extract(frame: Frame, extractor: FeatureExtractor) -> Features:
    """Return the features of a frame, with the grey levels of the pixels nearest to them."""
    points, descriptors = extractor.detect(frame.image_8_bit)
    height, width = frame.image.shape
    column, row = np.clip(np.rint(points).astype(np.int64), 0, (width - 1, height - 1)).T
    if frame.mask is not None:
        usable = frame.mask[row, column]
        points, descriptors, row, column = points[usable], descriptors[usable], row[usable], column[usable]
    grey = frame.image[row, column] / frame.max_grey
    return Features(frame.index, points, grey.astype(np.float64), descriptors)


def match(features0: Features, features1: Features, norm: int, ratio: float) -> tuple[IntArray, IntArray]:
    """Return the indices of matching features, shape (n,) each: nearest neighbours that pass Lowe's ratio test.

    Each feature of the second frame is used at most once. ``norm`` is OpenCV's norm for the descriptors, ``ratio``
    the largest accepted ratio of the nearest to the second nearest distance.
    """
    none = np.empty(0, np.int64)
    if len(features0.points) < 2 or len(features1.points) < 2:
        return none, none
    descriptors = [f.descriptors for f in (features0, features1)]
    if norm != cv2.NORM_HAMMING:
        descriptors = [d.astype(np.float32) for d in descriptors]
    found = cv2.BFMatcher(norm).knnMatch(descriptors[0], descriptors[1], k=2)
    accepted = [(m.distance, m.queryIdx, m.trainIdx) for m, n in found if m.distance < ratio * n.distance]
    if not accepted:
        return none, none
    # If several features have the same match, only the nearest keeps it.
    table = np.array(sorted(accepted))
    _, first = np.unique(table[:, 2], return_index=True)
    kept = table[np.sort(first)].astype(np.int64)
    return kept[:, 1], kept[:, 2]
