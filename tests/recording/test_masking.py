"""Masks and regions of interest: no other pixels are used."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from image_samples import encoded, grey

from ospc.correspondence.exposure_normalizer import ExposureNormalizer
from ospc.correspondence.features import OrbExtractor, extract
from ospc.correspondence.registration import DenseRegistration
from ospc.correspondence.static_series import StaticSeries
from ospc.errors import SettingError
from ospc.pooling.summary import recording_key
from ospc.recording import ArrayRecording, identity
from ospc.recording.derived import DerivedRecording, Region, masked, read_mask
from ospc.system.second_thread import SecondThread
from workers import flat_sampler, preprocessor

SIZE = (160, 120)


def scene(seed: int = 0) -> np.ndarray:
    """Return an image with structure and uniform regions, 160×120."""
    noise = np.random.default_rng(seed).normal(0, 1, SIZE[::-1])
    return np.clip(128 + 250 * cv2.GaussianBlur(noise, (0, 0), 6), 10, 240).astype(np.uint8)


def recorded(frames: int = 2) -> ArrayRecording:
    return ArrayRecording([np.roll(scene(), (i, 2 * i), (0, 1)) for i in range(frames)], 2.0 ** np.arange(frames))


def half() -> np.ndarray:
    mask = np.ones(SIZE[::-1], bool)
    mask[:, : SIZE[0] // 2] = False
    return mask


def test_frames_carry_mask_and_region_and_images_stay_as_they_are() -> None:
    inner = recorded()
    recording = masked(inner, half(), Region(70, 10, 50, 30))
    expected = np.zeros(SIZE[::-1], bool)
    expected[10:40, 80:120] = True
    for frame, original in zip(recording, inner, strict=True):
        np.testing.assert_array_equal(frame.mask, expected)
        np.testing.assert_array_equal(frame.image, original.image)
    assert recording.size == SIZE
    assert "94% of every image is masked and not used" in recording.notes
    assert masked(inner) is inner


def test_a_mask_is_added_to_those_that_frames_have() -> None:
    recording = masked(masked(recorded(), half()), None, Region(70, 10, 50, 30))
    expected = np.zeros(SIZE[::-1], bool)
    expected[10:40, 80:120] = True
    for frame in recording:
        np.testing.assert_array_equal(frame.mask, expected)
    assert identity(recording)["images_sha256"] != identity(masked(recorded(), half()))["images_sha256"]


@pytest.mark.parametrize("longest", [160, 80])
def test_no_sample_of_two_views_rests_on_a_masked_pixel(longest: int) -> None:
    views = [preprocessor(longest_side=longest)(frame) for frame in masked(recorded(), half())]
    sample = flat_sampler(grid_spacing_px=4, max_gradient=1.0)
    registration = DenseRegistration(SecondThread())(*views, ExposureNormalizer())
    samples = sample(sample.keyframe(views[0]), views[1], registration, group=0).observations
    assert len(samples.grey) > 40
    x = samples.position[:, 0] * np.hypot(*SIZE) / 2 + SIZE[0] / 2
    assert x.min() > SIZE[0] / 2 + 2 * 160 / longest


def test_a_camera_that_stands_still_uses_no_masked_pixel() -> None:
    series = StaticSeries(points=100)
    for frame in masked(recorded(), half()):
        series.observe(frame)
    assert np.all(half().ravel()[series._places])
    assert len(series._places) == half().sum()


def test_features_lie_where_they_may() -> None:
    sharp = ArrayRecording([cv2.resize(grey(size=(20, 15)), SIZE, interpolation=cv2.INTER_NEAREST)], [1.0])
    frame = next(iter(masked(sharp, half())))
    found = extract(frame, OrbExtractor(500))
    assert len(found.points) == len(found.grey) == len(found.descriptors) > 0
    assert found.points[:, 0].min() >= SIZE[0] / 2 - 0.5


def test_with_a_mask_it_is_another_recording() -> None:
    whole = identity(recorded())
    other = identity(masked(recorded(), half()))
    assert whole["images_sha256"] != other["images_sha256"]
    assert whole["frames_sha256"] == other["frames_sha256"]


def test_with_a_mask_or_other_exposures_it_counts_as_the_same_recording_in_pools() -> None:
    whole, other = recorded(), recorded(frames=3)
    masks = masked(masked(whole, half()), region=Region(8, 8, 100, 100))
    in_seconds = DerivedRecording.of(masks, np.arange(len(whole)), whole.exposures_ms / 1000, note="seconds")
    keys = [recording_key("", identity(one)) for one in (whole, masks, in_seconds, other)]
    assert keys[0] == keys[1] == keys[2] != keys[3]


def test_a_mask_is_read_from_an_image(tmp_path: Path) -> None:
    path = tmp_path / "mask.png"
    path.write_bytes(encoded(half().astype(np.uint8) * 255))
    np.testing.assert_array_equal(read_mask(path, SIZE), half())


@pytest.mark.parametrize("quality", [50, 75, 95])
def test_blurred_edges_of_a_mask_in_jpeg_are_halved(quality: int, tmp_path: Path) -> None:
    row, column = np.mgrid[: SIZE[1], : SIZE[0]]
    usable = np.hypot(row - 60, column - 80) > 40
    path = tmp_path / "mask.jpg"
    path.write_bytes(cv2.imencode(".jpg", usable.astype(np.uint8) * 255, [cv2.IMWRITE_JPEG_QUALITY, quality])[1])
    edge = np.abs(np.hypot(row - 60, column - 80) - 40) < 1.5
    np.testing.assert_array_equal(read_mask(path, SIZE)[~edge], usable[~edge])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (encoded(grey(size=(8, 8))), "mask is 8×8 pixels, but frames are 160×120"),
        (b"not an image", "not PNG"),
        (b"", "empty"),
        (None, "cannot be read"),
    ],
)
def test_a_mask_that_is_none(content: bytes | None, words: str, tmp_path: Path) -> None:
    path = tmp_path / "mask.png"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SettingError, match=words):
        read_mask(path, SIZE)


def test_masking_every_pixel_is_refused() -> None:
    with pytest.raises(SettingError, match="leave 0 of the 160×120 pixels"):
        masked(recorded(), None, Region(50, 50, 10, 0))
    with pytest.raises(SettingError, match=r"has shape \(3, 3\)"):
        masked(recorded(), np.ones((3, 3), bool))


@pytest.mark.parametrize(
    "region", [Region(5, 5, 5000, 20), Region(0, 1, 160, 120), Region(500, 500, 10, 10), Region(-50, 0, 40, 120)]
)
def test_a_region_beyond_the_image_is_refused(region: Region) -> None:
    with pytest.raises(SettingError, match="are not inside the 160×120 of array; give a region of interest inside"):
        masked(recorded(), None, region)


@pytest.mark.parametrize(
    "text", ["1,2,3", "1,2,3,4,5", "a,b,c,d", "-1,2,3,4", "", "1;2;3;4", "1,2,3x4", "1,2,3,9999999999"]
)
def test_a_region_is_four_numbers(text: str) -> None:
    with pytest.raises(SettingError, match="x,y,width,height"):
        Region.parse(text)
    assert Region.parse(" 1, 2,3 ,4") == Region(1, 2, 3, 4)
