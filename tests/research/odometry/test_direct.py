"""The built-in odometry: the geometry is exact, motion is recovered, and calibration improves the result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ospc.errors import RecordingError
from ospc.evaluation.trajectory import alignment_error, read_trajectory
from ospc.research.odometry.alignment import LEVELS, Brightness, Camera, align, moved, pose_of
from ospc.research.odometry.direct import DirectOdometry, SceneDepth

seeds = st.integers(0, 2**32 - 1)


def pose(random: np.random.Generator) -> np.ndarray:
    return pose_of(Rotation.from_rotvec(random.normal(size=3)).as_matrix(), random.normal(size=3))


@given(seeds)
def test_the_product_of_poses_applies_both(seed):
    random = np.random.default_rng(seed)
    a, b, points = pose(random), pose(random), random.normal(size=(5, 3))
    np.testing.assert_allclose(moved(a @ b, points), moved(a, moved(b, points)), atol=1e-9)


def test_lifting_undoes_projecting():
    camera = Camera(100.0, np.array([79.5, 59.5]))
    pixels = np.random.default_rng(0).uniform(0, 120, (50, 2))
    depth = np.random.default_rng(1).uniform(0.5, 5, 50)
    np.testing.assert_allclose(camera.project(camera.lift(pixels, depth)), pixels)
    assert (camera.project(np.array([[0.1, 0.1, -1.0]])) < 0).all()


@settings(max_examples=8)
@given(seeds)
def test_a_small_motion_before_a_textured_plane_is_recovered(seed):
    random = np.random.default_rng(seed)
    waves = random.uniform(-0.25, 0.25, (6, 2))
    phases = random.uniform(0, 6, 6)

    def texture(x, y):
        return 0.5 + 0.08 * sum(np.sin(w[0] * x + w[1] * y + p) for w, p in zip(waves, phases, strict=True))

    camera = Camera(120.0, np.array([79.5, 59.5]))
    truth = pose_of(Rotation.from_rotvec(0.01 * random.normal(size=3)).as_matrix(), 0.02 * random.normal(size=3))
    x, y = np.meshgrid(np.arange(160.0), np.arange(120.0))
    first = texture(x, y).astype(np.float32)
    # each pixel of the second image views the plane z = 2 of the first camera along its own ray
    back = np.linalg.inv(truth)
    rays = np.stack([(x - 79.5) / 120, (y - 59.5) / 120, np.ones_like(x)], axis=-1) @ back[:3, :3].T
    scale = (2 - back[2, 3]) / rays[..., 2]
    seen = back[:3, 3] + scale[..., None] * rays
    second = texture(*(camera.project(seen.reshape(-1, 3)).T)).reshape(x.shape).astype(np.float32)
    points = random.uniform(10, 110, (400, 2)) * [1.3, 1]
    lifted = camera.lift(points, np.full(400, 2.0))
    pyramid = Brightness.of(first)
    reference = np.array([pyramid.at(level, points)[:, 0] for level in range(LEVELS)])
    brighter = Brightness.of(1.2 * second + np.float32(0.05))
    for image, affine in ((Brightness.of(second), False), (brighter, True)):
        found = align(lifted, reference, image, camera, np.eye(4), affine=affine)
        np.testing.assert_allclose(found.motion, truth, atol=2e-3)
        assert found.agreeing > 0.8


def test_depth_is_that_of_the_rendered_scene(simulated):
    depth = SceneDepth.of(simulated)
    truth = read_trajectory(simulated / "groundtruthSync.txt")
    camera = depth.camera
    points = np.random.default_rng(0).uniform([5, 5], [154, 114], (400, 2))
    view = pose_of(Rotation.from_quat(truth.quaternions[0]).as_matrix(), truth.positions[0])
    found = depth.at(points, view)
    assert np.isfinite(found).all()
    assert found.min() > 0.3
    world = moved(view, camera.lift(points, found))
    # all points lie within the room
    assert (np.abs(world) < [4.3, 3.5, 2.9]).all()
    # projected back into the same view, the points have the same depth and are not occluded
    again = depth.at(camera.project(moved(np.linalg.inv(view), world)), view)
    np.testing.assert_allclose(again, found)


def test_with_the_true_calibration_it_drifts_little_and_runs_differ_and_repeat(source, simulated):
    truth = read_trajectory(simulated / "groundtruthSync.txt")
    runs = (("truth", 0), ("truth", 0), ("truth", 1), ("none", 0))
    first, again, other, without = (DirectOdometry().track(source(name), run) for name, run in runs)
    for tracked in (first, without):
        assert tracked.failure == ""
        assert len(tracked.trajectory) == 40
    drift, uncalibrated = (alignment_error(tracked.trajectory, truth).e_align for tracked in (first, without))
    assert drift < 0.03
    assert drift < 0.5 * uncalibrated
    np.testing.assert_array_equal(first.trajectory.positions, again.trajectory.positions)
    assert not np.array_equal(first.trajectory.positions, other.trajectory.positions)


def test_it_says_what_it_needs(tmp_path):
    with pytest.raises(RecordingError, match="simulated") as raised:
        SceneDepth.of(tmp_path)
    assert "FormatError" not in str(raised.value)
    (tmp_path / "truth.json").write_text('{"settings": {"seed": 1}}')
    with pytest.raises(RecordingError, match="--program"):
        SceneDepth.of(tmp_path)


def test_a_truth_with_gaps_is_a_failed_run(source, simulated, tmp_path):
    place = tmp_path / "copy"
    place.mkdir()
    for name in ("camera.txt", "times.txt", "truth.json", "images"):
        (place / name).symlink_to(simulated / name)
    rows = (simulated / "groundtruthSync.txt").read_text().splitlines()
    (place / "groundtruthSync.txt").write_text("\n".join(rows[:20]) + "\n")
    tracked = DirectOdometry().track(replace(source("none"), place=place), 0)
    assert tracked.trajectory is None
    assert "40 frames" in tracked.failure
