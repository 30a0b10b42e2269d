"""Single black or white pixels do not affect the grey levels; noise is left unchanged."""

import math

import cv2
import numpy as np
import pytest

from ospc import Frame
from ospc.arrays import FloatArray, Image
from ospc.correspondence.preprocessing import PreprocessedFrame
from ospc.settings import preset

HEIGHT, WIDTH = 120, 160
SHADES = np.broadcast_to(np.linspace(0.2, 0.8, WIDTH), (HEIGHT, WIDTH))


def prepared(grey: FloatArray, max_grey: int) -> PreprocessedFrame:
    image: Image = np.rint(np.clip(grey, 0, 1) * max_grey).astype(np.uint8 if max_grey == 255 else np.uint16)
    return preset("default").preprocessor()(Frame.of_array(image, 10.0, index=0, max_grey=max_grey))


@pytest.mark.parametrize("max_grey", [255, 4095])
@pytest.mark.parametrize("share", [0.01, 0.05])
def test_defective_pixels_do_not_count(max_grey: int, share: float) -> None:
    random = np.random.default_rng(1)
    noisy = SHADES + 0.02 * random.standard_normal(SHADES.shape)
    defective = np.where(random.random(SHADES.shape) < share, random.integers(0, 2, SHADES.shape), noisy)
    clean, mended = (prepared(grey, max_grey) for grey in (noisy, defective))
    assert np.abs(mended.grey - clean.grey).mean() < 0.003
    assert np.abs(mended.squares - clean.squares).mean() < 0.003


@pytest.mark.parametrize("sigma", [0.02, 0.05, 0.1])
def test_noise_is_left_alone(sigma: float) -> None:
    """Replacing noisy pixels by medians would change their mean and variance, and both are used."""
    random = np.random.default_rng(2)
    noise = sigma * random.standard_normal(SHADES.shape)
    found = prepared(0.5 + noise, 4095)
    assert found.grey.mean() == pytest.approx(0.5, abs=0.001)
    assert found.squares.mean() == pytest.approx(0.25 + sigma**2, rel=0.005)


@pytest.mark.parametrize("angle_deg", [0, 20, 45])
def test_fine_lines_are_left_alone(angle_deg: float) -> None:
    """Replacing them, which happens in the brighter of two frames, would look like another exposure."""
    wall = np.full((3 * HEIGHT, 3 * WIDTH), 90, np.uint8)
    rise = math.tan(math.radians(angle_deg)) * wall.shape[1]
    for y in range(-len(wall), len(wall), 12):
        cv2.line(wall, (0, y), (wall.shape[1], round(y + rise)), 200, 1, cv2.LINE_AA)
    wall = wall[HEIGHT:-HEIGHT, WIDTH:-WIDTH]
    expected = cv2.GaussianBlur(wall.astype(np.float32) / 255, (0, 0), preset("default").smoothing_px)
    np.testing.assert_allclose(prepared(wall / 255, 255).grey, expected, atol=1e-4)
