"""Responses from edges, tested with synthetic input from the methods' own models."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from ospc.errors import NotObservableError
from ospc.evaluation.metrics import response_rmse
from ospc.photometry.response import Response
from ospc.settings.single_image import PRIOR_LEVELS
from ospc.simulation.responses import srgb
from ospc.unknown_exposures.single_image.edges import (
    EdgePatches,
    edge_colour_distance,
    edge_colour_response,
)
from ospc.unknown_exposures.single_image.response_prior import response_prior
from polygon_pictures import picture

WINDOWS, PIXELS = 20, 40


def patches(response: Response, channels: int) -> EdgePatches:
    """Return windows whose edge pixels mix the two regions in evenly spaced proportions."""
    random = np.random.default_rng(1)
    first, second = np.exp(random.uniform(np.log(0.01), 0, (2, WINDOWS, channels)))
    share = np.tile((np.arange(PIXELS) + 0.5) / PIXELS, WINDOWS)[:, None]
    window = np.repeat(np.arange(WINDOWS), PIXELS)
    edge = share * first[window] + (1 - share) * second[window]
    return EdgePatches(255 * response(first), 255 * response(second), 255 * response(edge), window)


PRIOR = response_prior()


def test_edge_colours_by_their_own_model_give_the_response():
    response = PRIOR.response(np.array([-0.5, 0.3, 0.1, -0.2, 0.1]), "of the model")
    own = patches(response, 3)
    assert edge_colour_distance(own, response.inverse_table) < 1e-3
    found = PRIOR.most_likely(partial(edge_colour_distance, own), 1e-6, "edge-colours")
    assert response_rmse(found, response) < 0.002


def test_edges_are_found_in_a_photograph_and_give_its_response():
    found = EdgePatches.of([picture(srgb())])
    assert len(found.first) > 20
    assert response_rmse(edge_colour_response(found), srgb()) < 0.03


def test_the_prior_prefers_usual_curves():
    assert PRIOR.curve(np.zeros(5)).shape == (PRIOR_LEVELS,)
    assert PRIOR.cost(np.full(5, 0.3)) < PRIOR.cost(np.full(5, 6.0))


def test_what_has_no_edges_or_colours_is_refused():
    with pytest.raises(NotObservableError, match="edges"):
        EdgePatches.of([np.full((60, 80), 100, np.uint8)])
    with pytest.raises(NotObservableError, match="grey"):
        edge_colour_response(patches(srgb(), 1))
