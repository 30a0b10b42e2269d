"""Vignettes of single images, tested with synthetic input from the methods' own models."""

from __future__ import annotations

import numpy as np
import pytest

from ospc.errors import NotObservableError
from ospc.evaluation.metrics import vignette_rmse
from ospc.photometry.geometry import normalised, pixel_grid
from ospc.photometry.vignette import PolynomialVignette
from ospc.unknown_exposures.single_image import zheng_2008
from ospc.unknown_exposures.single_image.zheng_2008 import radial_gradient_vignette

SIZE = (400, 300)
OFFSET = normalised(pixel_grid(SIZE), SIZE)


@pytest.mark.parametrize("coefficients", [(-0.35, 0.05, -0.15), (-0.12, 0.0, -0.03), (0.0, 0.0, 0.0)])
def test_the_vignette_remains_where_radiance_does_not_change_along_the_radius(coefficients):
    vignette = PolynomialVignette(SIZE, coefficients)
    scene = 0.4 + 0.2 * np.sin(3 * np.arctan2(OFFSET[..., 1], OFFSET[..., 0]))
    # The published smoothness weight flattens ln V where it is curved.
    assert vignette_rmse(radial_gradient_vignette([scene * vignette.image()]), vignette) < 0.025


@pytest.mark.parametrize("coefficients", [(-0.35, 0.05, -0.15), (-0.12, 0.0, -0.03)])
def test_the_vignette_of_an_even_scene_is_found_without_smoothing(coefficients, monkeypatch):
    monkeypatch.setattr(zheng_2008, "RING_SMOOTHNESS", 0.001)
    vignette = PolynomialVignette(SIZE, coefficients)
    assert vignette_rmse(radial_gradient_vignette([vignette.image()]), vignette) < 0.002


def test_symmetric_gradients_do_not_matter():
    vignette = PolynomialVignette(SIZE, (-0.35, 0.05, -0.15))
    # Where radiance increases along the radius on one side, it decreases on the opposite side.
    scene = np.exp(0.2 * np.sin(20 * OFFSET[..., 0]))
    assert vignette_rmse(radial_gradient_vignette([scene * vignette.image()]), vignette) < 0.025


def test_images_that_show_nothing_are_refused():
    dark = np.zeros((SIZE[1], SIZE[0]))
    with pytest.raises(NotObservableError, match="radii"):
        radial_gradient_vignette([dark], [dark > 0])
