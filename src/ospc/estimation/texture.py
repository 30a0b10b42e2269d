"""What the texture of a scene does to the mean of pixels where the response is bent.

A grey value of an observation is the mean of pixels. By Taylor's theorem it differs from the grey level of their mean
irradiance by −(g″/g′)/2 times their variance. With a power law the difference is alike for all exposures of a place.
With other responses it is not, and the fit would take it for a part of the response.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.estimation.response_basis import ResponseBasis
from ospc.observations import Observations
from ospc.photometry.noise import NoiseModel
from ospc.settings.estimation import DARKEST_GREY, MAX_NOISE, MAX_TEXTURE


@dataclass(frozen=True)
class TextureShift:
    """Tells by how much the texture lowers grey values, for one response.

    Attributes
    ----------
    grid
        Grey levels from 0 to 1, equidistant, shape (n,).
    bend
        g″/g′ at them, shape (n,).
    noise_variance
        Variance of the noise of single pixels at them, shape (n,).
    """

    grid: FloatArray
    bend: FloatArray
    noise_variance: FloatArray

    @classmethod
    def of(cls, basis: ResponseBasis, coefficients: FloatArray, noise: NoiseModel) -> TextureShift:
        """Return that of a response, by its coefficients and the noise of single pixels."""
        return cls(basis.grid, basis.bend_of(coefficients), noise.variance(basis.grid))

    def __call__(self, observations: Observations, index: IntArray) -> FloatArray:
        """Return the grey level of the mean irradiance less the mean grey level.

        Parameters
        ----------
        observations
            The n observations; where the variance of their pixels is unknown, zero is returned.
        index
            Index of their grey levels in the grid, shape (n,).
        """
        grey, noise = np.maximum(self.grid[index], DARKEST_GREY), self.noise_variance[index]
        texture = np.where(observations.grey_variance > 0, observations.grey_variance - noise, 0.0)
        most = (MAX_TEXTURE * grey) ** 2
        share = np.minimum(1, most / np.maximum(np.abs(texture), most)) / (1 + (noise / (MAX_NOISE * grey) ** 2) ** 2)
        # The same of all observations of a point: what is corrected in one only would look like another exposure.
        least = np.repeat(np.minimum.reduceat(share, observations.starts), observations.counts)
        return np.asarray(self.bend[index] / 2 * texture * least)
