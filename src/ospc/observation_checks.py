"""Checks of observations from another source."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ospc.arrays import FloatArray, IntArray
from ospc.errors import SettingError
from ospc.settings.sampling import POSITION_TOLERANCE

_NUMBERS = ("frame", "point", "group")
"""Fields of integers."""


def check_values(values: Mapping[str, npt.NDArray[Any]], shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Check the fields of observations by their names, and their shapes; SettingError if any is wrong."""
    for name, shape in shapes.items():
        given = np.asarray(values[name])
        if given.shape != shape:
            raise SettingError(f"{name} of {shape[0]} observations must have shape {shape}, not {given.shape}")
        if given.dtype.kind not in "fiu":
            raise SettingError(f"{name} must be an array of numbers, not of type {given.dtype}")
        if not np.all(np.isfinite(given)):
            raise SettingError(f"{name} must be finite; leave out points for which it is unknown")
        if name in _NUMBERS and given.dtype.kind not in "iu":
            raise SettingError(f"{name} must have an integer type, not {given.dtype}")
    grey = values["grey"]
    if np.any((grey < 0) | (grey > 1)):
        raise SettingError("grey levels must be in [0, 1]; divide grey values by the largest possible value")
    moments = (values["frame_moments"], values["surround_moments"])
    if any(np.any((mean < 0) | (mean > 1)) for mean in moments):
        raise SettingError("means of powers of the grey level must be in [0, 1]")
    if np.any(np.hypot(*values["position"].T) > 1 + POSITION_TOLERANCE):
        raise SettingError("a position is outside the image; positions are relative to its centre, in half diagonals")
    if any(np.any(values[name] < 0) for name in ("gradient", "grey_variance", "frame")):
        raise SettingError("gradients, variances and frame numbers must not be negative")


def whole_numbers(frame: FloatArray) -> IntArray:
    """Return frame numbers as integers; SettingError if one is not whole."""
    whole = np.isfinite(frame) & (frame == np.rint(frame))
    if not whole.all():
        raise SettingError(
            f"frame0 and frame1 must be whole numbers, not {frame[~whole][0]:g}: give the number of each frame, by "
            "which its exposure is found, not its time stamp"
        )
    return frame.astype(np.int64)
