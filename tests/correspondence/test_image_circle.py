"""The radius of the usable part of images."""

from __future__ import annotations

import numpy as np
import pytest

from ospc import Frame
from ospc.correspondence.image_circle import ImageCircle
from workers import preprocessor

SIZE = (160, 120)


@pytest.mark.parametrize(
    ("used", "expected"),
    [
        (np.s_[:59, :], 1.0),
        (np.s_[:75, :], 1.0),
        (np.s_[:, 80:], 1.0),
        (np.s_[30:90, 40:120], 0.5),
        (np.s_[30:90, :], 0.86),
    ],
)
def test_a_mask_reaches_as_far_as_any_pixel_in_use(used: tuple[slice, slice], expected: float) -> None:
    mask = np.zeros(SIZE[::-1], bool)
    mask[used] = True
    circle = ImageCircle()
    image = np.random.default_rng(0).integers(50, 200, SIZE[::-1]).astype(np.uint8)
    frame = Frame.of_array(image, 1.0)
    circle.observe(preprocessor()(frame), mask)
    assert circle.usable_radius() == pytest.approx(expected, abs=0.03)
