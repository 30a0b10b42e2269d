"""Scene points, each with its grey level in two frames or more: what the estimators see."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from ospc.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Observations:
    """Scene points seen several times; the observations of a point follow one another.

    Attributes
    ----------
    grey
        Grey level in [0, 1], shape (n,).
    log_exposure
        ln of the frame's exposure in milliseconds, shape (n,).
    position
        Place relative to the image centre in half diagonals, shape (n, 2).
    gradient
        Grey gradient around the place, per pixel of the image it was sampled in, shape (n,).
    pixels_averaged
        Number of pixels behind the grey level, shape (n,).
    frame
        Index of the frame, shape (n,).
    point
        Number of the scene point, not decreasing, shape (n,).
    group
        Number of the pair of frames (or of the image region, for a static series) the point belongs to: errors within
        a group may have a common cause, shape (n,).
    """

    grey: FloatArray
    log_exposure: FloatArray
    position: FloatArray
    gradient: FloatArray
    pixels_averaged: FloatArray
    frame: IntArray
    point: IntArray
    group: IntArray

    def __len__(self) -> int:
        """Return the number of observations."""
        return len(self.grey)

    @cached_property
    def starts(self) -> IntArray:
        """Index of the first observation of each point, shape (points,)."""
        return np.flatnonzero(np.diff(self.point, prepend=-1))

    @cached_property
    def counts(self) -> IntArray:
        """Number of observations of each point, shape (points,)."""
        return np.diff(self.starts, append=len(self))

    def of_points(self, chosen: Any) -> Observations:
        """Return the observations of some points, by a mask, shape (points,), or indices into :attr:`starts`."""
        mask = np.zeros(len(self.starts), bool)
        mask[chosen] = True
        return self.where(np.repeat(mask, self.counts))

    def where(self, mask: Any) -> Observations:
        """Return the observations where a mask, shape (n,), is true."""
        return Observations(*(getattr(self, f.name)[mask] for f in fields(self)))


def concatenate(parts: list[Observations]) -> Observations:
    """Join observations of different scene points, which are numbered anew."""
    offset, points = 0, []
    for part in parts:
        _, number = np.unique(part.point, return_inverse=True)
        points.append(number + offset)
        offset += int(number[-1]) + 1 if len(number) else 0
    joined = {
        f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Observations) if f.name != "point"
    }
    return Observations(**joined, point=np.concatenate(points))
