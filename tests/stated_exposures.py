"""Exposures by frame number."""

from __future__ import annotations

import numpy as np


class StatedExposures:
    """The exposures that a test specifies."""

    def __init__(self):
        self._log_exposure = {}

    def add(self, number, exposure_ms):
        """Store the exposure of a frame in milliseconds."""
        self._log_exposure[number] = np.log(exposure_ms)

    def log_exposure_of(self, frames):
        """Return the natural logarithms of the exposures in milliseconds, shape (n,)."""
        return np.array([self._log_exposure[number] for number in np.asarray(frames).tolist()])
