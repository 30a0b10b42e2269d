"""Frames created by users: accepted values are interpreted correctly, others refused with a clear error."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ospc.arrays import Image
from ospc.calibrator import OnlineCalibrator
from ospc.errors import ExposureError, FrameError
from ospc.live import LiveCalibrator
from ospc.recording import ArrayRecording, Frame
from ospc.recording.derived import masked

IMAGE = np.full((16, 24), 200, np.uint8)
DEEP = IMAGE.astype(np.uint16) * 16 + 15
FRAME = Frame.of_array(IMAGE, 1.0, index=0)


@pytest.mark.parametrize("kind", [int, np.int64, np.uint16, np.int32])
def test_the_largest_grey_value_may_be_of_numpy(kind: type) -> None:
    deep = IMAGE.astype(np.uint16)
    made = [Frame.of_array(deep, 1.0, max_grey=kind(4095)), replace(FRAME, max_grey=kind(4095))]
    made += ArrayRecording([deep], [1.0], max_grey=kind(4095))
    for frame in made:
        assert frame.max_grey == 4095
        assert type(frame.max_grey) is int


@pytest.mark.parametrize("value", [255.0, np.float64(255), "255", True, -5, 0, 70_000, np.int64(65_536)])
def test_what_is_no_largest_grey_value_is_refused(value: Any) -> None:
    for make in (
        lambda: Frame.of_array(IMAGE, 1.0, max_grey=value),
        lambda: replace(FRAME, max_grey=value),
        lambda: ArrayRecording([IMAGE], [1.0], max_grey=value),
    ):
        with pytest.raises(FrameError, match=r"max_grey is .*; give a whole number from 1 to 65535"):
            make()


@pytest.mark.parametrize(
    ("image", "value"), [(IMAGE, 1), (IMAGE, 199), (IMAGE, 4095), (DEEP, 255), (DEEP, 1023), (DEEP, 1606)]
)
def test_a_largest_grey_value_that_does_not_match_the_values_is_refused(image: Image, value: int) -> None:
    bits, most = 8 * image.itemsize, image.max()
    why = f"max_grey is {value}, which does not match {bits}-bit grey values up to {most}; give the largest"
    with pytest.raises(FrameError, match=why):
        Frame.of_array(image, 1.0, max_grey=value)
    with pytest.raises(FrameError, match=why):
        _ = next(iter(ArrayRecording([image], [1.0], max_grey=value))).image


def test_16_bit_values_up_to_twice_the_white_of_a_sensor_are_accepted() -> None:
    assert Frame.of_array(DEEP, 1.0, max_grey=1608).max_grey == 1608


def test_a_masked_array_is_refused() -> None:
    with pytest.raises(FrameError, match="frame 3: its image is a masked array; pass its data"):
        Frame.of_array(np.ma.masked_less(IMAGE, 1), 1.0, index=3)


def test_a_mask_may_be_an_image() -> None:
    shown = np.zeros(IMAGE.shape, np.uint8)
    shown[2:, 3:] = 255
    shown[2, 3] = 1
    (of_recording,) = masked(ArrayRecording([IMAGE], [1.0]), shown)
    for frame in (replace(FRAME, mask=shown), of_recording):
        assert frame.mask is not None
        assert frame.mask.dtype == bool
        np.testing.assert_array_equal(frame.mask, shown > 0)


@pytest.mark.parametrize("mask", [np.ones(IMAGE.shape), np.ones((*IMAGE.shape, 1), bool), np.ones(4, bool), "mask"])
def test_what_is_no_mask_is_refused(mask: Any) -> None:
    with pytest.raises(FrameError, match="frame 0: a mask must be a two-dimensional array of bool or uint8"):
        replace(FRAME, mask=mask)


@pytest.mark.parametrize("value", ["5.0", "5,0", b"5", [5.0], np.array([5.0]), 5j])
def test_an_exposure_that_is_no_number_is_refused(value: Any) -> None:
    for make in (
        lambda: Frame.of_array(IMAGE, value, index=7),
        lambda: replace(FRAME, name="frame 7", exposure_ms=value),
    ):
        with pytest.raises(ExposureError, match=r"^frame 7: exposure_ms is .*; give a number$"):
            make()


@pytest.mark.parametrize("value", [5, np.float32(5), np.array(5.0), np.uint8(5)])
def test_an_exposure_may_be_of_numpy(value: Any) -> None:
    for frame in (Frame.of_array(IMAGE, value), replace(FRAME, exposure_ms=value)):
        assert frame.exposure_ms == 5
        assert type(frame.exposure_ms) is float


@pytest.mark.parametrize("value", [None, "now", [0.0]])
def test_a_time_stamp_that_is_no_number_is_refused(value: Any) -> None:
    with pytest.raises(ExposureError, match=r"^frame 0: stamp_s is .*; give a number$"):
        replace(FRAME, stamp_s=value)


@pytest.mark.parametrize("value", [None, "a.png"])
def test_what_is_no_image_is_refused(value: Any) -> None:
    for make in (lambda: Frame.of_array(value, 1.0), lambda: replace(FRAME, load=lambda: value).image):
        with pytest.raises(FrameError, match=rf"^frame( 0)?: its image is {value}; give an array"):
            make()
    with pytest.raises(FrameError, match=r"^frame 0: load must be a function; .* Frame\.of_array$"):
        replace(FRAME, load=value)


def test_an_image_in_colour_or_of_another_type_is_refused_with_a_remedy() -> None:
    with pytest.raises(FrameError, match=r"shape \(\d+, \d+, 3\); pass one channel, such as image\[:, :, 1\]$"):
        Frame.of_array(np.dstack([IMAGE] * 3), 1.0)
    with pytest.raises(FrameError, match=r"not float32; pass them as the camera delivers them$"):
        Frame.of_array(IMAGE.astype(np.float32), 1.0)


def test_a_frame_whose_file_cannot_be_read_is_skipped() -> None:
    def load() -> Any:
        raise OSError(5, "Input/output error")

    calibrator = OnlineCalibrator()
    assert not calibrator.push(Frame(0, 0.0, 1.0, "a.png", load))
    assert calibrator.status.skipped == ("a.png: its image cannot be read ([Errno 5] Input/output error)",)


def test_a_frame_in_memory_may_have_a_mask() -> None:
    mask = IMAGE > 0
    assert Frame.of_array(IMAGE, 1.0, mask=mask).mask is mask


def test_the_order_of_bytes_does_not_matter() -> None:
    deep = IMAGE.astype(np.uint16) * 257
    frame = Frame.of_array(deep.astype(">u2"), 1.0)
    assert frame.image.dtype == np.uint16
    np.testing.assert_array_equal(frame.image, deep)


def test_a_largest_grey_value_that_most_of_the_range_does_not_reach_is_doubted() -> None:
    calibrator = OnlineCalibrator()
    for number in range(3):
        calibrator.push(Frame.of_array(np.tile(IMAGE, (4, 4)).astype(np.uint16) * 16, 1.0 + number))
    calibration = calibrator.calibration()
    why = "no grey value is above 3215 of 65535: give the largest one"
    assert calibration.verdicts["response"].remedy.startswith(why)
    assert calibration.advice[0].startswith(why)


@pytest.mark.parametrize(
    ("image", "max_grey", "why"),
    [
        (np.full((60, 80), 8000, np.uint16), 4095, "100% of all pixels are saturated"),
        (np.full((60, 80), 4095, np.uint16), 4095, "100% of all pixels are saturated"),
        (np.zeros((60, 80), np.uint8), None, "100% of all pixels are black"),
    ],
)
def test_of_clipped_images_only_that_is_said(image: np.ndarray, max_grey: int | None, why: str) -> None:
    calibrator = OnlineCalibrator()
    for number in range(3):
        calibrator.push(Frame.of_array(image, 1.0 + number, max_grey=max_grey))
    calibration = calibrator.calibration()
    assert all(verdict.remedy.startswith(why) for verdict in calibration.verdicts.values())
    assert calibration.advice[0].startswith(why)


def test_frames_without_an_index_are_named_by_their_number_in_the_run() -> None:
    calibrator = OnlineCalibrator()
    large = np.tile(IMAGE, (4, 4))
    for exposure_ms in (1.0, None, -1.0):
        calibrator.push(Frame.of_array(large, exposure_ms))
    calibrator.push(Frame.of_array(large, -1.0, index=7))
    assert [reason.split(":")[0] for reason in calibrator.status.skipped] == ["frame 1", "frame 2", "frame 7"]


@pytest.mark.parametrize("kind", [OnlineCalibrator, LiveCalibrator])
def test_what_is_no_frame_is_refused_and_the_run_goes_on(kind: type[OnlineCalibrator | LiveCalibrator]) -> None:
    calibrator = kind()
    for pushed in (IMAGE, (IMAGE, 1.0), None):
        with pytest.raises(FrameError, match=r"^frame 0: expected a Frame, not .*Frame\.of_array"):
            calibrator.push(pushed)  # type: ignore[arg-type]
    calibrator.push(replace(FRAME, load=lambda: None))  # type: ignore[arg-type, return-value]
    if isinstance(calibrator, LiveCalibrator):
        calibrator.wait()
        calibrator.close()
    assert calibrator.status.frames == 1
    assert "its image is None" in calibrator.first_reasons[0]
