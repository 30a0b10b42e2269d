"""The channel of colour images that is used as the grey image."""

from __future__ import annotations

from enum import Enum

import cv2
import numpy as np

from ospc.arrays import Image


class Channel(Enum):
    """A channel of colour images.

    Response and vignette may differ between the channels of a camera, and luma mixes the three.
    """

    LUMINANCE = "luminance"
    RED = "red"
    GREEN = "green"
    BLUE = "blue"

    def of(self, image: Image) -> Image:
        """Return the channel of an image of shape (height, width, 3) in the order blue, green, red."""
        if self is Channel.LUMINANCE:
            return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
        return np.ascontiguousarray(image[:, :, (Channel.BLUE, Channel.GREEN, Channel.RED).index(self)])
