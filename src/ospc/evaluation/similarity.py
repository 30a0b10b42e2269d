"""Alignment of two sets of points by a similarity, which a single camera leaves undetermined."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import NotObservableError

_FEWEST_POSES = 3
"""Poses that determine a similarity."""

_DEGENERATE = 1e-9
"""Ratio of singular values below which points lie on a line, up to rounding."""


@dataclass(frozen=True)
class Similarity:
    """x ↦ s·R·x + t, with s positive, R of shape (3, 3) and t of shape (3,)."""

    scale: float
    rotation: FloatArray
    translation: FloatArray

    def __call__(self, points: FloatArray) -> FloatArray:
        """Return the transformed points, shape (n, 3) -> (n, 3)."""
        return np.asarray(self.scale * points @ self.rotation.T + self.translation)


def align_similarity(points: FloatArray, target: FloatArray) -> Similarity:
    """Return the similarity from points to their targets with the least sum of squares (Umeyama 1991).

    Parameters
    ----------
    points, target
        Shape (n, 3) each, n ≥ 3.

    Raises
    ------
    NotObservableError
        If there are fewer than three points, or they lie on a line and do not determine the rotation.
    """
    if points.shape[0] < _FEWEST_POSES:
        raise NotObservableError(f"an alignment needs {_FEWEST_POSES} poses with truth; there are {points.shape[0]}")
    centre, target_centre = points.mean(axis=0), target.mean(axis=0)
    centred = points - centre
    left, singular, right = np.linalg.svd((target - target_centre).T @ centred)
    if singular[1] <= _DEGENERATE * singular[0] or not np.isfinite(singular).all():
        raise NotObservableError("the poses lie on a line or in one point, which determines no alignment")
    mirror = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation = np.asarray((left * mirror) @ right)
    scale = float(singular @ mirror / np.sum(centred**2))
    return Similarity(scale, rotation, np.asarray(target_centre - scale * rotation @ centre))
