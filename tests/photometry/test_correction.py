"""Correction recovers the light of images up to quantisation, for all depths and shapes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from log_polynomials import log_polynomial
from ospc.errors import ExposureError, FrameError, NotObservableError, SettingError
from ospc.photometry import look_up
from ospc.photometry.calibration import Calibration
from ospc.photometry.correction import Corrector
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette, RasterVignette
from ospc.simulation import SimulationSettings, frames, irradiances, truth

SIZE = (12, 8)
VIGNETTE = PolynomialVignette(SIZE, (-0.4, 0.1, -0.2))
FLAT = RasterVignette(np.ones((8, 12), np.float32))
LINEAR = Response(np.linspace(0, 1, 256))
STILL = SimulationSettings(size=(64, 48), frames=6, noise="none", motion="static", exposure="sweep")

seeds = st.integers(0, 2**32 - 1)
depths = st.sampled_from([8, 10, 12, 16])
exposures = st.floats(1e-3, 1e3)


def response_of(seed, levels=256):
    steps = np.random.default_rng(seed).uniform(0.05, 1.0, levels - 1)
    return Response.from_values(np.concatenate([[0.0], np.cumsum(steps)]))


def image_of(seed, max_grey=255, shape=(8, 12)):
    values = np.random.default_rng(seed).integers(0, max_grey, shape, endpoint=True)
    values.flat[:2] = 0, max_grey
    return values.astype(np.uint8 if max_grey < 256 else np.uint16)


# --- against the truth -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bits", [8, 12])
@pytest.mark.parametrize("name", ["gamma2.2", "linear", "tum_narrow", "filmic"])
@pytest.mark.parametrize("vignette", ["polynomial", "decentred"])
def test_corrected_frames_are_the_true_irradiance_to_quantisation(bits, name, vignette):
    settings = replace(STILL, bit_depth=bits, response=name, vignette=vignette, motion="handheld")
    known = truth(settings)
    attenuation = known.vignette.image().astype(float)
    calibration = Calibration(settings.size, known.response, known.vignette, max_grey=settings.max_grey)
    for frame, irradiance in zip(frames(settings), irradiances(settings), strict=True):
        corrected = calibration.correct(frame.image)
        seen = np.isfinite(corrected)
        np.testing.assert_array_equal(seen, ~calibration.saturated(frame.image))
        low, high = (
            known.response.inverse((frame.image + step) / settings.max_grey) / attenuation for step in (-0.51, 0.51)
        )
        true = irradiance / attenuation
        slack = 1e-6 + 1e-4 * true
        assert np.all(((low - slack <= true) & (true <= high + slack))[seen])
        assert np.all(((low - slack <= corrected) & (corrected <= high + slack))[seen])


def test_radiance_is_the_same_at_every_exposure():
    known = truth(STILL)
    corrector = Corrector(known.response, known.vignette)
    radiances = [
        corrector.correct(frame.image, e) for frame, e in zip(frames(STILL), known.exposures_ms, strict=True)
    ]
    true = next(iter(irradiances(STILL))) / known.vignette.image() / known.exposures_ms[0]
    assert known.exposures_ms.max() > 50 * known.exposures_ms.min()
    bright = [np.isfinite(r) & (frame.image > 60) for r, frame in zip(radiances, frames(STILL), strict=True)]
    for radiance, used in zip(radiances, bright, strict=True):
        np.testing.assert_allclose(radiance[used], true[used], rtol=0.03)
    assert sum(np.count_nonzero(used) for used in bright) > 5000


def test_warped_frames_are_the_frames_at_that_exposure_to_quantisation():
    known = truth(STILL)
    corrector = Corrector(known.response, None)
    images = [frame.image for frame in frames(STILL)]
    e = known.exposures_ms
    for i, j in [(0, 1), (2, 3), (4, 3), (3, 1)]:
        warped = corrector.warp_exposure(images[i], e[i], e[j])
        both = ~corrector.saturated(images[i]) & (images[i] > 25)
        # tolerance: half a grey value of the first image, mapped by the response, and half a grey value of the second
        low, high = (
            255 * known.response(known.response.inverse((images[i] + half) / 255) * e[j] / e[i])
            for half in (-0.51, 0.51)
        )
        assert np.all((images[j] >= low - 1.01)[both] & (images[j] <= high + 1.01)[both])
        assert np.all((warped >= low - 0.51)[both] & (warped <= high + 0.51)[both])


# --- against the formula, computed independently -----------------------------------------------------------------


@given(seeds, depths, st.one_of(st.none(), exposures))
def test_float_output_is_the_formula(seed, bits, exposure_ms):
    max_grey = 2**bits - 1
    response, image = response_of(seed), image_of(seed, max_grey)
    corrected = Corrector(response, VIGNETTE, max_grey).correct(image, exposure_ms, mark_saturated=False)
    expected = response.inverse(image / max_grey) / VIGNETTE.image() / (exposure_ms or 1.0)
    assert corrected.dtype == np.float32
    np.testing.assert_allclose(corrected, expected, rtol=1e-6)


@given(seeds, depths, st.sampled_from([np.uint8, np.uint16]), st.floats(0.2, 4.0), st.booleans())
def test_integer_output_is_the_float_output_scaled_and_rounded(seed, bits, dtype, white, flat):
    max_grey = 2**bits - 1
    corrector = Corrector(response_of(seed), FLAT if flat else VIGNETTE, max_grey)
    image, limit = image_of(seed, max_grey), np.iinfo(dtype).max
    corrected = corrector.correct(image, dtype=dtype, white=white, mark_saturated=False)
    expected = corrector.correct(image, mark_saturated=False).astype(float) * limit / white
    assert corrected.dtype == dtype
    np.testing.assert_allclose(corrected, np.minimum(expected, limit), atol=0.5 + limit * 1e-6, rtol=0)


@given(seeds, st.sampled_from([8, 12]), st.sampled_from([np.float32, np.uint8, np.uint16]))
def test_channels_are_corrected_one_by_one(seed, bits, dtype):
    max_grey = 2**bits - 1
    image = image_of(seed, max_grey, (8, 12, 3))
    responses = tuple(response_of(seed + k) for k in range(3))
    shared = Corrector(responses[0], VIGNETTE, max_grey).correct(image, 2.0, dtype=dtype)
    own = Corrector(responses, VIGNETTE, max_grey).correct(image, 2.0, dtype=dtype)
    for k in range(3):
        channel = np.ascontiguousarray(image[..., k])
        np.testing.assert_array_equal(
            shared[..., k], Corrector(responses[0], VIGNETTE, max_grey).correct(channel, 2.0, dtype=dtype)
        )
        np.testing.assert_array_equal(
            own[..., k], Corrector(responses[k], VIGNETTE, max_grey).correct(channel, 2.0, dtype=dtype)
        )


@given(seeds, exposures, st.floats(0.1, 10.0))
def test_radiance_is_inversely_proportional_to_the_exposure(seed, exposure_ms, factor):
    corrector, image = Corrector(response_of(seed), VIGNETTE), image_of(seed)
    once = corrector.correct(image, exposure_ms)
    np.testing.assert_allclose(corrector.correct(image, exposure_ms * factor) * factor, once, rtol=1e-5)


@given(seeds, depths)
def test_no_vignette_and_a_linear_response_change_nothing(seed, bits):
    max_grey = 2**bits - 1
    image = image_of(seed, max_grey)
    identity = Corrector(LINEAR, FLAT, max_grey)
    if bits in (8, 16):
        np.testing.assert_array_equal(identity.correct(image, dtype=image.dtype), image)
    np.testing.assert_allclose(identity.correct(image, mark_saturated=False), image / max_grey, rtol=1e-6)


def test_layout_of_the_memory_does_not_matter():
    image = image_of(3, 4095, (16, 24))
    corrector = Corrector(response_of(1), VIGNETTE, 4095)
    np.testing.assert_array_equal(
        corrector.correct(image[::2, ::2]), corrector.correct(np.ascontiguousarray(image[::2, ::2]))
    )
    read_only = image[:8, :12].copy()
    np.testing.assert_array_equal(corrector.correct(read_only.astype(">u2")), corrector.correct(read_only))
    read_only.setflags(write=False)
    before = read_only.copy()
    corrector.correct(read_only, dtype=np.uint8)
    corrector.warp_exposure(read_only, 1.0, 2.0)
    np.testing.assert_array_equal(read_only, before)


@given(seeds, st.sampled_from([(8, 12), (8, 12, 3)]))
def test_releases_of_opencv_without_16_bit_tables_give_the_same(seed, shape):
    image = image_of(seed, 65535, shape)
    table = np.random.default_rng(seed).random((65536, 3 if len(shape) == 3 else 1)).astype(np.float32)
    plain = table[image, range(3)] if len(shape) == 3 else table[image, 0]
    np.testing.assert_array_equal(look_up._look_up_16_bit(image, table[None]), plain)
    np.testing.assert_array_equal(look_up.look_up(image, table), plain)


# --- saturation and missing parts --------------------------------------------------------------------------------


@pytest.mark.parametrize("max_grey", [255, 4095])
def test_saturated_pixels_are_marked_and_no_others(max_grey):
    image = image_of(5, max_grey)
    corrector = Corrector(response_of(2), VIGNETTE, max_grey)
    saturated = image == max_grey
    np.testing.assert_array_equal(corrector.saturated(image), saturated)
    np.testing.assert_array_equal(np.isnan(corrector.correct(image)), saturated)
    for dtype in (np.uint8, np.uint16):
        # a long exposure makes the bound small, so only marked pixels have the maximum
        assert np.all(corrector.correct(image, 50.0, dtype=dtype)[saturated] == np.iinfo(dtype).max)
        assert np.all(corrector.correct(image, 50.0, dtype=dtype, mark_saturated=False) < np.iinfo(dtype).max)
    bound = corrector.correct(image, mark_saturated=False)
    np.testing.assert_allclose(bound[saturated], 1 / VIGNETTE.image()[saturated], rtol=1e-6)


@pytest.mark.parametrize(("white", "max_grey"), [(234, 255), (3800, 4095)])
def test_the_white_level_of_a_limited_range_is_saturated(white, max_grey):
    response = Response.gamma(2.2, 256)
    limited = replace(response, model=response.model | {"grey_range": [0.0, white / max_grey]})
    corrector = Corrector(limited, None, max_grey, assume_missing=True)
    image = np.arange(max_grey + 1).astype(np.uint8 if max_grey == 255 else np.uint16)[None]
    saturated = image >= white
    np.testing.assert_array_equal(corrector.saturated(image), saturated)
    np.testing.assert_array_equal(np.isnan(corrector.correct(image)), saturated)
    assert np.all(corrector.warp_exposure(image, 1.0, 1.0)[saturated] == max_grey)
    colour = Corrector([limited, response, limited], None, max_grey, assume_missing=True)
    np.testing.assert_array_equal(colour.saturated(np.repeat(image[..., None], 3, axis=2))[..., 1], image >= max_grey)


def test_values_beyond_the_largest_grey_value_are_saturated():
    image = np.full((8, 12), 4090, np.uint16)
    assert np.isnan(Corrector(LINEAR, VIGNETTE, 4000).correct(image)).all()
    assert np.all(Corrector(LINEAR, None, 4000).warp_exposure(image, 2.0, 1.0) == 4000)


def test_pixels_without_light_are_not_corrected():
    values = np.ones((8, 12), np.float32)
    values[0, :3] = 0.0, 0.5e-3, 1.5e-3
    corrector = Corrector(LINEAR, RasterVignette(values))
    image = np.full((8, 12), 200, np.uint8)
    image[0, 3] = 255
    corrected = corrector.correct(image)
    assert np.isnan(corrected[0]).tolist() == [True, True, False, True] + 8 * [False]
    for dtype in (np.uint8, np.uint16):
        limit = np.iinfo(dtype).max
        assert corrector.correct(image, dtype=dtype)[0, :4].tolist() == [0, 0, limit, limit]


@given(seeds, st.floats(1e-8, 1e8), st.sampled_from([np.uint8, np.uint16]))
def test_nothing_overflows_into_darkness(seed, exposure_ms, dtype):
    values = np.linspace(2e-3, 1.0, 96, dtype=np.float32).reshape(8, 12)
    corrector = Corrector(response_of(seed), RasterVignette(values))
    image = image_of(seed)
    exact = corrector.correct(image, exposure_ms).astype(float) * np.iinfo(dtype).max
    corrected = corrector.correct(image, exposure_ms, dtype=dtype)
    expected = np.where(np.isnan(exact), np.iinfo(dtype).max, np.minimum(exact, np.iinfo(dtype).max))
    np.testing.assert_allclose(corrected, expected, atol=0.6, rtol=1e-6)


@pytest.mark.parametrize(("response", "vignette", "part"), [(None, VIGNETTE, "response"), (LINEAR, None, "vignette")])
def test_an_unknown_part_is_refused_by_name_unless_it_is_to_be_assumed(response, vignette, part):
    calibration, image = Calibration(SIZE, response, vignette), image_of(0)
    with pytest.raises(NotObservableError, match=f"no {part}"):
        calibration.correct(image)
    assumed = calibration.correct(image, assume_missing=True)
    whole = Calibration(SIZE, response or LINEAR, vignette or FLAT).correct(image)
    np.testing.assert_allclose(assumed, whole, rtol=1e-6)
    assert Corrector(response, vignette, assume_missing=True).assumed == (part,)
    assert Corrector(LINEAR, VIGNETTE, assume_missing=True).assumed == ()
    if part == "response":
        with pytest.raises(NotObservableError, match="no response"):
            calibration.warp_exposure(image, 1.0, 2.0)
    else:
        calibration.warp_exposure(image, 1.0, 2.0)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_integers_without_a_vignette(dtype):
    image, limit = image_of(0), np.iinfo(dtype).max
    corrected = Corrector(LINEAR, None, assume_missing=True).correct(image, dtype=dtype, white=0.5)
    np.testing.assert_allclose(corrected, np.minimum(image / 255 * 2 * limit, limit), atol=0.51)


# --- warping -----------------------------------------------------------------------------------------------------


@given(seeds, depths, exposures)
def test_warping_to_the_same_exposure_changes_nothing(seed, bits, exposure_ms):
    max_grey = 2**bits - 1
    image = image_of(seed, max_grey)
    warped = Corrector(response_of(seed), None, max_grey).warp_exposure(image, exposure_ms, exposure_ms)
    assert warped.dtype == image.dtype
    np.testing.assert_array_equal(warped, image)


@given(seeds, st.floats(0.3, 3.0), st.floats(0.3, 3.0))
def test_warping_twice_is_warping_once_to_quantisation(seed, first, second):
    response = response_of(seed)
    corrector = Corrector(response, None, 65535)
    image = image_of(seed, 65535)
    middle = corrector.warp_exposure(image, 1.0, first)
    twice = corrector.warp_exposure(middle, first, first * second)
    once = corrector.warp_exposure(image, 1.0, first * second)
    exact = ~corrector.saturated(middle)
    # the largest slope of g is at most 20 times its smallest slope
    assert np.all(np.abs(twice.astype(int) - once)[exact] <= 1 + 20 * 3)
    assert np.all(twice[~exact] == 65535)


@given(seeds, st.floats(0.1, 10.0))
def test_a_longer_exposure_is_nowhere_darker_and_order_is_kept(seed, ratio):
    corrector, image = Corrector(response_of(seed), None), np.arange(255, dtype=np.uint8)[None]
    warped = corrector.warp_exposure(image, 1.0, ratio).astype(int)
    assert np.all(np.diff(warped) >= 0)
    assert np.all(warped >= image) if ratio >= 1 else np.all(warped <= image)
    assert warped[0, 0] == 0


def test_what_was_saturated_stays_so_and_what_becomes_so_is_marked():
    corrector = Corrector(Response.gamma(2.0), None)
    image = np.array([[100, 179, 181, 255]], np.uint8)
    brighter = corrector.warp_exposure(image, 1.0, 2.0)
    assert corrector.saturated(brighter).tolist() == [[False, False, True, True]]
    assert corrector.warp_exposure(image, 2.0, 1.0).tolist() == [[71, 127, 128, 255]]


# --- invalid input -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("image", "complaint"),
    [
        (np.zeros((8, 12), np.float32), "uint8 or uint16"),
        (np.zeros((8, 12), np.int16), "uint8 or uint16"),
        (np.zeros((8, 12, 4), np.uint8), "three channels"),
        (np.zeros(96, np.uint8), "three channels"),
        (np.zeros((0, 12), np.uint8), "shape"),
        (np.full((8, 12), 256, np.uint16), "max_grey"),
    ],
)
def test_what_is_no_such_image_is_refused(image, complaint):
    corrector = Corrector(LINEAR, VIGNETTE)
    for use in (corrector.correct, corrector.saturated, lambda i: corrector.warp_exposure(i, 1.0, 2.0)):
        with pytest.raises(FrameError, match=complaint):
            use(image)


@pytest.mark.parametrize("bits", [10, 12, 14])
@pytest.mark.parametrize("top", [0.02, 1.0])
def test_left_aligned_images_are_refused_and_right_aligned_ones_corrected(bits, top):
    max_grey = 2**bits - 1
    image = image_of(1, int(top * max_grey)).astype(np.uint16)
    corrector = Corrector(LINEAR, VIGNETTE, max_grey)
    corrected = corrector.correct(image, mark_saturated=False)
    np.testing.assert_allclose(corrected, image / max_grey / VIGNETTE.image(), rtol=1e-6)
    left = image << (16 - bits)
    for use in (
        corrector.correct,
        corrector.without_vignette,
        corrector.saturated,
        lambda i: corrector.warp_exposure(i, 1.0, 2.0),
    ):
        with pytest.raises(FrameError, match=rf"left-aligned.*multiples of .*image >> {16 - bits}"):
            use(left)


@pytest.mark.parametrize("white", [1e-11, 1e-3, 1e3])
def test_without_vignette_brighter_pixels_never_become_darker(white):
    ramp = np.arange(256, dtype=np.uint8)[None]
    flat = RasterVignette(np.ones((1, 256), np.float32))
    levels = Corrector(Response.gamma(2.2), flat).without_vignette(ramp, 10.0, white=white)
    assert np.all(np.diff(levels[0].astype(int)) >= 0)


def test_values_with_more_bits_than_the_calibration_are_refused():
    with pytest.raises(FrameError, match="does not match this uint16 image"):
        Corrector(LINEAR, VIGNETTE, 4095).correct(image_of(0, 4097))


@pytest.mark.parametrize("grey", [0, 64, 4080])
def test_blank_images_do_not_look_left_aligned(grey):
    image = np.full((8, 12), grey, np.uint16)
    np.testing.assert_allclose(Corrector(LINEAR, VIGNETTE, 4095).correct(image), grey / 4095 / VIGNETTE.image())


def test_depths_are_not_guessed():
    deep = Calibration(SIZE, LINEAR, VIGNETTE, max_grey=4095)
    with pytest.raises(FrameError, match="max_grey"):
        deep.correct(image_of(0))
    np.testing.assert_array_equal(
        deep.correct(image_of(0), max_grey=255), Calibration(SIZE, LINEAR, VIGNETTE).correct(image_of(0))
    )
    words = image_of(0).astype(np.uint16)
    np.testing.assert_array_equal(
        Corrector(LINEAR, VIGNETTE).correct(words), Corrector(LINEAR, VIGNETTE).correct(image_of(0))
    )


@pytest.mark.parametrize("exposure_ms", [0.0, -1.0, np.nan, np.inf, 1e-12, "8", [8.0, 9.0]])
def test_what_is_no_exposure_is_refused(exposure_ms):
    corrector = Corrector(LINEAR, VIGNETTE)
    for use in (
        lambda: corrector.correct(image_of(0), exposure_ms),
        lambda: corrector.warp_exposure(image_of(0), exposure_ms, 1.0),
        lambda: corrector.warp_exposure(image_of(0), 1.0, exposure_ms),
    ):
        with pytest.raises(ExposureError):
            use()


def test_impossible_options_are_refused():
    corrector = Corrector(LINEAR, VIGNETTE)
    for dtype in (np.float64, "png"):
        with pytest.raises(SettingError, match="dtype"):
            corrector.correct(image_of(0), dtype=dtype)
    for white in (0.0, -1.0, np.nan, np.inf, None, "1", [1.0, 2.0]):
        with pytest.raises(SettingError, match="white"):
            corrector.correct(image_of(0), dtype=np.uint8, white=white)
    for max_grey in (0, 65536):
        with pytest.raises(SettingError, match="max_grey"):
            Corrector(LINEAR, VIGNETTE, max_grey)
    with pytest.raises(SettingError, match="2 responses"):
        Corrector((LINEAR, LINEAR), VIGNETTE)
    with pytest.raises(SettingError, match="must be a Response"):
        Corrector((LINEAR, LINEAR, "sRGB"), VIGNETTE)
    with pytest.raises(FrameError, match="grey"):
        Corrector((LINEAR, LINEAR, LINEAR), VIGNETTE).correct(image_of(0))


def test_a_vignette_above_one_off_the_centre_leaves_saturation_marked():
    vignette = log_polynomial(SIZE, (-0.5,), (0.9, 0.0))
    off_centre = log_polynomial(SIZE, (0.8,))
    for chosen in (vignette, off_centre):
        white = Corrector(LINEAR, chosen).correct(np.full((8, 12), 255, np.uint8), dtype=np.uint8)
        assert np.all(white == 255)


@pytest.mark.parametrize(
    ("size", "remedy"),
    [
        ((32, 24), "adapt it with 'ospc export --to json --size 32x24'"),
        ((48, 64), "turn the images"),
        ((64, 20), "if they are cropped, adapt it with 'ospc export --to json --crop X,Y,W,H'"),
    ],
)
def test_another_size_is_refused_with_the_remedy_for_what_may_have_happened_to_the_images(
    size: tuple[int, int], remedy: str
):
    corrector = Corrector(LINEAR, PolynomialVignette((64, 48), (-0.3,)))
    with pytest.raises(SettingError, match=f"the calibration is for 64×48; {remedy}"):
        corrector.correct(np.zeros(size[::-1], np.uint8))


def test_the_response_of_each_channel_must_be_known_or_assumed():
    colour = np.full((8, 12, 3), 100, np.uint8)
    with pytest.raises(NotObservableError, match="has no response"):
        Corrector((LINEAR, None, LINEAR), VIGNETTE).correct(colour)
    assuming = Corrector((LINEAR, None, LINEAR), VIGNETTE, assume_missing=True)
    assert assuming.assumed == ("response",)
    np.testing.assert_array_equal(assuming.correct(colour), Corrector(LINEAR, VIGNETTE).correct(colour))
