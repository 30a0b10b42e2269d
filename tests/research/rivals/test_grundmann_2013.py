"""The time-varying mixture of responses, tested with synthetic tracks from its own model."""

from __future__ import annotations

import numpy as np
import pytest

from ospc.errors import NotObservableError
from ospc.evaluation.metrics import response_rmse
from ospc.recording.frame import Frame
from ospc.research.rivals.grundmann_2013 import Grundmann, mixture_responses
from ospc.research.rivals.log_response import ANCHOR, log_model
from ospc.unknown_exposures.tracking import TrackObservations

MODEL = log_model()
FRAMES, POINTS = 101, 150


def anchored(coefficients: list[float]) -> np.ndarray:
    """Return coefficients whose curve agrees with the mean curve at the anchor."""
    column = MODEL.components[:, ANCHOR]
    free = np.array(coefficients)
    return free - column * (column @ free) / (column @ column)


ENDS = anchored([0.3, -0.5, 0.2, 0.1, 0.0]), anchored([-0.2, 0.4, -0.3, 0.0, 0.2])
EXPOSURES = np.exp(0.5 * np.sin(np.arange(FRAMES) / 4))


def tracks(ends) -> TrackObservations:
    """Return tracks of points under a response that changes linearly from the first of ``ends`` to the second."""
    random = np.random.default_rng(2)
    radiance = np.exp(random.uniform(np.log(0.005), np.log(0.9), POINTS))
    grey = np.empty((FRAMES, POINTS))
    for number in range(FRAMES):
        share = number / (FRAMES - 1)
        log_g = MODEL.curve((1 - share) * ends[0] + share * ends[1])
        grey[number] = np.interp(np.log(radiance * EXPOSURES[number]), log_g, np.arange(256) / 255)
    frame, point = (index.ravel() for index in np.indices(grey.shape))
    seen = (grey.ravel() > 0.02) & (grey.ravel() < 0.99)
    ones = np.ones(seen.sum())
    return TrackObservations((64, 48), point[seen], frame[seen], grey.ravel()[seen], ones, ones, np.arange(FRAMES))


@pytest.mark.parametrize("ends", [(ENDS[0], ENDS[0]), ENDS])
def test_responses_and_exposures_of_its_own_model_are_found(ends):
    found, exposures = mixture_responses(tracks(ends), apart=FRAMES - 1)
    for coefficients, truth in zip(found, ends, strict=True):
        assert response_rmse(MODEL.response(coefficients, "x"), MODEL.response(truth, "y")) < 0.01
    log_error = np.log(list(exposures.values())) - np.log(EXPOSURES)
    assert np.std(log_error) < 0.03


def test_frames_without_points_are_refused():
    method = Grundmann(None)
    method.push(Frame.of_array(np.full((48, 64), 90, np.uint8), 1.0))
    with pytest.raises(NotObservableError, match="points"):
        method.found()
