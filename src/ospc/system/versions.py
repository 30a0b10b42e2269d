"""Versions of the software that a result depends on."""

from __future__ import annotations

import platform

import cv2
import numpy as np
import scipy

import ospc


def versions() -> dict[str, str]:
    """Return the versions of the software that a result depends on, by name."""
    return {
        "ospc": ospc.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "opencv": cv2.__version__,
    }
