"""Black and white levels of a recording, as determined from frame to frame and from epoch to epoch."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.stats import norm

from ospc import Frame
from ospc.correspondence.pixel_statistics import PixelStatistics
from ospc.photometry.grey_range import FULL_RANGE, VIDEO_RANGE, GreyRange
from ospc.settings.grey_values import MAX_COUNTED_FRAMES
from ospc.settings.registration import SURROUND_SIGMAS
from workers import preprocessor

LIMITED, FULL = (16, 235), (0, 255)
PREPROCESS = preprocessor()


def observed(statistics: PixelStatistics, number: int, low: int, high: int, *, piled: bool = True) -> None:
    """Observe an image with grey values from low to high, and many pixels at both ends if ``piled``."""
    level = np.random.default_rng(number).beta(2, 2, (192, 256))  # the extreme values are rare
    image = (low + np.rint((high - low) * level)).astype(np.uint8)
    if piled:
        image[:32], image[-32:] = low, high
    frame = Frame.of_array(image, 1.0, index=number)
    statistics.observe(frame, PREPROCESS.thumbnail(frame))


def test_what_was_known_at_each_frame_is_remembered() -> None:
    statistics = PixelStatistics()
    for number, ends in enumerate([LIMITED, LIMITED, FULL, FULL]):
        observed(statistics, number, *ends)
    assert [statistics.grey_range_before(n) for n in range(5)] == [FULL_RANGE, *[VIDEO_RANGE] * 2, *[FULL_RANGE] * 2]
    assert statistics.grey_range == FULL_RANGE


@pytest.mark.parametrize(("black", "white"), [(0, 60), (0, 110), (0, 200), (0, 250), (0, 253), (2, 255), (5, 252)])
@pytest.mark.parametrize("piled", [True, False])
def test_black_and_white_are_wherever_grey_values_pile_up(black: int, white: int, piled: bool) -> None:
    statistics = PixelStatistics()
    observed(statistics, 0, black, white, piled=piled)
    assert statistics.grey_range == (GreyRange(black / 255, white / 255) if piled else FULL_RANGE)


@pytest.mark.parametrize("step", [8, 16, 32])
def test_the_outermost_of_few_grey_values_stand_for_black_and_white(step: int) -> None:
    statistics = PixelStatistics()
    image = np.random.default_rng(0).integers(0, 255, (48, 64), endpoint=True)
    frame = Frame.of_array((image // step * step + step // 2).astype(np.uint8), 1.0)
    statistics.observe(frame, PREPROCESS.thumbnail(frame))
    assert statistics.grey_range == FULL_RANGE


@pytest.mark.parametrize("step", [2, 4, 8, 16])
def test_the_highest_of_few_grey_values_is_white_if_many_pixels_are_clipped_there(step: int) -> None:
    """In a camera of 6 bits, stored in 8, clipped pixels have the value 252 of 255."""
    statistics = PixelStatistics()
    image = np.random.default_rng(0).normal(150, 80, (48, 64)).clip(0, 255).astype(np.uint8) // step * step
    frame = Frame.of_array(image, 1.0)
    statistics.observe(frame, PREPROCESS.thumbnail(frame))
    white = 256 - step
    assert statistics.grey_range == (GreyRange(0.0, white / 255) if white < 254 else FULL_RANGE)


@pytest.mark.parametrize("split", [0.2, 0.5, 0.8])
def test_statistics_of_long_recordings_represent_all_frames_equally(split: float) -> None:
    statistics, frames = PixelStatistics(), 4 * MAX_COUNTED_FRAMES
    dark, bright = (Frame.of_array(np.full((32, 32), grey, np.uint8), 1.0) for grey in (40, 200))
    thumbnails = {id(frame): PREPROCESS.thumbnail(frame) for frame in (dark, bright)}
    for number in range(frames):
        frame = dark if number < split * frames else bright
        statistics.observe(frame, thumbnails[id(frame)])
    report = statistics.report()
    assert report is not None
    share_of_bright = report.grey_share[:, 16:].sum(axis=1).mean()
    np.testing.assert_allclose(share_of_bright, 1 - split, atol=0.01)


@pytest.mark.parametrize(("before", "after"), [(LIMITED, FULL), (FULL, LIMITED)])
def test_a_new_epoch_finds_its_own(before: tuple[int, int], after: tuple[int, int]) -> None:
    statistics = PixelStatistics()
    observed(statistics, 0, *before)
    known = statistics.grey_range
    later = statistics.of_next_epoch()
    observed(later, 1, *after)
    assert {known, later.grey_range} == {VIDEO_RANGE, FULL_RANGE}
    assert later.grey_range_before(1) == known


@pytest.mark.parametrize(("low", "high", "expected"), [(20, 230, VIDEO_RANGE), (5, 230, FULL_RANGE)])
def test_a_new_epoch_keeps_them_until_something_is_darker_or_brighter(
    low: int, high: int, expected: GreyRange
) -> None:
    statistics = PixelStatistics()
    observed(statistics, 0, *LIMITED)
    later = statistics.of_next_epoch()
    assert later.grey_range == VIDEO_RANGE
    observed(later, 1, low, high, piled=False)
    assert later.grey_range == expected


@pytest.mark.parametrize("white", [200, 236, 255])
def test_white_pixels_are_counted_wherever_white_is(white: int) -> None:
    image = np.full((240, 320), 100, np.uint8)
    image[:, :80] = white
    prepared = PREPROCESS(Frame.of_array(image, 1.0, index=0, max_grey=255), GreyRange(0.0, white / 255))
    assert prepared.moments[-1] == pytest.approx(0.25, abs=0.01)
    places = np.array([[20.0, 120.0], [100.0, 120.0], [300.0, 120.0]])
    for sigma, moments in zip(SURROUND_SIGMAS, prepared.surround_moments, strict=True):
        end, edge, begin = (norm.cdf((x - 0.5 - places[:, 0]) / (320 * sigma)) for x in (320, 80, 0))
        found = prepared.values_at(moments, places)
        assert found[:, -1] / found[:, 0] == pytest.approx((edge - begin) / (end - begin), abs=0.02)


@pytest.mark.parametrize("white", [200, 236])
def test_saturated_places_are_not_compared_wherever_white_is(white: int) -> None:
    image = np.full((240, 320), 100, np.uint8)
    image[:, :80] = white
    frame = Frame.of_array(image, 1.0, index=0, max_grey=255)
    exposed = PREPROCESS.thumbnail(frame, GreyRange(0.0, white / 255)).exposed
    columns = exposed.shape[1]
    assert not exposed[:, : columns // 4].any()
    assert exposed[:, columns // 4 + 4 :].all()
    assert PREPROCESS.thumbnail(frame).exposed.all()


def film_with_scattered_white(white: int, scatter: float, exposures_ms: list[float]) -> PixelStatistics:
    """Return the statistics of a bright scene, clipped at ``white`` before noise of ``scatter`` is added."""
    random = np.random.default_rng(0)
    radiance = 60 * np.exp(random.normal(0, 1, (96, 128)))
    statistics = PixelStatistics()
    for number, exposure_ms in enumerate(exposures_ms):
        clipped = np.minimum(radiance * exposure_ms, white) + random.normal(0, scatter, radiance.shape)
        frame = Frame.of_array(np.clip(np.rint(clipped), 0, 255).astype(np.uint8), exposure_ms, index=number)
        statistics.observe(frame, PREPROCESS.thumbnail(frame))
    return statistics


@pytest.mark.parametrize("white", [220, 235, 248])
@pytest.mark.parametrize("scatter", [0.5, 1.0, 1.7])
@pytest.mark.parametrize("exposures_ms", [[1.0, 2.0, 4.0], [0.5, 1.0, 1.02]])
def test_white_may_scatter(white: int, scatter: float, exposures_ms: list[float]) -> None:
    found = film_with_scattered_white(white, scatter, exposures_ms).grey_range
    assert found.black == 0
    assert white - 2 * scatter - 1 <= 255 * found.white <= white


def film_of_a_wall(exposures_ms: list[float], shading: float) -> PixelStatistics:
    """Return the statistics of frames of a bright wall in front of a dark scene, which are never clipped."""
    random = np.random.default_rng(0)
    radiance = 20 * np.exp(random.normal(0, 0.5, (96, 128)))
    radiance[:40] = 50 * (1 - shading * random.random((40, 128)))
    statistics = PixelStatistics()
    for number, exposure_ms in enumerate(exposures_ms):
        noisy = np.rint(np.minimum(radiance * exposure_ms, 255) + random.normal(0, 1, radiance.shape))
        frame = Frame.of_array(np.clip(noisy, 0, 255).astype(np.uint8), exposure_ms, index=number)
        statistics.observe(frame, PREPROCESS.thumbnail(frame))
    return statistics


@pytest.mark.parametrize("exposures_ms", [[4.0], [1.0, 2.0, 4.0], [2.0, 4.0, 4.0, 4.1]])
@pytest.mark.parametrize("shading", [0.0, 0.02])
def test_a_wall_is_not_white(exposures_ms: list[float], shading: float) -> None:
    assert film_of_a_wall(exposures_ms, shading).grey_range == FULL_RANGE


@pytest.mark.parametrize("white", [200, 230, 245])
@pytest.mark.parametrize("quality", [75, 92])
def test_compression_may_raise_values_beyond_white(white: int, quality: int) -> None:
    random = np.random.default_rng(0)
    radiance = 60 * np.exp(3 * cv2.GaussianBlur(random.normal(0, 4, (192, 256)), (0, 0), 4))
    statistics = PixelStatistics()
    for number, exposure_ms in enumerate([1.0, 2.0, 4.0]):
        clipped = np.minimum(radiance * exposure_ms, white) + random.normal(0, 1, radiance.shape)
        image = np.clip(np.rint(clipped), 0, white).astype(np.uint8)
        _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
        decoded = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
        assert decoded.max() > white + 3
        frame = Frame.of_array(decoded, exposure_ms, index=number)
        statistics.observe(frame, PREPROCESS.thumbnail(frame))
    assert white - 3 <= 255 * statistics.grey_range.white <= white
