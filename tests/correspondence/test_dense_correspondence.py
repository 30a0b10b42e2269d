"""Preprocessed frames, their registration, and the samples taken from pairs."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import moment

from ospc.correspondence.exposure_normalizer import ExposureNormalizer
from ospc.correspondence.registration import (
    DenseRegistration,
    Registration,
    displacement_at,
    jacobian_at,
)
from ospc.correspondence.thumbnail_registration import values_at
from ospc.errors import SettingError
from ospc.exposures.brightness import BrightnessComparer
from ospc.photometry.geometry import pixel_grid
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette
from ospc.recording.frame import Frame
from ospc.settings import DefaultSettings
from ospc.settings.registration import MIN_REGISTERED_SIDE_PX
from ospc.settings.sampling import SAMPLING_MARGIN_PX
from ospc.system.second_thread import SecondThread
from workers import flat_sampler, preprocessor

SIZE = (320, 240)
RESPONSE = Response.gamma(2.0)
LOG_RESPONSE = np.log(RESPONSE.inverse(np.maximum(np.arange(256), 1) / 255))
VIGNETTE = PolynomialVignette(SIZE, (-0.35, 0.05, -0.1))


def of_array(image, exposure_ms=1.0, **attributes):
    return Frame.of_array(np.ascontiguousarray(image), exposure_ms, **attributes)


def ramp(width, height, across, down, base, white=255, dtype=np.uint8):
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    return np.rint((base + across * x + down * y) * white).astype(dtype)


# Views


@given(st.integers(2, 253), st.sampled_from([(256, 192), (361, 245), (203, 400)]), st.integers(130, 400))
def test_reduction_keeps_an_even_image(level, size, longest):
    frame = preprocessor(longest_side=longest, registration_side=130)(
        of_array(np.full(size[::-1], level, np.uint8), 2.5)
    )
    assert max(frame.grey.shape) <= longest
    np.testing.assert_allclose(frame.grey, level / 255, rtol=1e-6)
    np.testing.assert_allclose(frame.gradient, 0, atol=1e-7)
    assert not frame.clipped.any()
    assert np.all(frame.small == level)
    assert max(frame.small.shape) <= 130
    assert frame.size == size


@pytest.mark.parametrize("size", [(640, 48), (1920, 150), (8192, 100), (1600, 33), (33, 1600)])
def test_a_strip_stays_wide_enough_to_be_registered(size):
    """OpenCV's dense search crashes on images that are wide and only a few patches high."""
    noise = np.random.default_rng(0).integers(0, 256, size[::-1], np.uint8)
    frame = preprocessor()(of_array(cv2.GaussianBlur(noise, (0, 0), 6)))
    assert min(*frame.grey.shape, *frame.small.shape) >= MIN_REGISTERED_SIDE_PX
    assert preprocessor().small_size(size) == frame.small.shape[::-1]
    registration = DenseRegistration(SecondThread())(
        frame, frame, lambda first, second, _ratio: (first.small, second.small)
    )
    np.testing.assert_allclose(registration.forward, 0, atol=0.1)


@pytest.mark.parametrize(("longest", "reduction"), [(400, 1), (200, 2), (100, 4)])
@pytest.mark.parametrize(("dtype", "white"), [(np.uint8, 255), (np.uint16, 4095), (np.uint16, 65535)])
def test_grey_levels_and_slopes_belong_to_the_stated_positions(longest, reduction, dtype, white):
    image = ramp(400, 300, 0.0015, 0.0008, 0.05, white, dtype)
    frame = preprocessor(longest_side=longest)(of_array(image, max_grey=white))
    assert frame.reduction == reduction
    height, width = frame.grey.shape
    places = pixel_grid((width, height))
    inside = (slice(8, height - 8), slice(8, width - 8))
    x, y = np.moveaxis(frame.to_frame(places), -1, 0)
    expected = 0.05 + 0.0015 * x + 0.0008 * y
    np.testing.assert_allclose(frame.grey[inside], expected[inside], atol=0.3 / 255)
    np.testing.assert_allclose(frame.gradient[inside], np.hypot(0.0015, 0.0008) * reduction, atol=2e-4)
    assert frame.grey.mean() == pytest.approx(image.mean() / white, abs=2e-3)


