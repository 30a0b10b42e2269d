"""Rank minimisation and edge colours, tested with synthetic input from their own model."""

from __future__ import annotations

import numpy as np
import pytest

from ospc.errors import NotObservableError
from ospc.evaluation.metrics import response_rmse
from ospc.photometry.response import Response
from ospc.recording.frame import Frame
from ospc.research.rivals.log_response import log_model
from ospc.research.rivals.mo_2019 import Mo, exponent_of_edges, powered, rank_one_response
from ospc.simulation.responses import srgb
from ospc.unknown_exposures.single_image.edges import EdgePatches
from polygon_pictures import picture

MODEL = log_model()


def test_a_matrix_of_rank_one_gives_the_response_up_to_its_exponent():
    truth = MODEL.response(np.array([0.4, -0.3, 0.2, 0.0, 0.1]), "of the model")
    random = np.random.default_rng(0)
    exposures = np.array([1.0, 1.4, 0.7, 2.0, 0.5, 1.1])
    radiance = np.exp(random.uniform(np.log(0.01), np.log(0.49), 120))
    found = rank_one_response(truth(exposures[:, None] * radiance))
    gamma = np.log(truth.inverse(0.5)) / np.log(found.inverse(0.5))
    assert response_rmse(powered(found, gamma), truth) < 0.01


def test_edge_colours_give_the_exponent():
    patches = EdgePatches.of([picture(srgb())])
    wrong = Response.from_values(srgb().resampled(256) ** 1.4)
    assert exponent_of_edges(wrong, patches) == pytest.approx(1 / 1.4, abs=0.05)


def test_images_without_points_or_colours_are_refused():
    method = Mo(srgb())
    with pytest.raises(NotObservableError, match="points"):
        method.found()
    image = picture(srgb())[..., 1]
    for number in range(24):
        share = 1 + 0.5 * np.sin(number / 3)
        grey = np.rint(255 * srgb()(0.6 * share * srgb().inverse(image / 255))).astype(np.uint8)
        method.push(Frame.of_array(grey, share, index=number))
    found = method.found()
    assert "grey" in found["mo-without"]
    assert response_rmse(found["mo-with"].response, srgb()) < 0.03
