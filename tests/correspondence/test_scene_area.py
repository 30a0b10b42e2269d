"""The part of the image that shows the scene: usable radius and overlays."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import cv2
import numpy as np
import pytest

from ospc import Frame
from ospc.arrays import BoolArray, FloatArray, Image
from ospc.correspondence.preprocessing import PreprocessedFrame
from ospc.correspondence.scene_area import SceneArea
from ospc.photometry.geometry import normalised, pixel_grid
from workers import preprocessor

SIZE = (160, 120)


def area_of(images: Iterable[Image], mask: BoolArray | None = None, places: Sequence[FloatArray] = ()) -> SceneArea:
    """Return what is known after these images, given the homographies from each to the scene (default: WALK's)."""
    area, prepare = SceneArea(), preprocessor()
    before: tuple[PreprocessedFrame, FloatArray] | None = None
    for index, image in enumerate(images):
        frame, place = prepare(Frame.of_array(image, 1.0)), places[index] if places else at(*WALK[index])
        area.observe(frame, mask)
        if before is not None:
            area.compare(before[0], frame, np.linalg.inv(place) @ before[1])
        before = frame, place
    return area


def at(x: float, y: float, zoom: float = 1.0) -> FloatArray:
    """Return the homography from a view to the scene, for an offset in pixels and a zoom about the centre."""
    centre = np.array([(SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2])
    shift = centre * (1 - 1 / zoom) + (x, y)
    return np.array([[1 / zoom, 0, shift[0]], [0, 1 / zoom, shift[1]], [0, 0, 1]])


def views(offsets: Iterable[tuple[int, int]], seed: int = 0) -> list[Image]:
    """Return views of a textured plane at offsets (x, y) in pixels, with noise."""
    random = np.random.default_rng(seed)
    texture = sum(
        cv2.resize(random.normal(0, 12, (600 // n, 800 // n)), (800, 600), interpolation=cv2.INTER_CUBIC)
        for n in (2, 5, 20)
    )
    return seen(110 + texture, [at(x, y) for x, y in offsets], random)


def seen(scene: FloatArray, places: Iterable[FloatArray], random: np.random.Generator) -> list[Image]:
    """Return views of a plane, given the homographies from each to the plane, with noise."""
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    clean = (cv2.warpPerspective(scene.astype(np.float32), place, SIZE, flags=flags) for place in places)
    return [np.clip(image + random.normal(0, 1, SIZE[::-1]), 0, 255).astype(np.uint8) for image in clean]


WALK = [(11 * i % 600, 17 * i % 450) for i in range(80)]
TREMBLE = [(100 + i % 3, 100 + i % 2) for i in range(40)]
TWO_VIEWS = [(0, 0), (300, 300)] * 20


def lit(shape: BoolArray) -> SceneArea:
    """Return what is known after images that are black outside a shape."""
    return area_of(np.where(shape, image, 0).astype(np.uint8) for image in views(WALK))


def letters() -> BoolArray:
    """Return the pixels of a word."""
    word = np.zeros(SIZE[::-1], np.uint8)
    cv2.putText(word, "REC", (30, 70), cv2.FONT_HERSHEY_SIMPLEX, 1.6, 255, 6)
    return word > 0


def box() -> BoolArray:
    """Return the pixels of a box in a corner."""
    mask = np.zeros(SIZE[::-1], bool)
    mask[:20, :46] = True
    return mask


@pytest.mark.parametrize(
    ("used", "expected"),
    [
        (np.s_[:59, :], 1.0),
        (np.s_[:75, :], 1.0),
        (np.s_[:, 80:], 1.0),
        (np.s_[30:90, 40:120], 0.5),
        (np.s_[30:90, :], 0.86),
    ],
)
def test_a_mask_reaches_as_far_as_any_pixel_in_use(used: tuple[slice, slice], expected: float) -> None:
    mask = np.zeros(SIZE[::-1], bool)
    mask[used] = True
    image = np.random.default_rng(0).integers(50, 200, SIZE[::-1]).astype(np.uint8)
    assert area_of([image], mask).usable_radius() == pytest.approx(expected, abs=0.03)


@pytest.mark.parametrize("used", [np.s_[:, 30:130], np.s_[20:100, :]])
def test_the_usable_radius_includes_the_margin_beside_bars_but_not_the_bars(used: tuple[slice, slice]) -> None:
    between = np.zeros(SIZE[::-1], bool)
    between[used] = True
    area = lit(between)
    visible = np.linalg.norm(normalised(pixel_grid(SIZE), SIZE), axis=-1)[between].max()
    pixel = 2 / np.hypot(*SIZE)
    assert visible - pixel / 2 < area.usable_radius() < visible + pixel
    surround = area.surround()
    assert surround is not None
    assert surround[~between].all()
    assert surround[between].any()


def test_the_usable_radius_reaches_the_farthest_corner_that_shows_the_scene() -> None:
    place = normalised(pixel_grid(SIZE), SIZE)
    two_bars = np.zeros(SIZE[::-1], bool)
    two_bars[24:, 32:] = True
    assert lit(two_bars).usable_radius() == 1
    y, x = np.indices(SIZE[::-1])
    trapezoid = np.abs(x - 79.5) < 54 + 26 * y / 120
    assert lit(trapezoid).usable_radius() == pytest.approx(np.linalg.norm(place, axis=-1)[trapezoid].max(), abs=0.03)


@pytest.mark.parametrize("centre", [(79.5, 59.5), (87.5, 63.5), (94.5, 67.5)])
def test_the_usable_radius_of_an_image_circle_is_about_its_own_centre(centre: tuple[float, float]) -> None:
    x, y = centre
    circle = np.linalg.norm(np.indices(SIZE[::-1]) - np.reshape([y, x], (2, 1, 1)), axis=0) < 75
    assert lit(circle).usable_radius() == pytest.approx(0.75, abs=0.02)


@pytest.mark.parametrize("radius", [0.94, 0.96, 0.975])
def test_an_image_circle_may_cut_only_the_extreme_corners(radius: float) -> None:
    distance = np.linalg.norm(np.indices(SIZE[::-1]) - np.reshape([59.5, 79.5], (2, 1, 1)), axis=0)
    assert lit(distance < 100 * radius).usable_radius() == pytest.approx(radius, abs=0.012)


def test_specks_of_noise_beside_the_image_circle_do_not_belong_to_it() -> None:
    distance = np.linalg.norm(np.indices(SIZE[::-1]) - np.reshape([59.5, 79.5], (2, 1, 1)), axis=0)
    specks = cv2.dilate((np.random.default_rng(4).random(SIZE[::-1]) < 0.004).astype(np.uint8), np.ones((1, 3))) > 0
    images = [np.where(distance < 55, image, np.where(specks, 90, 3)).astype(np.uint8) for image in views(WALK)]
    area = area_of(images)
    assert area.usable_radius() == pytest.approx(0.55, abs=0.02)
    surround = area.surround()
    assert surround is not None
    assert surround[distance > 57].all()


@pytest.mark.parametrize("shape", [letters, box])
@pytest.mark.parametrize("opacity", [0.4, 1.0])
def test_an_overlay_is_covered_with_its_inside_and_little_else(
    shape: Callable[[], BoolArray], opacity: float
) -> None:
    covered = shape()
    images = [
        np.where(covered, (1 - opacity) * image + opacity * 240, image).astype(np.uint8) for image in views(WALK)
    ]
    found = area_of(images).overlay()
    assert found is not None
    assert found[covered].all()
    nearby = cv2.dilate(covered.astype(np.uint8), np.ones((21, 21), np.uint8)) > 0
    assert not found[~nearby].any()


@pytest.mark.parametrize("offsets", [WALK, WALK[:5], WALK[:12], TREMBLE, TWO_VIEWS, [(0, 0)] * 40])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_scene_is_no_overlay(offsets: list[tuple[int, int]], seed: int) -> None:
    area = area_of(views(offsets, seed), places=[at(x, y) for x, y in offsets])
    assert area.overlay() is None
    assert area.overlay_share == 0


ZOOM = [1 + 0.7 * abs((i % 20) / 10 - 1) for i in range(60)]


def test_edges_that_slide_along_themselves_in_a_zoom_are_no_overlay() -> None:
    places, random = [at(250, 200, zoom) for zoom in ZOOM], np.random.default_rng(5)
    x0, y0 = 250 + (SIZE[0] - 1) / 2, 200 + (SIZE[1] - 1) / 2
    y, x = np.indices((600, 800)) - np.reshape([y0, x0], (2, 1, 1))
    texture = cv2.resize(random.normal(0, 25, (120, 160)), (800, 600), interpolation=cv2.INTER_CUBIC)
    scene = 110 + np.where((x > 0) | (np.abs(y) > 15), texture, 40 * np.sign(y))
    assert area_of(seen(scene, places, random), places=places).overlay() is None


def test_an_overlay_is_found_while_the_camera_zooms() -> None:
    places = [at(250, 200, zoom) for zoom in ZOOM]
    random = np.random.default_rng(6)
    scene = 110 + 25 * cv2.resize(random.normal(0, 1, (120, 160)), (800, 600), interpolation=cv2.INTER_CUBIC)
    images = [np.where(letters(), 240, image).astype(np.uint8) for image in seen(scene, places, random)]
    found = area_of(images, places=places).overlay()
    assert found is not None
    assert found[letters()].mean() > 0.8


def test_what_stays_in_place_while_nothing_moves_is_no_overlay() -> None:
    images = [np.where(letters(), 240, image).astype(np.uint8) for image in views([(0, 0)] * 40)]
    assert area_of(images, places=[at(0, 0)] * 40).overlay() is None


def test_defective_pixels_and_the_edge_of_a_fisheye_are_no_overlay() -> None:
    random = np.random.default_rng(3)
    defects = random.random(SIZE[::-1]) < 0.005
    disc = np.linalg.norm(np.indices(SIZE[::-1]) - np.reshape([60, 80], (2, 1, 1)), axis=0) < 55
    images = [np.where(disc, np.where(defects, 255, image), 0).astype(np.uint8) for image in views(WALK)]
    assert area_of(images).overlay() is None


def test_the_edge_of_what_a_mask_hides_is_no_overlay() -> None:
    images = [np.where(box(), 0, image).astype(np.uint8) for image in views(WALK)]
    assert area_of(images).overlay() is not None
    assert area_of(images, ~box()).overlay() is None


def test_the_dark_corners_of_a_wide_lens_show_the_scene() -> None:
    width, height = SIZE
    y, x = np.indices((height, width)) - np.reshape([(height - 1) / 2, (width - 1) / 2], (2, 1, 1))
    tangent = 1.6 * np.hypot(x, y) / np.hypot(width / 2, height / 2)
    attenuation = (1 + tangent**2) ** -2  # cos⁴: 0.08 at the corners
    corners = area_of((2 * image * attenuation).clip(0, 255).astype(np.uint8) for image in views(WALK))
    assert corners.surround() is None
    assert corners.usable_radius() == 1
    circle = np.where(tangent < 1.2, attenuation, 0.02)
    surround = area_of((2 * image * circle).clip(0, 255).astype(np.uint8) for image in views(WALK)).surround()
    assert surround is not None
    assert surround[tangent >= 1.2].all()
    assert not surround[tangent < 1.0].any()


@pytest.mark.parametrize(("softness_px", "is_surround"), [(0.0, True), (6.0, False)])
def test_a_dark_floor_that_reaches_three_corners_is_no_surround(*, softness_px: float, is_surround: bool) -> None:
    """Its edge is neither sharp, as that of a window or a bar, nor round, as that of an image circle."""
    x, y = np.moveaxis(pixel_grid(SIZE), -1, 0)
    dark = ((y > 95) | ((x > 130) & (y < 40)) | (x > 150)).astype(np.float32)
    share = 1 - 0.99 * (cv2.GaussianBlur(dark, (0, 0), softness_px) if softness_px else dark)
    area = area_of((share * image).astype(np.uint8) for image in views(WALK))
    assert (area.surround() is not None) is is_surround


def test_places_under_an_overlay_do_not_show_the_scene() -> None:
    covered = box()
    images = [np.where(covered, 0, image).astype(np.uint8) for image in views(WALK)]
    pixels = np.array([[25.0, 10.0], [120.0, 80.0], [25.0, 100.0]])
    shown = area_of(images).shows_scene(normalised(pixels, SIZE))
    assert shown is not None
    assert shown.tolist() == [False, True, True]


@pytest.mark.parametrize("softness_px", [0.01, 2.0])
def test_registration_does_not_see_the_edge_of_an_image_circle(softness_px: float) -> None:
    distance = np.linalg.norm(np.indices(SIZE[::-1]) - np.reshape([59.5, 79.5], (2, 1, 1)), axis=0)
    light = 1 / (1 + np.exp(np.clip((distance - 45) / softness_px, -50, 50)))
    prepare, area = preprocessor(), SceneArea()
    frames = [prepare(Frame.of_array((light * image).astype(np.uint8), 1.0)) for image in views(WALK)]
    for frame in frames:
        area.observe(frame, None)
    for before, after in zip(frames[-2:], area.extended(*frames[-2:]), strict=True):
        np.testing.assert_array_equal(after.small[distance < 32], before.small[distance < 32])
        assert after.small[distance > 52].min() > 30


def soft_disc(softness_px: float, centre: tuple[float, float] = (79.5, 59.5)) -> SceneArea:
    """Return what is known after images of a circle of 45 pixels with a soft edge."""
    distance = np.linalg.norm(np.indices(SIZE[::-1]) - np.reshape(centre[::-1], (2, 1, 1)), axis=0)
    light = 1 / (1 + np.exp(np.clip((distance - 45) / softness_px, -50, 50)))
    return area_of((light * image).astype(np.uint8) for image in views(WALK))


@pytest.mark.parametrize("softness_px", [0.01, 1.0, 2.0, 3.0])
def test_the_soft_edge_of_an_image_circle_is_no_overlay(softness_px: float) -> None:
    assert soft_disc(softness_px).overlay() is None


@pytest.mark.parametrize("centre", [(79.5, 59.5), (88.5, 63.5)])
def test_a_soft_edge_is_told_from_a_sharp_one(centre: tuple[float, float]) -> None:
    assert soft_disc(0.01, centre).soft_circle() is None
    found = soft_disc(2.0, centre).soft_circle()
    assert found is not None
    np.testing.assert_allclose(found, normalised(np.array(centre), SIZE), atol=0.01)
    assert area_of(views(WALK)).soft_circle() is None


def test_surround_overlay_and_masked_parts_do_not_show_the_scene() -> None:
    assert area_of(views(WALK)).shown() is None
    np.testing.assert_array_equal(area_of(views(WALK), ~box()).shown(), ~box())
    covered = area_of(np.where(letters(), 240, image).astype(np.uint8) for image in views(WALK)).shown()
    assert covered is not None
    assert not covered[letters()].any()
    area = soft_disc(0.01)
    shown, surround = area.shown(), area.surround()
    assert shown is not None
    assert surround is not None
    np.testing.assert_array_equal(shown, ~surround)
