"""Recordings in memory."""

from __future__ import annotations

import numpy as np
import pytest
from image_samples import grey

from ospc.errors import ExposureError, FrameError, RecordingError
from ospc.recording import ArrayRecording, Recording

IMAGES = np.stack([grey(i) for i in range(3)])


def test_frames_share_memory_with_the_array() -> None:
    recording: Recording = ArrayRecording(IMAGES, [1, 2, 4], [0.0, 0.1, 0.2])
    assert (recording.kind, recording.size, recording.max_grey, len(recording)) == ("array", (24, 16), 255, 3)
    for index, frame in enumerate(recording):
        assert np.shares_memory(frame.image, IMAGES)
        np.testing.assert_array_equal(frame.image, IMAGES[index])
        assert (frame.index, frame.exposure_ms, frame.stamp_s) == (index, 2.0**index, index / 10)


def test_a_list_of_images_is_as_good_as_an_array() -> None:
    for frame, image in zip(ArrayRecording(list(IMAGES), [1, 2, 4]), IMAGES, strict=True):
        np.testing.assert_array_equal(frame.image, image)


def test_stamps_not_given_are_one_a_second() -> None:
    assert ArrayRecording(IMAGES, [1, 2, 4]).stamps_s.tolist() == [0, 1, 2]


@pytest.mark.parametrize(("top", "max_grey"), [(1000, 1023), (4000, 4095), (16_000, 16_383), (60_000, 65_535)])
def test_the_largest_grey_value_of_16_bit_is_found_with_a_note(top: int, max_grey: int) -> None:
    images = [grey(0, dtype=np.uint16, top=100), grey(1, dtype=np.uint16, top=top)]
    recording = ArrayRecording(images, [1, 2])
    assert recording.max_grey == max_grey
    assert str(max_grey) in recording.notes[0]
    assert ArrayRecording(images, [1, 2], max_grey=60_000).max_grey == 60_000


def test_the_order_of_bytes_does_not_matter() -> None:
    images = np.stack([grey(i, dtype=np.uint16, top=4000) for i in range(3)])
    swapped = ArrayRecording(images.astype(">u2"), [1, 2, 4])
    assert swapped.max_grey == 4095
    np.testing.assert_array_equal([frame.image for frame in swapped], images)


def test_left_aligned_values_stay_where_they_are() -> None:
    recording = ArrayRecording([grey(0, dtype=np.uint16, top=4096) << 4], [1])
    assert recording.max_grey == 4095 << 4


def test_an_odd_image_is_an_unreadable_frame() -> None:
    odd: list[np.ndarray] = [IMAGES[0], IMAGES[1][:5], IMAGES[2].astype(np.float32)]
    frames = list(ArrayRecording(odd, [1, 2, 4], name="mine"))
    with pytest.raises(FrameError, match=r"mine\[1\]: 24×5 pixels, but the first frame has 24×16"):
        _ = frames[1].image
    with pytest.raises(FrameError, match=r"mine\[2\]: grey values must be uint8 or uint16"):
        _ = frames[2].image


@pytest.mark.parametrize(
    ("images", "exposures", "stamps", "error", "message"),
    [
        ([], [], None, RecordingError, "has no images"),
        (IMAGES.astype(float), [1, 1, 1], None, RecordingError, "must be uint8 or uint16, not float64; pass them as"),
        (np.zeros((2, 4, 4, 3), np.uint8), [1, 1], None, RecordingError, "pass one channel, such as"),
        (IMAGES, [1, 2], None, ExposureError, "one per frame, 3 in all"),
        (IMAGES, [[1, 2, 3]], None, ExposureError, "one per frame"),
        (IMAGES, ["a", "b", "c"], None, ExposureError, "must be numbers"),
        (IMAGES, [1, 0, 1], None, ExposureError, r"array\[1\]: the exposure must be a positive number"),
        (IMAGES, [np.nan] * 3, None, ExposureError, r"array\[0, 1, 2\]: no exposure is known"),
        (IMAGES, [1, 1, np.inf], None, ExposureError, r"array\[2\]"),
        (IMAGES, [1, 1, 1], [0, 1], ExposureError, "time stamps have shape"),
        (IMAGES, [1, 1, 1], [0, 1, 1], RecordingError, r"array\[1, 2\]: the same time stamp"),
        (IMAGES, [1, 1, 1], [0, np.nan, 1], RecordingError, r"array\[1\]: nan is not a time stamp"),
    ],
)
def test_what_is_no_recording_is_refused(
    images: np.ndarray, exposures: list[float], stamps: list[float] | None, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        ArrayRecording(images, exposures, stamps)


def test_later_changes_of_the_exposures_given_do_not_matter() -> None:
    exposures = np.array([1.0, 2.0, 4.0])
    recording = ArrayRecording(IMAGES, exposures)
    exposures[0] = 9
    assert recording.exposures_ms[0] == 1
