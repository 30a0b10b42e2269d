"""Which channel of colour images is used."""

from __future__ import annotations

from enum import Enum

import cv2
import numpy as np

from ospc.arrays import Image


class Channel(Enum):
    """A channel of colour images.

    Response and vignette may differ between the channels of a camera, and luma mixes the three. ``ALL`` keeps the
    images in colour: that is for correcting them, and cannot be calibrated.
    """

    LUMINANCE = "luminance"
    RED = "red"
    GREEN = "green"
    BLUE = "blue"
    ALL = "all"

    def of(self, image: Image) -> Image:
        """Return the channel of an image of shape (height, width, 3) in the order blue, green, red."""
        if self is Channel.ALL:
            return image
        if self is Channel.LUMINANCE:
            return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
        return np.ascontiguousarray(image[:, :, (Channel.BLUE, Channel.GREEN, Channel.RED).index(self)])