@pytest.mark.parametrize("longest", [400, 200])
def test_the_noise_of_a_sample_is_that_of_so_many_pixels(longest):
    noise = np.random.default_rng(0).normal(0, 12, (300, 400))
    frame = preprocessor(longest_side=longest)(of_array(np.rint(128 + noise).astype(np.uint8)))
    pixels = 4 * np.pi * (DefaultSettings.smoothing_px * frame.reduction) ** 2
    assert frame.grey.std() * 255 == pytest.approx(12 / np.sqrt(pixels), rel=0.06)


@pytest.mark.parametrize("level", [0, 255])
def test_clipped_areas_are_marked_and_single_clipped_pixels_are_not(level):
    image = np.full((120, 160), 128, np.uint8)
    image[40:70, 50:90] = level
    image[90, 120] = level
    frame = preprocessor()(of_array(image))
    assert frame.clipped[45:65, 55:85].all()
    marked = np.argwhere(frame.clipped)
    assert np.all((marked >= [34, 44]) & (marked <= [75, 95]))


@pytest.mark.parametrize("longest", [160, 80])
def test_the_tips_of_texture_keep_means_from_being_used_where_they_are_white_but_not_where_they_are_black(longest):
    """Black pixels are due to noise, which is corrected; the light that a white pixel lost is unknown."""
    white, black = (np.full((120, 160), 128, np.uint8) for _ in range(2))
    size = 3 * 160 // longest
    for image, level in ((white, 255), (black, 0)):
        image[60 : 60 + size, 80 : 80 + size] = level
    frames = [preprocessor(longest_side=longest)(of_array(image)) for image in (white, black)]
    there = np.array([61, 81]) * longest // 160
    distance = np.abs(np.argwhere(frames[0].clipped) - there).max(axis=1)
    assert np.count_nonzero(distance <= 4) == 9**2
    assert distance.max() <= 8
    assert not frames[1].clipped.any()


@pytest.mark.parametrize(("dtype", "white"), [(np.uint8, 255), (np.uint16, 4095)])
def test_pixels_that_are_wrong_hardly_change_the_grey_levels_around(dtype, white):
    random = np.random.default_rng(0)
    image = ramp(320, 240, 0.001, 0.0005, 0.05, white, dtype)
    wrong = np.where(random.random(image.shape) < 0.01, random.choice([0, white], image.shape), image).astype(dtype)
    clean, disturbed = (preprocessor()(of_array(one, max_grey=white)).grey for one in (image, wrong))
    smoothed = cv2.GaussianBlur(wrong.astype(np.float32) / white, (0, 0), DefaultSettings.smoothing_px)
    assert abs(np.mean(disturbed - clean)) < 0.1 * abs(np.mean(smoothed - clean))
    assert np.std(disturbed - clean) < 0.3 * np.std(smoothed - clean)


def test_deep_images_clip_where_their_eight_most_significant_bits_would():
    image = np.full((80, 100), 2000, np.uint16)
    image[:40, :50], image[40:, 50:] = 4090, 10
    frame = preprocessor()(of_array(image, max_grey=4095))
    assert frame.clipped[10, 10]
    assert frame.clipped[70, 90]
    assert not frame.clipped[10, 90]


# Registration

SHIFT = np.array([7.4, -4.3])


def radiance_of(places):
    """Return a smooth scene with structure at several scales, at points (x, y)."""
    random = np.random.default_rng(5)
    angle, phase = random.uniform(0, 2 * np.pi, (2, 60))
    wavelength = np.geomspace(12, 120, 60)
    wave = np.stack([np.cos(angle), np.sin(angle)], axis=1) / wavelength[:, None] * 2 * np.pi
    field = np.zeros(places.shape[:-1])
    for vector, offset, length in zip(wave, phase, wavelength, strict=True):
        field += np.sin(places @ vector + offset) * (length / 60) ** 0.5
    deviation = np.sqrt(np.sum(wavelength / 60) / 2)  # the same at all points, so that all views show one scene
    return 0.16 * np.exp(0.5 * field / deviation)


def seen(shift, exposure, vignette=VIGNETTE, noise=0.003):
    """Return a frame of the scene displaced by ``shift``."""
    irradiance = exposure * vignette.image() * radiance_of(pixel_grid(SIZE) - shift)
    random = np.random.default_rng(int(exposure * 10))
    grey = RESPONSE(np.clip(irradiance, 0, 1)) + random.normal(0, noise, SIZE[::-1])
    return of_array(np.clip(np.rint(grey * 255), 0, 255).astype(np.uint8), exposure)


