"""Geometry of the rendering compared with an independent ray caster, and radiance compared with the scene."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from ospc.photometry.geometry import normalised
from ospc.simulation import SimulationSettings
from ospc.simulation.motion import Motion
from ospc.simulation.rendering import View, radiance
from ospc.simulation.scene import Scene
from ospc.simulation.surface import Face, Solid, pyramid
from ospc.simulation.truth import view_at

SIZE = (160, 120)


def all_faces(scene, time_s):
    solids = [face for solid in scene.solids for face in solid.faces]
    return [*scene.walls, *scene.pictures, *solids, *(patch.at(time_s) for patch in scene.patches)]


def projected(view, points_m):
    """Return the pixels (x, y) of world points; NaN behind the camera."""
    camera = (points_m - view.position_m) @ view.rotation
    depth = np.where(camera[..., 2:] > 0.02, camera[..., 2:], np.nan)
    return view.focal_px * camera[..., :2] / depth + (np.array(view.size) - 1) / 2


def corners_of(place):
    """Return the four corners of a rectangle, shape (4, 3)."""
    a, d = place.across * place.size_m[0], place.down * place.size_m[1]
    return place.corner_m + np.array([0 * a, a, a + d, d])


def repainted(scene, paint):
    """Replace the radiance of every face and patch; ``paint`` receives its number and the face or patch."""
    numbers = iter(range(1, 1000))

    def new(face):
        return Face(face.place, pyramid(paint(next(numbers), face)))

    walls = tuple(new(face) for face in scene.walls)
    pictures = tuple(new(face) for face in scene.pictures)
    solids = tuple(Solid(tuple(new(f) for f in s.faces), s.centre_m, s.radius_m) for s in scene.solids)
    patches = tuple(replace(patch, mips=pyramid(paint(next(numbers), patch))) for patch in scene.patches)
    return replace(scene, walls=walls, pictures=pictures, solids=solids, patches=patches, scale=1.0)


def nearest_face(scene, view, time_s):
    """Cast a ray through every pixel; return the number (from 1) and the depth of the first face it hits."""
    x, y = np.meshgrid(np.arange(view.size[0]), np.arange(view.size[1]))
    centre = (np.array(view.size) - 1) / 2
    ray = np.stack([(x - centre[0]) / view.focal_px, (y - centre[1]) / view.focal_px, np.ones_like(x)], -1)
    ray = ray @ view.rotation.T
    nearest, number = np.full(x.shape, np.inf), np.zeros(x.shape, int)
    for index, face in enumerate(all_faces(scene, time_s), start=1):
        place = face.place
        with np.errstate(divide="ignore"):
            distance = place.normal @ (place.corner_m - view.position_m) / (ray @ place.normal)
        offset = view.position_m + ray * distance[..., None] - place.corner_m
        a, d = offset @ place.across, offset @ place.down
        hit = (distance > 0) & (a >= 0) & (a <= place.size_m[0]) & (d >= 0) & (d <= place.size_m[1])
        closer = hit & (distance < nearest)
        nearest[closer], number[closer] = distance[closer], index
    return number, nearest


@pytest.fixture(scope="module", params=[0, 1])
def room(request):
    settings = SimulationSettings(size=SIZE, seed=request.param)
    return settings, Scene.of(settings)


def interior(number, reach=1):
    """Return a mask of pixels whose neighbours show the same face, without the image border."""
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    shown = number.astype(np.float32)
    same = cv2.dilate(shown, kernel) == cv2.erode(shown, kernel)
    same[:reach] = same[-reach:] = False
    same[:, :reach] = same[:, -reach:] = False
    return same


@pytest.mark.parametrize("patches", [0, 16])
@pytest.mark.parametrize("kind", ["handheld", "forward"])
def test_every_pixel_shows_the_nearest_surface(room, kind, patches):
    settings = replace(room[0], motion=kind, moving_objects=patches)
    labelled = repainted(Scene.of(settings), lambda number, _: np.full((32, 32), number, np.float32))
    motion = Motion.of(settings)
    for time_s in np.linspace(0, 40, 4):
        view = view_at(settings, motion, time_s)
        number, _ = nearest_face(labelled, view, time_s)
        inside = interior(number)
        assert number.min() > 0, "the room is closed"
        assert inside.mean() > 0.4
        shown = radiance(labelled, view, time_s)
        # The blunt tip of an acute corner may cover part of a neighbouring pixel.
        assert np.count_nonzero(np.abs(shown / number - 1)[inside] > 1e-5) <= 3


def test_a_scene_point_has_the_same_radiance_in_every_frame(room):
    settings, scene = room

    def smooth(number, _):
        rng = np.random.default_rng(number)
        coarse = rng.uniform(0.5, 1.5, (4, 4)).astype(np.float32)
        return cv2.resize(coarse, (256, 256), interpolation=cv2.INTER_LINEAR)

    painted = repainted(scene, smooth)
    motion = Motion.of(settings)
    first = view_at(settings, motion, 3.0)
    number, distance = nearest_face(painted, first, 0)
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    rays = np.stack([x - (SIZE[0] - 1) / 2, y - (SIZE[1] - 1) / 2, np.full(x.shape, first.focal_px)], -1)
    points = first.position_m + (rays / first.focal_px * distance[..., None]) @ first.rotation.T
    before = radiance(painted, first, 0)
    compared = 0
    for time_s in (3.2, 3.5, 4.0):
        second = view_at(settings, motion, time_s)
        seen, depth = nearest_face(painted, second, 0)
        after = radiance(painted, second, 0)
        place = projected(second, points)
        depth_there = (points - second.position_m) @ second.rotation[:, 2]
        inside = np.all((place > 2) & (place < np.array(SIZE) - 3), axis=-1)
        column, row = np.rint(place[inside]).astype(int).T
        shown = interior(seen)[row, column] & interior(number)[inside]
        shown &= (seen[row, column] == number[inside]) & (np.abs(depth[row, column] / depth_there[inside] - 1) < 0.05)
        sampled = cv2.remap(after, place[inside].astype(np.float32)[:, None], None, cv2.INTER_LINEAR)[:, 0]
        ratio = np.log(sampled / before[inside])[shown]
        compared += ratio.size
        assert np.quantile(np.abs(ratio), 0.99) < 0.03
        assert np.median(np.abs(ratio)) < 0.003
        assert abs(np.median(ratio)) < 0.001
    assert compared > 5000


def test_fine_texture_averages_out_instead_of_aliasing(room):
    settings, scene = room
    noise = np.random.default_rng(0).uniform(0, 2, (1024, 1024)).astype(np.float32)
    noisy = repainted(scene, lambda *_: noise)
    view = view_at(settings, Motion.of(settings), 0.0, width=40)
    seen = radiance(noisy, view, 0.0)
    assert seen.mean() == pytest.approx(1.0, abs=0.02)
    assert seen.std() < 0.25, "a pixel covers many elements, of which each has a deviation of 0.58"


def test_levels_of_the_pyramid_meet_without_a_step(room):
    settings, scene = room
    ramp = np.tile(np.linspace(1, 2, 1024, dtype=np.float32), (1024, 1))
    painted = repainted(scene, lambda *_: ramp)
    view = view_at(settings, Motion.of(settings), 1.0)
    number, _ = nearest_face(painted, view, 1.0)
    seen = radiance(painted, view, 1.0)
    bend = np.abs(seen[:, 2:] - 2 * seen[:, 1:-1] + seen[:, :-2])
    flat = (interior(number, 2) & (number <= len(scene.walls)))[:, 1:-1]
    assert flat.mean() > 0.4
    assert np.count_nonzero(bend[flat] > 0.005) <= 3


def test_radiance_is_that_of_the_surface():
    settings = SimulationSettings(size=(640, 480), seed=3)
    scene = Scene.of(settings)
    wall = scene.walls[2]
    only = replace(scene, pictures=(), solids=())
    place = wall.place
    centre = place.grid(1, 1)[0, 0]
    rotation = np.stack([place.across, place.down, -place.normal], axis=-1)
    texel_m = place.size_m[0] / wall.mips[0].shape[1]
    # A frontal view whose pixels are exactly as large as texture elements, so nothing is interpolated.
    view = View((640, 480), 400.0, centre + place.normal * texel_m * 400, rotation)
    corner = np.rint(np.array(wall.mips[0].shape[::-1]) / 2 - np.array([640, 480]) / 2).astype(int)
    shift = np.array(wall.mips[0].shape[::-1]) / 2 - np.array([640, 480]) / 2 - corner
    view = replace(
        view,
        position_m=view.position_m - (shift[0] * place.across * texel_m + shift[1] * place.down * texel_m),
    )
    seen = radiance(only, view, 0.0)
    expected = wall.mips[0][corner[1] : corner[1] + 480, corner[0] : corner[0] + 640] * np.float32(scene.scale)
    np.testing.assert_allclose(seen[5:-5, 5:-5], expected[5:-5, 5:-5], rtol=2e-2)


def test_scene_points_cross_the_image_radially():
    settings = SimulationSettings(seed=0)
    motion = Motion.of(settings)
    points = np.concatenate([face.place.grid(12, 8).reshape(-1, 3) for face in Scene.of(settings).walls])
    spread = []
    for start in range(0, 20, 2):
        radii = []
        for time_s in np.arange(start, start + 2, 0.1):
            place = projected(view_at(settings, motion, time_s), points)
            inside = np.all((place >= 0) & (place <= np.array(settings.size) - 1), axis=-1)
            radius = np.linalg.norm(normalised(place, settings.size), axis=-1)
            radii.append(np.where(inside, radius, np.nan))
        seen = np.array(radii)
        seen = seen[:, np.sum(np.isfinite(seen), axis=0) > 1]
        spread.extend(np.nanmax(seen, axis=0) - np.nanmin(seen, axis=0))
    assert np.mean(np.array(spread) > 0.2) > 0.3


def test_patches_move_and_the_rest_stays():
    settings = SimulationSettings(size=SIZE, motion="static", moving_objects=4)
    scene = Scene.of(settings)
    view = view_at(settings, Motion.of(settings), 0.0)
    images = np.array([radiance(scene, view, time_s) for time_s in np.linspace(0, 8, 17)])
    changed = np.ptp(images, axis=0) > 1e-6
    assert 0.02 < changed.mean() < 0.8
    bare = radiance(replace(scene, patches=()), view, 0.0)
    np.testing.assert_allclose(images[0][~changed], bare[~changed])


def test_the_scene_spans_more_than_two_and_a_half_decades():
    for seed in range(3):
        scene = Scene.of(SimulationSettings(seed=seed))
        values = np.concatenate([face.mips[3].ravel() for face in all_faces(scene, 0.0)])
        low, high = np.quantile(values, [0.002, 0.998])
        assert np.log10(high / low) > 2.5


@pytest.mark.parametrize("seed", range(4))
def test_solids_are_parted_so_that_they_can_be_sorted(seed):
    solids = Scene.of(SimulationSettings(seed=seed)).solids
    corners = [np.concatenate([corners_of(face.place) for face in solid.faces]) for solid in solids]

    def power(points, solid):
        return np.sum((points - solid.centre_m) ** 2, axis=-1) - solid.radius_m**2

    for one, own in zip(solids, corners, strict=True):
        assert np.linalg.norm(own - one.centre_m, axis=-1).max() <= one.radius_m + 1e-9
        assert np.hypot(own[:, 0], own[:, 1]).min() > 1.83, "further out than camera and patches"
        for other in solids:
            if other is not one:
                assert np.all(power(own, one) < power(own, other))


def test_a_pixel_on_the_horizon_of_a_wall_shows_the_wall_before_it():
    """The plane of the second wall has no finite depth at this pixel, but the wall does not cover it."""
    settings = SimulationSettings(size=(640, 480), seed=77005, motion="handheld", speed=1.12)
    view = view_at(settings, Motion.of(settings), 739 / settings.fps)
    shown = radiance(Scene.of(settings), view, 739 / settings.fps)
    assert np.all(np.isfinite(shown))
    assert shown[336, 440] == pytest.approx(np.median(shown[334:339, 438:443]), rel=0.3)
