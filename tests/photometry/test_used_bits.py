"""The bits that images use are those of all their pixels together."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ospc.photometry.used_bits import UsedBits

GREYS = st.sampled_from([0, 1, 8, 9, 16, 4095, 65535])


@given(st.lists(st.lists(GREYS, min_size=4, max_size=4), min_size=1, max_size=3))
def test_they_are_those_of_all_pixels_and_blank_images_have_one_value(greys: list[list[int]]) -> None:
    images = [np.array(values, np.uint16).reshape(2, 2) for values in greys]
    found = UsedBits.of(iter(images))
    assert found.in_any == np.bitwise_or.reduce(images, axis=None)
    assert found.blank == (len(np.unique(images)) == 1)
