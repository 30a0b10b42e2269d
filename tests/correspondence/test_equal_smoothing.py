"""Smoothing over the same part of the scene in both views."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ospc.correspondence.equal_smoothing import (
    CENTRE,
    NODES,
    further_smoothing,
    interpolation_smoothing,
    node_sums,
    node_weights,
)
from ospc.photometry.geometry import pixel_grid

SIGMA_PX = 1.5
EFFECTIVE_VARIANCE = SIGMA_PX**2 + 1 / 12

stretches = st.floats(0.7, 1.4)
angles = st.floats(0, np.pi)


def turn(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@given(stretches, stretches, angles, angles)
def test_both_views_are_smoothed_over_the_same_part_of_the_scene(along, across, before, after):
    jacobian = turn(after) @ np.diag([along, across]) @ turn(before)
    further0, further1 = (further[0] for further in further_smoothing(jacobian[None], SIGMA_PX, np.zeros((1, 2, 2))))
    usual = EFFECTIVE_VARIANCE * np.eye(2)
    np.testing.assert_allclose(jacobian @ (usual + further0) @ jacobian.T, usual + further1, atol=1e-9)
    # The smoothing is minimal: along each axis, one of the two views is smoothed as before.
    assert np.linalg.eigvalsh(further0).min() > -1e-9
    assert np.linalg.eigvalsh(further1).min() > -1e-9
    assert np.trace(jacobian @ further0 @ jacobian.T @ further1) == pytest.approx(0, abs=1e-9)


@given(stretches, stretches, angles, angles, st.floats(0, 1), st.floats(0, 1))
def test_the_first_view_is_smoothed_as_interpolation_smooths_the_second(along, across, before, after, x, y):
    jacobian = turn(after) @ np.diag([along, across]) @ turn(before)
    interpolation = interpolation_smoothing(np.array([[x, y]]))
    further0, further1 = (further[0] for further in further_smoothing(jacobian[None], SIGMA_PX, interpolation))
    usual = EFFECTIVE_VARIANCE * np.eye(2)
    expected = usual + further1 + interpolation[0]
    np.testing.assert_allclose(jacobian @ (usual + further0) @ jacobian.T, expected, atol=1e-9)
    assert min(np.linalg.eigvalsh(further).min() for further in (further0, further1)) > -1e-9


def test_an_edge_in_depth_is_not_taken_for_a_stretch():
    jacobians = np.array([np.diag([30.0, 1e-3]), np.zeros((2, 2))])
    for further in further_smoothing(jacobians, SIGMA_PX, np.zeros((2, 2, 2))):
        assert np.all(np.abs(further) < 2 * EFFECTIVE_VARIANCE)


@given(st.lists(st.floats(-1, 1), min_size=6, max_size=6), st.lists(st.floats(-1, 1), min_size=3, max_size=3))
def test_what_is_quadratic_in_the_place_is_smoothed_exactly(terms, root):
    lower = np.array([[root[0], 0], [root[1], root[2]]])
    covariance = lower @ lower.T
    x, y = NODES.T
    values = np.stack([np.ones(len(NODES)), x, y, x**2, x * y, y**2]).T @ terms
    expected = terms[0] + terms[3] * covariance[0, 0] + terms[4] * covariance[0, 1] + terms[5] * covariance[1, 1]
    assert node_weights(covariance[None])[0] @ node_sums(values) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("stretch", "difference"), [(1.1, 0.01), (1.25, 0.05), (1.5, 0.2)])
def test_smoothing_further_is_what_a_wider_gaussian_gives(stretch, difference):
    noise = np.random.default_rng(3).normal(size=(200, 200))
    image = cv2.GaussianBlur(noise, (0, 0), SIGMA_PX)
    variance = SIGMA_PX**2 * (stretch**2 - 1)
    wider = cv2.GaussianBlur(image, (0, 0), variance**0.5)[20:180:7, 20:180:7].ravel()
    nodes = pixel_grid((200, 200))[20:180:7, 20:180:7].reshape(-1, 1, 2) + NODES
    values = image[nodes[..., 1].astype(int), nodes[..., 0].astype(int)]
    found = node_sums(values) @ node_weights(variance * np.eye(2)[None])[0]
    # White noise has more fine structure than any scene.
    assert np.std(found - wider) < difference * np.std(node_sums(values)[:, CENTRE] - wider)


def test_linear_interpolation_smooths_by_the_stated_covariance():
    """The weights are those of two neighbours along each axis, and their spread is the covariance."""
    places = np.random.default_rng(4).uniform(0, 50, (20, 2))
    for place, covariance in zip(places, interpolation_smoothing(places), strict=True):
        share = place % 1
        spread = (1 - share) * share**2 + share * (1 - share) ** 2
        np.testing.assert_allclose(covariance, np.diag(spread), atol=1e-12)
