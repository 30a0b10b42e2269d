"""Frames from a ROS driver's messages."""

from __future__ import annotations

import json
from array import array
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from image_samples import grey

from ospc.errors import ExposureError, FrameError
from ospc.recording.live.ros import RosFrames
from ospc.recording.options import ReadingOptions


class Message(SimpleNamespace):
    """Behaves like a message of rclpy."""

    def get_fields_and_field_types(self) -> dict[str, str]:
        return dict.fromkeys(vars(self), "float64")


FLIR, REALSENSE = "flir_camera_msgs/msg/ImageMetaData", "realsense2_camera_msgs/msg/Metadata"
UNIT = {"exposure_unit": "100us"}


def header(number: int) -> Message:
    return Message(stamp=Message(sec=100 + number // 20, nanosec=number % 20 * 50_000_000))


def image(number: int, encoding: str = "mono8") -> Message:
    data = grey(number, (8, 6)).ravel()
    return Message(header=header(number), height=6, width=8, step=8, encoding=encoding, is_bigendian=0, data=data)


def exposure(number: int, microseconds: int = 2000, gain: float = 0.0) -> Message:
    return Message(header=header(number), exposure_time=microseconds, gain=gain)


@given(st.lists(st.tuples(st.integers(0, 12), st.booleans()), max_size=60))
def test_frames_are_those_of_which_both_parts_came_in_order_and_once(events: list[tuple[int, bool]]) -> None:
    frames, pairs = [], RosFrames(FLIR)
    for number, is_image in events:
        frame = pairs.image(image(number)) if is_image else pairs.exposure(exposure(number, 1000 + number))
        frames += [] if frame is None else [frame]
    assert [frame.index for frame in frames] == list(range(len(frames)))
    stamps = [frame.stamp_s for frame in frames]
    assert stamps == sorted(set(stamps))
    for frame in frames:
        number = round((frame.stamp_s - 100) * 20)
        assert np.array_equal(frame.image, grey(number, (8, 6)))
        assert frame.exposure_ms == pytest.approx(1 + number / 1000)
        assert {(number, True), (number, False)} <= set(events)


def test_after_the_clock_was_set_frames_are_paired_again() -> None:
    pairs = RosFrames(FLIR)
    order = [*range(500, 504), 10**6, *range(504, 508), *range(3)]  # ahead for one frame, and back to the beginning
    frames = []
    for number in order:
        assert pairs.image(image(number)) is None
        frames.append(pairs.exposure(exposure(number)))
    assert [frame.index for frame in frames] == list(range(len(order)))
    assert [frame.stamp_s for frame in frames] == pytest.approx([100 + number / 20 for number in order])


def test_unmatched_messages_take_bounded_memory() -> None:
    pairs = RosFrames(FLIR)
    for number in range(1000):
        assert pairs.image(image(number)) is None
    assert pairs.exposure(exposure(10)) is None
    assert pairs.exposure(exposure(999)) is not None


def test_exposure_is_time_times_gain() -> None:
    pairs = RosFrames(FLIR)
    pairs.image(image(0))
    assert pairs.exposure(exposure(0, 2000, 20.0)).exposure_ms == pytest.approx(20)
    pairs = RosFrames(REALSENSE)
    pairs.image(image(0))
    content = json.dumps({"actual_exposure": 3000, "gain_level": 32})
    assert pairs.exposure(Message(header=header(0), json_data=content)).exposure_ms == pytest.approx(6)


def test_the_field_of_other_messages_can_be_stated() -> None:
    options = ReadingOptions.of({"exposure_field": "point.x"} | UNIT)
    pairs = RosFrames("geometry_msgs/msg/PointStamped", options)
    pairs.image(image(0))
    fields = {"header": header(0), "point": Message(x=50.0)}
    assert pairs.exposure(Message(**fields)).exposure_ms == pytest.approx(5)


class Point:
    """Behaves like a message of ROS 1, which has no dictionary."""

    __slots__ = ("x",)

    def __init__(self, x: float) -> None:
        self.x = x


@pytest.mark.parametrize("point", [SimpleNamespace(x=50.0), Point(50.0)])
def test_messages_are_any_objects_with_the_fields_of_their_types(point: object) -> None:
    pairs = RosFrames("geometry_msgs/msg/PointStamped", ReadingOptions.of({"exposure_field": "point.x"} | UNIT))
    pairs.image(image(0))
    assert pairs.exposure(SimpleNamespace(header=header(0), point=point)).exposure_ms == pytest.approx(5)
    with pytest.raises(ExposureError, match=r"has no field point\.x; it has header, x"):
        pairs.exposure(SimpleNamespace(header=header(0), x=50.0))


@pytest.mark.parametrize("stored", [bytes, bytearray, memoryview, list, tuple, partial(array, "B"), np.asarray])
@pytest.mark.parametrize("encoding", ["mono8", "mono16"])
def test_the_bytes_of_an_image_have_any_type(stored: Callable[[bytes], object], encoding: str) -> None:
    message, pairs = image(0), RosFrames(FLIR)
    words = message.data.reshape(6, 8).astype("u1" if encoding == "mono8" else "<u2")
    rows = np.pad(words.view(np.uint8), ((0, 0), (0, 4)))  # padded at the end of each row
    content = rows.ravel() if stored is np.asarray else rows.tobytes()
    message.encoding, message.step, message.data = encoding, rows.shape[1], stored(content)
    pairs.exposure(exposure(0))
    np.testing.assert_array_equal(pairs.image(message).image, words)


def test_the_stamp_may_be_that_of_the_camera_info_in_a_message() -> None:
    pairs = RosFrames("camera_aravis/msg/ExtendedCameraInfo", ReadingOptions.of({"gain_unit": "db"}))
    pairs.image(image(0))
    message = Message(camera_info=Message(header=header(0)), exposure_time=2000.0, gain=0.0)
    assert pairs.exposure(message).exposure_ms == pytest.approx(2)


def test_a_message_without_any_stamp_is_an_error() -> None:
    pairs = RosFrames("std_msgs/msg/Float64", ReadingOptions.of({"exposure_unit": "ms"}))
    with pytest.raises(ExposureError, match="has no time stamp"):
        pairs.exposure(Message(data=2.0))


def test_only_the_first_frame_may_have_the_stamp_0_which_drivers_send_that_set_none() -> None:
    message, pairs = image(0), RosFrames(FLIR)
    message.header = Message(stamp=Message(sec=0, nanosec=0))
    said = Message(header=message.header, exposure_time=2000, gain=0.0)
    assert pairs.image(message) is None
    assert pairs.exposure(said).stamp_s == 0
    with pytest.raises(FrameError, match="has no time stamp"):
        pairs.image(message)
    with pytest.raises(ExposureError, match="has no time stamp"):
        pairs.exposure(said)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("a_msgs/msg/Own", "give the field of the exposure"),
        ("std_msgs/msg/Float32", "give the unit of its exposures"),
        ("camera_aravis/msg/ExtendedCameraInfo", "give the unit of its gains"),
    ],
)
def test_what_is_not_known_has_to_be_stated(kind: str, message: str) -> None:
    with pytest.raises(ExposureError, match=message):
        RosFrames(kind)


def test_missing_exposures_and_unreadable_images_are_errors() -> None:
    pairs = RosFrames(FLIR)
    with pytest.raises(ExposureError, match=r"exposure 0.0 ms is not a positive number .*; enable the metadata"):
        pairs.exposure(exposure(0, 0))
    with pytest.raises(FrameError, match="encoding"):
        pairs.image(image(0, "32FC1"))


@pytest.mark.parametrize("content", [{}, {"json_data": 3}, {"json_data": '{"actual_exposure": 1' + "0" * 400 + "}"}])
def test_a_message_with_unexpected_content_is_an_error_of_its_exposure(content: dict[str, object]) -> None:
    with pytest.raises(ExposureError, match="have unexpected fields"):
        RosFrames(REALSENSE).exposure(Message(header=header(0), **content))


def test_of_a_mosaic_the_green_pixels_are_taken() -> None:
    pairs = RosFrames(FLIR)
    pairs.exposure(exposure(0))
    assert pairs.image(image(0, "bayer_rggb8")).image.shape == (3, 4)
