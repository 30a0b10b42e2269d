"""The shapes that light which does not come from the scene, or is scattered unevenly, has in the image."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ospc.arrays import FloatArray
from ospc.settings.effects import CENTRE_RADII


def _corner(x: FloatArray, y: FloatArray) -> FloatArray:
    """Rise steeply to 1 at the corner of a square image where x and y are positive; zero beyond the axes."""
    return np.asarray((2 * np.maximum(x, 0) * np.maximum(y, 0)) ** 2)


def _spot(x: FloatArray, y: FloatArray, radius: float) -> FloatArray:
    return np.asarray(np.exp(-(x**2 + y**2) / radius**2))


SHAPES: dict[str, Callable[[FloatArray, FloatArray], FloatArray]] = {
    "at the corners": lambda x, y: x**2 + y**2,
    "in the centre": lambda x, y: _spot(x, y, CENTRE_RADII[0]),
    "around the centre": lambda x, y: _spot(x, y, CENTRE_RADII[1]),
    "sideways": lambda x, _y: x,
    "vertically": lambda _x, y: y,
    "at the top left": lambda x, y: _corner(-x, -y),
    "at the top right": lambda x, y: _corner(x, -y),
    "at the bottom left": lambda x, y: _corner(-x, y),
    "at the bottom right": _corner,
}
"""Each as a function of the position in half diagonals, shapes (n,) and (n,) -> (n,)."""

STRAY_LIGHT = {f"stray light {where}": where for where in SHAPES}
"""Light that grows with the exposure but does not come from the scene, by name of the effect: leaks, reflections,
dark current. A part that is distributed like V cannot be distinguished from the scene."""

DARK_SIGNAL = {f"dark signal {where}": where for where in SHAPES}
"""A signal that is the same at all exposures: a black level that varies over the image. A part that is the same
everywhere belongs to the response."""

UNEVEN_GLARE = {f"glare {where}": where for where in ("at the corners", "in the centre", "around the centre")}
"""Light of the whole scene that is not scattered evenly, as in the hot spot of a lens."""