@pytest.mark.parametrize(
    "normalizer",
    [
        ExposureNormalizer(),
        ExposureNormalizer(LOG_RESPONSE),
        ExposureNormalizer(LOG_RESPONSE, VIGNETTE),
        ExposureNormalizer(LOG_RESPONSE - 40.0, VIGNETTE),
    ],
    ids=["nothing known", "response known", "both known", "next to no light below a white never seen"],
)
def test_registration_finds_a_shift_in_spite_of_exposure_and_vignette(normalizer):
    frame0, frame1 = (preprocessor()(seen(s, e)) for s, e in ((np.zeros(2), 1.0), (SHIFT, 2.0)))
    registration = DenseRegistration(SecondThread())(frame0, frame1, normalizer)
    places = pixel_grid(SIZE)[20:-20:6, 20:-20:6].reshape(-1, 2)
    displacement, forward_backward_error = displacement_at(registration, places, 1.0)
    error = np.linalg.norm(displacement - SHIFT, axis=1)
    assert np.median(error) < 0.1
    assert np.quantile(error, 0.9) < 0.3
    assert np.median(forward_backward_error) < 0.1


@pytest.mark.parametrize(
    ("stated", "trusted"),
    [
        *((stated, False) for stated in (np.log(1.9), np.nan, np.log(1 / 1.9), 3.0)),
        *((stated, True) for stated in (np.log(1.9), np.nan, 3.0, -7.0)),
    ],
)
def test_a_normalizer_brings_frames_to_one_brightness_whatever_exposures_are_stated(stated, trusted):
    frame0, frame1 = (preprocessor()(seen(np.zeros(2), e, noise=0)) for e in (1.0, 1.9))
    normalizer = ExposureNormalizer(LOG_RESPONSE, trusts_stated=trusted)
    image0, image1 = (image.astype(float) for image in normalizer(frame0, frame1, stated))
    unclipped = (frame1.small < 250) & (frame0.small > 20)
    np.testing.assert_allclose(image0[unclipped], image1[unclipped], atol=4)


def test_a_ratio_that_is_unknown_is_measured_though_exposures_are_trusted():
    frames = [preprocessor()(seen(np.zeros(2), e, noise=0)) for e in (1.0, 1.9)]
    trusting, looking = ExposureNormalizer(LOG_RESPONSE, trusts_stated=True), ExposureNormalizer(LOG_RESPONSE)
    for found, expected in zip(trusting(*frames, np.nan), looking(*frames, np.nan), strict=True):
        np.testing.assert_array_equal(found, expected)


def test_with_the_vignette_known_the_same_scene_looks_the_same_wherever_it_is():
    frames = (preprocessor()(seen(np.array(s), 1.0, noise=0)) for s in ((0.0, 0.0), (40.0, 30.0)))
    whole, shifted = ExposureNormalizer(LOG_RESPONSE, VIGNETTE)(*frames, 0.0)
    np.testing.assert_allclose(whole[:-30, :-40].astype(float), shifted[30:, 40:], atol=4)


@pytest.mark.parametrize("exposure", [0.4, 1.0, 2.5])
def test_the_exposure_ratio_is_read_off_the_images(exposure):
    frame0, frame1 = (preprocessor()(seen(s, e)) for s, e in ((np.zeros(2), 1.0), (SHIFT, exposure)))
    log_ratio, sure = ExposureNormalizer(LOG_RESPONSE, VIGNETTE).log_ratio(frame0, frame1)
    assert sure
    assert log_ratio == pytest.approx(np.log(exposure), abs=0.02)


@pytest.mark.parametrize("angle", [0.0, 12.0])
def test_displacements_that_grow_from_place_to_place_are_not_held_back(angle):
    """Forward motion and rotation cause such displacements, but dense registration favours uniform ones."""
    texture = cv2.GaussianBlur(np.random.default_rng(1).normal(0, 1, (SIZE[1], SIZE[0])), (0, 0), 4)
    image = np.clip(128 + 60 * texture / texture.std(), 0, 255).astype(np.uint8)
    centre = (np.array(SIZE) - 1) / 2
    to_second = cv2.getRotationMatrix2D(centre.tolist(), angle, 1.2)
    frames = (preprocessor()(of_array(view)) for view in (image, cv2.warpAffine(image, to_second, SIZE)))
    registration = DenseRegistration(SecondThread())(*frames, ExposureNormalizer(LOG_RESPONSE), 0.0)
    places = pixel_grid(SIZE)
    true = places @ to_second[:, :2].T + to_second[:, 2]
    radius = np.linalg.norm(places - centre, axis=-1)
    seen_well = np.all((true > 16) & (true < np.array(SIZE) - 17), axis=-1) & (radius > 80)
    error = np.linalg.norm(places + registration.forward - true, axis=-1)[seen_well]
    assert np.quantile(error, 0.9) < 0.3


