"""A camera is stationary if hardly any pair of frames shows motion."""

from __future__ import annotations

import numpy as np
import pytest

from ospc.correspondence.static_series import StaticSeries
from ospc.methods.stationary_camera import StationaryCamera
from ospc.recording.frame import Frame
from ospc.settings import DefaultSettings


def camera_after(motions_px: list[float]) -> StationaryCamera:
    """Return what is known of a camera after displacements between frames."""
    camera = StationaryCamera(DefaultSettings().stationary_px, StaticSeries(points=100))
    random = np.random.default_rng(0)
    for number, motion_px in enumerate(motions_px):
        image = random.integers(20, 200, (48, 400)).astype(np.uint8)
        camera.observe(Frame.of_array(image, 10.0, index=number))
        camera.add_motion(motion_px)
    return camera


@pytest.mark.parametrize(
    ("motions_px", "stationary"),
    [
        ([0.1] * 100, True),
        ([0.1] * 95 + [15.0] * 5, True),  # a few wrong registrations
        ([0.1] * 150 + [30.0], True),
        ([0.1] * 150 + [30.0] * 2 + [0.1] * 50, False),  # a robot arm that mostly rests, or a bump
        ([0.1, 0.1, 0.1, 12.0] * 25, False),  # a pan-tilt unit that mostly rests
        ([0.1] * 50 + [9.0] * 20 + [0.1] * 300, False),  # it moved, and rests for the whole rest of the film
        ([5.0] * 100, False),
    ],
)
def test_a_camera_that_moved_clearly_is_not_stationary(motions_px: list[float], stationary: bool) -> None:
    camera = camera_after(motions_px)
    assert camera.is_stationary == stationary
    assert (camera.used_series is not None) == stationary
