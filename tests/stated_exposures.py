"""Exposures by frame number, as they are stated."""

from __future__ import annotations

import numpy as np


class StatedExposures:
    """The exposures that a test states."""

    def __init__(self):
        self._log_exposure = {}

    def add(self, number, exposure_ms):
        """Remember the exposure of a frame in milliseconds."""
        self._log_exposure[number] = np.log(exposure_ms)

    def log_exposure_of(self, frames):
        """Return ln of the exposures in milliseconds, shape (n,)."""
        return np.array([self._log_exposure[number] for number in np.asarray(frames).tolist()])