@pytest.mark.parametrize("size", [(64, 48), (48, 48), (320, 240)])
def test_images_of_every_size_are_registered(size):
    """In a small image, few points are far enough apart to give independent evidence of its motion."""
    width, height = size
    texture = cv2.GaussianBlur(np.random.default_rng(2).normal(0, 1, (height, width + 2)), (0, 0), 2)
    image = np.clip(128 + 60 * texture / texture.std(), 0, 255).astype(np.uint8)
    frames = (preprocessor()(of_array(np.ascontiguousarray(view))) for view in (image[:, 2:], image[:, :-2]))
    registration = DenseRegistration(SecondThread())(*frames, ExposureNormalizer(LOG_RESPONSE), 0.0)
    assert registration is not None
    inner = registration.forward[8:-8, 8:-8]
    assert np.median(np.linalg.norm(inner - [2.0, 0.0], axis=-1)) < 0.3


@pytest.mark.parametrize("step", [7, 10])
def test_plain_objects_in_front_of_the_background_are_lost_where_their_motion_is_not_seen(step):
    """Both searches agree on the background's motion there, so the forward-backward error alone is small."""
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    views = []
    for left in (100, 100 + step):
        on_box = (x >= left) & (x < left + 60) & (y >= 70)
        grey = np.where(on_box, 0.3 + 0.001 * (x - left), RESPONSE(radiance_of(pixel_grid(SIZE))))
        views.append(preprocessor()(of_array(np.rint(255 * grey).astype(np.uint8))))
    registration = DenseRegistration(SecondThread())(*views, ExposureNormalizer(LOG_RESPONSE), 0.0)
    box = (slice(80, -10), slice(110, 150))
    wrong = np.linalg.norm(registration.forward[box] - [step, 0], axis=-1) > 1.5
    found = registration.forward_backward_error[box] < 2
    assert np.mean(wrong & found) < 0.04
    background = registration.forward_backward_error[:50, :60]
    assert np.mean(background < 2) > 0.95


def test_what_leaves_the_image_has_a_large_forward_backward_error():
    frame0, frame1 = (preprocessor()(seen(s, 1.0)) for s in (np.zeros(2), np.array([40.0, 0.0])))
    registration = DenseRegistration(SecondThread())(frame0, frame1, ExposureNormalizer(LOG_RESPONSE))
    gone = pixel_grid(SIZE)[20:-20, -24:-10].reshape(-1, 2)
    assert np.median(displacement_at(registration, gone, 1.0)[1]) > 5


def test_displacements_are_read_in_the_pixels_of_the_larger_image():
    grid = pixel_grid((40, 30)).astype(np.float32)
    # An affine displacement field makes interpolation between pixels exact.
    forward = grid * np.float32(0.1) + np.float32(1.0)
    registration = Registration(forward, np.full((30, 40), 0.25, np.float32))
    places = np.array([[10.0, 12.0], [31.5, 20.25]])
    displacement, forward_backward_error = displacement_at(registration, places, 2.0)
    in_small = (places + 0.5) / 2 - 0.5
    np.testing.assert_allclose(displacement, 2 * (0.1 * in_small + 1), atol=1e-2)
    np.testing.assert_allclose(forward_backward_error, 0.5, atol=1e-6)


@pytest.mark.parametrize("magnification", [0.8, 1.0, 1.3])
def test_slopes_of_places_are_those_of_a_turn_and_a_zoom_up_to_the_border(magnification):
    registration = zoomed(magnification, turned=0.3)
    jacobian = jacobian_at(registration, np.array([[1.0, 2.0], [320.0, 200.0], [638.0, 477.0]]), 2.0)
    turn = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    np.testing.assert_allclose(jacobian, np.broadcast_to(magnification * turn, (3, 2, 2)), atol=0.005)


