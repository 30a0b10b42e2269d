"""The motion of most of the view, to which only what shows the scene contributes."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from ospc.arrays import BoolArray, Float32Array, FloatArray
from ospc.correspondence.exposure_normalizer import ExposureNormalizer
from ospc.correspondence.flat_sampling import Samples
from ospc.correspondence.registration import DenseRegistration
from ospc.correspondence.view_motion import CurvedMotion, Homography, homography, view_motion
from ospc.photometry.geometry import pixel_grid
from ospc.recording.frame import Frame
from ospc.settings.registration import HOMOGRAPHY_INLIER_PX
from ospc.system.second_thread import SecondThread
from workers import flat_sampler, preprocessor

SIZE = (320, 240)
CENTRE = (np.array(SIZE) - 1) / 2
SHIFT = np.array([30.0, -12.0])


def disc(radius_px: float) -> BoolArray:
    return np.linalg.norm(pixel_grid(SIZE) - CENTRE, axis=-1) < radius_px


def moving(shown: BoolArray, shift: FloatArray = SHIFT) -> Float32Array:
    """Return displacements by a shift where the scene is shown, and none elsewhere."""
    random = np.random.default_rng(0)
    found = np.where(shown[..., None], shift, 0) + random.normal(0, 0.3, (*shown.shape, 2))
    return found.astype(np.float32)


def turned(places: FloatArray, angle: float) -> FloatArray:
    """Return where an equidistant fisheye, with 180° over 200 pixels, sees the points of places after a pan."""
    x, y = np.moveaxis((places - CENTRE) / 100 * np.pi / 2, -1, 0)
    off_axis = np.hypot(x, y)
    ray = np.stack([x * np.sinc(off_axis / np.pi), y * np.sinc(off_axis / np.pi), np.cos(off_axis)], axis=-1)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    ray = ray @ turn.T
    across = np.linalg.norm(ray[..., :2], axis=-1)
    scale = 100 / (np.pi / 2) * np.arctan2(across, ray[..., 2]) / np.maximum(across, 1e-9)
    return np.asarray(CENTRE + scale[..., None] * ray[..., :2])


@pytest.mark.parametrize("radius_px", [60, 100])
def test_a_surround_that_lies_still_votes_neither_for_nor_against_a_motion(radius_px: float) -> None:
    shown = disc(radius_px)
    found = view_motion(moving(shown), shown)
    assert found is not None
    there = found.at(np.array([[CENTRE]], np.float32))[0, 0]
    np.testing.assert_allclose(there, CENTRE + SHIFT, atol=0.5)
    whole = view_motion(moving(shown), None)
    assert whole is not None
    np.testing.assert_allclose(whole.at(np.array([[CENTRE]], np.float32))[0, 0], CENTRE, atol=0.5)


def test_what_leaves_the_part_that_shows_the_scene_is_lost() -> None:
    shown = disc(60)
    assert view_motion(moving(shown, np.array([50.0, 0.0])), shown) is not None
    assert view_motion(moving(shown, np.array([100.0, 0.0])), shown) is None


def test_a_small_part_has_enough_points() -> None:
    shown = np.zeros(SIZE[::-1], bool)
    shown[100:130, 80:130] = True
    assert view_motion(moving(shown, np.array([6.0, 3.0])), shown) is not None


@pytest.mark.parametrize("seed", range(5))
def test_chance_has_no_motion(seed: int) -> None:
    random, shown = np.random.default_rng(seed), disc(110)
    chance = cv2.resize(random.normal(0, 15, (12, 16, 2)).astype(np.float32), SIZE, interpolation=cv2.INTER_CUBIC)
    assert view_motion(chance, shown) is None


@pytest.mark.parametrize("degrees", [15, 30])
def test_the_image_of_a_fisheye_that_turns_moves_along_curves(degrees: float) -> None:
    places, shown = pixel_grid(SIZE).astype(float), disc(95)
    there = turned(places, np.radians(degrees))
    displacement = (there - places).astype(np.float32)
    found = view_motion(displacement, shown)
    assert found is not None
    stays = shown & (np.linalg.norm(there - CENTRE, axis=-1) < 95)
    error = np.linalg.norm(found.at(places.astype(np.float32)) - there, axis=-1)[stays]
    assert np.mean(error < HOMOGRAPHY_INLIER_PX) > 0.9
    matrix = homography(displacement, shown)
    if matrix is not None:
        straight = Homography(matrix).at(places.astype(np.float32))
        assert np.mean(np.linalg.norm(straight - there, axis=-1)[stays] < HOMOGRAPHY_INLIER_PX) < 0.75


def test_only_an_image_without_corners_moves_along_curves() -> None:
    """With a bonnet in the view, curves would fit the parallax of the road."""
    places = pixel_grid(SIZE).astype(float)
    displacement = (turned(places, np.radians(30)) - places).astype(np.float32)
    fisheye, car = disc(95), np.ones(SIZE[::-1], bool)
    car[-20:] = False
    assert isinstance(view_motion(displacement, fisheye), CurvedMotion)
    assert not isinstance(view_motion(displacement, car), CurvedMotion)


@pytest.mark.parametrize("curved", [False, True])
def test_a_warped_image_looks_like_the_first(*, curved: bool) -> None:
    places, shown = pixel_grid(SIZE).astype(float), disc(95)
    there = turned(places, 0.3) if curved else places + SHIFT
    motion = view_motion((there - places).astype(np.float32), shown)
    assert motion is not None
    values = [np.asarray(100 + 50 * np.sin(at[..., 0] / 15) * np.cos(at[..., 1] / 11)) for at in (there, places)]
    first, second = (np.rint(value).astype(np.uint8) for value in values)
    stays = shown & (np.linalg.norm(there - CENTRE, axis=-1) < 95)
    error = np.abs(motion.warped(second).astype(float) - first)[stays]
    assert np.quantile(error, 0.9) < 6


def compared(*, knows: bool) -> Samples:
    """Return the comparison of two views of a fisheye that turned by 20°; ``knows`` what shows the scene, or not."""
    random, circle = np.random.default_rng(2), disc(95)
    layers = [cv2.GaussianBlur(random.normal(0, 1, (480, 640)), (0, 0), sigma) for sigma in (6, 15, 40)]
    texture = 120 + 25 * sum(layer / layer.std() for layer in layers)
    maps = [place.astype(np.float32) * 2 for place in (pixel_grid(SIZE), turned(pixel_grid(SIZE), np.radians(20)))]
    images = [np.where(circle, cv2.remap(texture, at, None, cv2.INTER_LINEAR), 0) for at in maps]
    prepare, sample = preprocessor(), flat_sampler(max_gradient=1.0)
    frames = [prepare(Frame.of_array(np.clip(image, 0, 250).astype(np.uint8), 1.0)) for image in images]
    first, second = (replace(frame, shown=disc(92) if knows else None) for frame in frames)
    registration = DenseRegistration(SecondThread())(first, second, ExposureNormalizer(), 0.0)
    return sample(sample.keyframe(first), second, registration, 0)


def test_overlap_and_radial_motion_are_those_of_the_scene() -> None:
    places = pixel_grid(SIZE)[disc(92)]
    radius, before = (np.linalg.norm(at - CENTRE, axis=-1) for at in (places, turned(places, np.radians(20))))
    radial = (radius - before)[before < 92] / np.linalg.norm(CENTRE)
    everything, scene = compared(knows=False), compared(knows=True)
    assert scene.radial_motion == pytest.approx(np.sqrt(np.mean(radial**2)), rel=0.2)
    assert scene.radial_motion > 1.3 * everything.radial_motion
    assert scene.overlap > 1.3 * everything.overlap
    assert len(scene.observations) > 1.5 * len(everything.observations)
