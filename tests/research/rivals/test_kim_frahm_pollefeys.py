"""Joint tracking and radiometric calibration, tested with synthetic input from its own model."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from ospc.errors import NotObservableError
from ospc.evaluation.metrics import response_rmse
from ospc.recording.frame import Frame
from ospc.research.rivals.kim_frahm_pollefeys import KimFrahmPollefeys, track
from ospc.research.rivals.log_response import log_model

MODEL = log_model()
TRUTH = MODEL.response(np.array([0.4, -0.3, 0.2, 0.0, 0.1]), "of the model")
SHIFT = np.array([1.7, -1.2])
"""Displacement between consecutive frames in pixels."""


def frames(ratios: list[float]) -> list[Frame]:
    """Return views of a moving smooth texture at these exposures."""
    random = np.random.default_rng(3)
    texture = cv2.GaussianBlur(random.normal(size=(240, 320)), (0, 0), 3.0)
    light = np.exp(np.log(0.15) + 1.2 * texture / texture.std()).astype(np.float32)
    made = []
    for number, ratio in enumerate(ratios):
        matrix = np.float32([[1, 0, SHIFT[0] * number], [0, 1, SHIFT[1] * number]])
        moved = cv2.warpAffine(light, matrix, (320, 240), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        grey = np.rint(255 * TRUTH(np.clip(ratio * moved, 0, 1))).astype(np.uint8)
        made.append(Frame.of_array(grey, ratio, index=number))
    return made


def test_response_and_tracks_of_its_own_model_are_found():
    ratios = [1.0, 1.5, 0.9, 0.6, 1.1, 1.7]
    method = KimFrahmPollefeys(TRUTH)
    for frame in frames(ratios):
        method.push(frame)
    found = method.found()
    assert response_rmse(found["kim-frahm-pollefeys-with"].response, TRUTH) < 0.01
    assert set(found) == {"kim-frahm-pollefeys-with", "kim-frahm-pollefeys-without"}


def test_displacements_are_found_across_a_change_of_exposure():
    first, second = (frame.image for frame in frames([1.0, 1.8]))
    points = np.random.default_rng(0).uniform([40, 40], [280, 200], (60, 2))
    pair = track(first, second, points, np.log(np.maximum(TRUTH.resampled(256), 1e-4)))
    assert np.median(np.abs(pair.displacement - SHIFT)) < 0.05
    assert pair.log_ratio == pytest.approx(np.log(1.8), abs=0.02)


def test_blank_frames_are_refused():
    method = KimFrahmPollefeys(None)
    for number in range(3):
        method.push(Frame.of_array(np.full((60, 80), 90, np.uint8), 1.0, index=number))
    with pytest.raises(NotObservableError, match="features"):
        method.found()