@pytest.mark.parametrize("size", [(1224, 736), (1226, 735), (1227, 741)])
def test_displacements_of_reduced_frames_are_exact_though_a_remainder_is_cut_off(size):
    smooth = cv2.resize(np.random.default_rng(3).uniform(80, 160, (9, 15)).astype(np.float32), size)
    first, second = (preprocessor()(of_array(smooth.astype(np.uint8))) for _ in range(2))
    moved = np.array([12.0, -7.0], np.float32)
    height, width = first.small.shape
    registration = Registration(np.full((height, width, 2), moved), np.zeros((height, width), np.float32))
    sampler = flat_sampler(points_per_pair=10_000)
    found = sampler(sampler.keyframe(first), second, registration, 0).observations
    displacement = (found.position[1::2] - found.position[0::2]) * np.hypot(size[0] - 1, size[1] - 1) / 2
    expected = moved * first.further_reduction * first.reduction
    assert first.further_reduction > 1
    assert len(displacement) > 100
    np.testing.assert_allclose(displacement, np.broadcast_to(expected, displacement.shape), rtol=1e-6)


def test_any_number_of_points_is_interpolated():
    image = np.random.default_rng(0).uniform(0, 1, (40, 60)).astype(np.float32)
    places = np.random.default_rng(1).uniform(0, 39, (70_000, 1, 2)).astype(np.float32)
    found = values_at(image, places)
    for part in (slice(0, 100), slice(32_700, 32_800), slice(65_500, 65_600), slice(69_900, None)):
        np.testing.assert_array_equal(found[part], values_at(image, places[part]))


def test_the_brightest_pixels_stay_white_whatever_exposures_are_stated():
    frame0, frame1 = (preprocessor()(seen(np.zeros(2), e, noise=0)) for e in (1.0, 1.9))
    image0, _ = ExposureNormalizer(LOG_RESPONSE, VIGNETTE, trusts_stated=False)(frame0, frame1, 60.0)
    assert image0[frame0.small > 20].min() > 0


def test_slopes_of_places_follow_a_lens_that_magnifies_towards_the_border():
    places = pixel_grid(SIZE)
    there = cv2.perspectiveTransform(places, np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1e-3, 0.0, 1.0]]))
    registration = Registration((there - places).astype(np.float32), np.zeros(SIZE[::-1], np.float32))
    at = places[16::40, 16::40].reshape(-1, 2)
    (x, y), w = at.T, 1 + 1e-3 * at[:, 0]
    expected = np.stack([1 / w**2, 0 * x, -1e-3 * y / w**2, 1 / w], axis=1).reshape(-1, 2, 2)
    np.testing.assert_allclose(jacobian_at(registration, at, 1.0), expected, atol=0.01)


def zoomed(magnification, turned=0.0):
    """Return the true registration of a view with a copy magnified about the first pixel and turned."""
    turn = np.array([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]]) * magnification
    forward = pixel_grid(SIZE) @ (turn - np.eye(2)).T
    return Registration(forward.astype(np.float32), np.zeros(SIZE[::-1], np.float32))


# Sampling


def shifted_pair(shift=(6.0, -3.0), reduction=1, exposures=(1.0, 2.0)):
    """Return two views of a ramp and their true registration."""
    width, height = SIZE[0] * reduction, SIZE[1] * reduction
    maker = preprocessor(longest_side=SIZE[0], registration_side=SIZE[0])
    views = []
    for offset, exposure in zip((np.zeros(2), np.array(shift)), exposures, strict=True):
        at = pixel_grid((width, height)) / reduction - offset
        level = 0.1 + 0.0008 * at[..., 0] + 0.0006 * at[..., 1]
        frame = of_array(np.rint(level * exposure * 65535).astype(np.uint16), exposure, index=int(exposure * 5))
        views.append(maker(frame))
    forward = np.broadcast_to(np.array(shift, np.float32), (*SIZE[::-1], 2)).copy()
    return *views, Registration(forward, np.zeros(SIZE[::-1], np.float32))


def sampled(sampler, frame0, frame1, registration, group):
    return sampler(sampler.keyframe(frame0), frame1, registration, group)


