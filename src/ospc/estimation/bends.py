"""Bends of piecewise linear functions, which show how large an unresolved jump between two knots may be."""

from __future__ import annotations

import numpy as np

from ospc.arrays import FloatArray


def sharpest_bend(coefficients: FloatArray, knots: FloatArray, places: FloatArray) -> FloatArray:
    """Return the largest bend at the surrounding knots, interpolated at places, shape (n,).

    A bend is a change of the derivative, times the distance between the knots.
    """
    if len(knots) < 3:
        return np.zeros_like(places)
    width = np.diff(knots)
    bend = np.pad(np.abs(np.diff(np.diff(coefficients) / width)) * (width[1:] + width[:-1]) / 2, 2)
    return np.asarray(np.interp(places, knots, np.maximum.reduce([bend[:-2], bend[1:-1], bend[2:]])))
