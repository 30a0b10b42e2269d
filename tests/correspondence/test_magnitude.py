"""Lengths of vectors do not depend on the memory alignment of their arrays, so every run gives the same result."""

import numpy as np

from ospc.correspondence.thumbnail import gradient_magnitude, magnitude


def moved(image: np.ndarray, by: int) -> np.ndarray:
    """Return a copy of an image that starts ``by`` values later in memory."""
    copy = np.empty(image.size + by, image.dtype)[by:].reshape(image.shape)
    copy[:] = image
    return copy


def test_lengths_are_the_same_wherever_arrays_are() -> None:
    x, y = np.random.default_rng(0).normal(0, 0.01, (2, 61, 83)).astype(np.float32)
    np.testing.assert_allclose(magnitude(x, y), np.hypot(x, y), rtol=1e-6)
    for first in range(16):
        np.testing.assert_array_equal(magnitude(moved(x, first), moved(y, 3)), magnitude(x, y))
        np.testing.assert_array_equal(gradient_magnitude(moved(x, first)), gradient_magnitude(x))
