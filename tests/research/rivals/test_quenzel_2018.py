"""Splines from keyframes, tested with synthetic points from their own model."""

from __future__ import annotations

import numpy as np
import pytest

from ospc.errors import NotObservableError
from ospc.evaluation.metrics import response_rmse, vignette_rmse
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette
from ospc.recording.frame import Frame
from ospc.research.rivals.quenzel_2018 import KeyFramePoints, Quenzel, estimate_splines

SIZE = (160, 120)
VIGNETTE = PolynomialVignette(SIZE, (-0.35, 0.05, -0.15))
EXPOSURES = np.array([1.0, 1.6, 0.7, 1.2, 0.5, 2.0])


def points(response: Response) -> KeyFramePoints:
    """Return points at random positions in keyframes of several exposures."""
    random = np.random.default_rng(1)
    radiance = np.exp(random.uniform(np.log(0.01), np.log(0.9), 250))
    frame, point = (index.ravel() for index in np.indices((len(EXPOSURES), radiance.size)))
    position = random.uniform((-0.8, -0.6), (0.8, 0.6), (frame.size, 2))
    light = EXPOSURES[frame] * VIGNETTE.profile(np.linalg.norm(position, axis=1)) * radiance[point]
    return KeyFramePoints(SIZE, point, frame, response(light), position)


@pytest.mark.parametrize("bend", [0.0, 0.4])
def test_response_vignette_and_exposures_of_its_own_model_are_found(bend):
    levels = np.linspace(0, 1, 1024)
    response = Response.from_values(levels**1.8 + bend * levels * (levels - 0.5) * (levels - 1))
    found = estimate_splines(points(response), 1.8, bending=0.05)
    assert response_rmse(found.response, response) < 0.01
    assert vignette_rmse(found.vignette, VIGNETTE) < 0.01
    np.testing.assert_allclose(np.log(list(found.exposures.values())), np.log(EXPOSURES), atol=0.01)


def test_another_gamma_is_an_exponent_of_everything():
    response = Response.gamma(1.8)
    found = estimate_splines(points(response), 2.4)
    slope = np.polyfit(np.log(EXPOSURES), np.log(list(found.exposures.values())), 1)[0]
    assert slope == pytest.approx(2.4 / 1.8, abs=0.02)


def test_frames_without_points_are_refused():
    method = Quenzel(None)
    with pytest.raises(NotObservableError, match="points"):
        method.found()
    method.push(Frame.of_array(np.full((48, 64), 90, np.uint8), 1.0))
    with pytest.raises(NotObservableError, match="points"):
        method.found()
