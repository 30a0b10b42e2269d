"""Trajectories: rigid, smooth, seeded, and clear of the furniture."""

from __future__ import annotations

import numpy as np
import pytest

from ospc.simulation import SimulationSettings, truth
from ospc.simulation.motion import Motion

TIME_S = np.arange(0, 60, 0.05)


@pytest.mark.parametrize("kind", ["handheld", "static", "pan", "forward"])
@pytest.mark.parametrize("seed", range(4))
def test_poses_are_rigid_and_clear_of_the_furniture(kind, seed):
    positions, rotations = Motion.of(SimulationSettings(motion=kind, seed=seed)).at(TIME_S)
    products = rotations @ rotations.transpose(0, 2, 1)
    np.testing.assert_allclose(products, np.broadcast_to(np.eye(3), products.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(rotations), 1)
    x, y, z = positions.T
    assert np.all(np.hypot(x, y) < 1.11)
    assert np.all((z > 0.9) & (z < 1.8))


def test_the_camera_is_upright_on_average():
    _, rotations = Motion.of(SimulationSettings()).at(TIME_S)
    assert rotations[:, 2, 1].mean() < -0.9, "the image's y axis points down"


@pytest.mark.parametrize("kind", ["handheld", "pan", "forward"])
def test_motion_is_smooth(kind):
    positions, rotations = Motion.of(SimulationSettings(motion=kind)).at(TIME_S)
    turn = np.einsum("nij,nij->n", rotations[1:], rotations[:-1])
    angle_deg = np.degrees(np.arccos(np.clip((turn - 1) / 2, -1, 1)))
    assert angle_deg.max() < 5
    assert np.linalg.norm(np.diff(positions, axis=0), axis=-1).max() < 0.1


def test_speed_compresses_time():
    _, slow = Motion.of(SimulationSettings(speed=1)).at(TIME_S)
    _, fast = Motion.of(SimulationSettings(speed=2)).at(TIME_S / 2)
    np.testing.assert_allclose(slow, fast, atol=1e-9)


def test_kinds_do_what_they_are_called():
    still, _ = Motion.of(SimulationSettings(motion="static")).at(TIME_S)
    assert np.ptp(still, axis=0).max() == 0
    positions, rotations = Motion.of(SimulationSettings(motion="pan")).at(TIME_S)
    assert np.ptp(positions, axis=0).max() == 0
    assert np.ptp(rotations[:, 0, 2]) > 1
    positions, rotations = Motion.of(SimulationSettings(motion="forward")).at(TIME_S)
    step = np.diff(positions, axis=0)
    along = np.abs(np.sum(step * rotations[1:, :, 2], axis=-1))
    assert along.sum() > 0.8 * np.linalg.norm(step, axis=-1).sum()


def test_trajectory_rows_describe_the_same_rotation():
    from scipy.spatial.transform import Rotation

    settings = SimulationSettings(frames=50, exposure="constant")
    positions, rotations = Motion.of(settings).at(TIME_S[:50])
    rows = truth(settings).trajectory
    np.testing.assert_allclose(rows[:, :3], positions)
    np.testing.assert_allclose(Rotation.from_quat(rows[:, 3:]).as_matrix(), rotations, atol=1e-12)


def test_seeds_make_different_motions():
    one, other = (Motion.of(SimulationSettings(seed=seed)).at(TIME_S)[0] for seed in (0, 1))
    assert np.abs(one - other).max() > 0.1