@pytest.mark.parametrize("reduction", [1, 2])
def test_samples_are_the_same_scene_point_in_both_frames(reduction):
    frame0, frame1, registration = shifted_pair(reduction=reduction)
    samples = sampled(flat_sampler(points_per_pair=100_000), frame0, frame1, registration, 17)
    made = samples.observations
    assert len(made.starts) > 500
    assert np.all(made.counts == 2)
    size = np.array(frame0.size)
    first, second = made.position[::2], made.position[1::2]
    half = np.linalg.norm(size - 1) / 2
    np.testing.assert_allclose(
        (second - first) * half, np.tile(np.array([6.0, -3.0]) * reduction, (len(first), 1)), atol=1e-4
    )
    at = (first * half + (size - 1) / 2) / reduction
    level = 0.1 + 0.0008 * at[:, 0] + 0.0006 * at[:, 1]
    np.testing.assert_allclose(made.grey[::2], level, atol=5e-4)
    np.testing.assert_allclose(made.grey[1::2], 2 * level, atol=1e-3)
    np.testing.assert_allclose(made.gradient[::2], 0.001, atol=1e-4)
    np.testing.assert_array_equal(made.frame.reshape(-1, 2), [[5, 10]] * len(first))
    assert set(made.group) == {17}
    assert samples.overlap > 0.9
    radial = np.linalg.norm(first, axis=1) - np.linalg.norm(second, axis=1)
    assert samples.radial_motion == pytest.approx(np.sqrt(np.mean(radial**2)), rel=0.05)
    assert samples.motion_px == pytest.approx(reduction * np.hypot(6, 3), rel=1e-3)


@pytest.mark.parametrize("reduction", [1, 2])
@pytest.mark.parametrize("dark_share", [0.2, 0.8])
def test_samples_state_variance_and_third_moment_of_their_pixels(dark_share, reduction):
    """Each is estimated from the pixels under a Gaussian, as many as have its effect on the noise of the mean."""
    shape = (SIZE[1] * reduction, SIZE[0] * reduction)
    dark = np.random.default_rng(2).random(shape) < dark_share
    image = np.where(dark, 20_000, 23_000).astype(np.uint16)
    maker = preprocessor(longest_side=SIZE[0], registration_side=SIZE[0])
    frames = [maker(of_array(image, index=index)) for index in (0, 1)]
    still = Registration(np.zeros((*SIZE[::-1], 2), np.float32), np.zeros(SIZE[::-1], np.float32))
    made = sampled(flat_sampler(points_per_pair=100_000), *frames, still, 0).observations
    pixels, levels = 4 * np.pi * (DefaultSettings.smoothing_px * reduction) ** 2, image / 65535
    variance, third = moment(levels, 2, axis=None), moment(levels, 3, axis=None)
    assert made.grey_variance.mean() == pytest.approx(variance * (1 - 1 / pixels), rel=0.02)
    assert made.grey_third_moment.mean() == pytest.approx(third * (1 - 3 / pixels + 2 / pixels**2), rel=0.05)


@pytest.mark.parametrize("magnification", [0.75, 1.3, (0.75, 1.1), (1.0, 1.4)])
def test_a_magnified_extreme_is_read_as_if_it_were_not_magnified(magnification):
    """Smoothing over a fixed number of pixels covers less of a magnified view, so its extremes are more pronounced.

    An approaching floor is magnified more along one direction than along the other.
    """
    places = pixel_grid(SIZE)
    maker = preprocessor(longest_side=SIZE[0], registration_side=SIZE[0])
    views = [
        maker(of_array(np.rint(radiance_of(at) * 65535).astype(np.uint16), index=number))
        for number, at in enumerate((places, places / np.array(magnification)))
    ]
    made = sampled(flat_sampler(points_per_pair=100_000), *views, zoomed(magnification), 0).observations
    read = made.grey.reshape(-1, 2).T
    half = (np.array(SIZE) - 1) / 2
    at = [(made.position[i::2] * np.linalg.norm(half) + half).astype(np.float32) for i in (0, 1)]
    unchanged, around = (
        [cv2.remap(image, there, None, cv2.INTER_LINEAR)[:, 0] for image, there in zip(images, at, strict=True)]
        for images in ([view.grey for view in views], [cv2.GaussianBlur(view.grey, (0, 0), 6.0) for view in views])
    )
    contrast = read[0] - around[0]
    excess, excess_unchanged = (np.polyfit(contrast, second - first, 1)[0] for first, second in (read, unchanged))
    assert abs(excess_unchanged) > 0.03
    assert abs(excess) < abs(excess_unchanged) / 6


def test_steep_clipped_lost_and_outer_places_are_left_out():
    frame0, frame1, registration = shifted_pair(shift=(0.0, 0.0))
    frame0.gradient[:, :100] = 0.02
    frame1.gradient[:60] = 0.02
    frame1.clipped[180:] = True
    registration.forward_backward_error[:, 250:] = 5.0
    made = sampled(flat_sampler(points_per_pair=100_000), frame0, frame1, registration, 0).observations
    half = np.linalg.norm(np.array(SIZE) - 1) / 2
    x, y = (made.position * half + (np.array(SIZE) - 1) / 2).T
    assert len(x) > 100
    assert np.all((x >= 100) & (x < 250) & (y >= 60) & (y < 180))


def test_what_moves_out_of_the_image_is_not_sampled():
    frame0, frame1, registration = shifted_pair(shift=(60.0, 0.0), exposures=(1.0, 1.0))
    samples = sampled(flat_sampler(points_per_pair=100_000), frame0, frame1, registration, 0)
    outermost = samples.observations.position[:, 0].max() * np.linalg.norm(np.array(SIZE) - 1) / 2
    assert outermost <= SIZE[0] / 2 - SAMPLING_MARGIN_PX
    assert samples.overlap == pytest.approx(1 - 60 / (SIZE[0] - 2 * SAMPLING_MARGIN_PX), abs=0.03)


def test_nothing_in_common_makes_no_samples():
    frame0, frame1, registration = shifted_pair()
    lost = Registration(registration.forward, np.full_like(registration.forward_backward_error, 100.0))
    samples = sampled(flat_sampler(), frame0, frame1, lost, 0)
    assert len(samples.observations) == 0
    assert samples.overlap == samples.radial_motion == 0
    assert np.isnan(samples.motion_px)


@pytest.mark.parametrize("seed", range(6))
def test_views_of_different_scenes_make_no_samples(seed):
    """Registration finds matches in any two images; such chance similarity carries no information about exposures."""
    scenes = []
    for one in (2 * seed, 2 * seed + 1):
        noise = np.random.default_rng(one).random((240, 320))
        coarse, fine = (cv2.GaussianBlur(noise, (0, 0), sigma) for sigma in (20, 4))
        scenes.append(128 + 1200 * (coarse - 0.5) + 200 * (fine - 0.5))
    frame0, frame1 = (
        preprocessor()(of_array(np.clip(scene, 5, 250).astype(np.uint8), index=number))
        for number, scene in enumerate(scenes)
    )
    registration = DenseRegistration(SecondThread())(frame0, frame1, ExposureNormalizer(), 0.0)
    assert len(sampled(flat_sampler(), frame0, frame1, registration, 0).observations) == 0
    change = BrightnessComparer()(frame0.thumbnail, frame1.thumbnail).change
    assert not change.weight.any()
    assert np.isnan(change.motion_px)


def test_a_bounded_number_of_points_is_spread_over_grey_levels_and_does_not_change():
    frame0, frame1, registration = shifted_pair()
    everything = sampled(flat_sampler(points_per_pair=100_000), frame0, frame1, registration, 3).observations
    some = flat_sampler(points_per_pair=120)
    few, again = (sampled(some, frame0, frame1, registration, 3).observations for _ in range(2))
    assert len(few.starts) == 120
    np.testing.assert_array_equal(few.grey, again.grey)
    np.testing.assert_array_equal(few.position, again.position)
    assert set(map(tuple, few.position)) <= set(map(tuple, everything.position))
    other = sampled(some, frame0, frame1, registration, 4).observations
    assert set(map(tuple, few.position)) != set(map(tuple, other.position))
    share = [np.histogram(s.grey[::2], bins=4, range=(0.1, 0.5))[0] / len(s.starts) for s in (few, everything)]
    assert share[0].min() > share[1].min()


def test_views_do_not_depend_on_the_type_the_image_is_stored_in():
    image = np.random.default_rng(1).integers(0, 256, (60, 80)).astype(np.uint8)
    image = cv2.GaussianBlur(image, (0, 0), 2)
    narrow, wide = preprocessor()(of_array(image)), preprocessor()(of_array(image.astype(np.uint16), max_grey=255))
    np.testing.assert_allclose(narrow.grey, wide.grey, atol=1e-6)
    np.testing.assert_array_equal(narrow.small, wide.small)


def test_a_registration_that_does_not_exist_is_refused():
    with pytest.raises(SettingError, match="known: dense"):
        DefaultSettings(registration="sparse").build(SIZE, 255)
