"""Recordings derived from others: selected frames, other exposures, a mask."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from image_samples import encoded, grey

from ospc.recording import ArrayRecording, Recording, identity, open_recording
from ospc.recording.derived import DerivedRecording, innermost, masked, with_exposure_lag, with_sensor_depth

COUNT = 6


def recorded() -> ArrayRecording:
    return ArrayRecording([grey(i) for i in range(COUNT)], 1.0 + np.arange(COUNT), np.arange(COUNT) / 10)


def test_a_selection_is_a_recording_of_the_selected_frames() -> None:
    inner = recorded()
    chosen = np.array([1, 2, 5])
    derived = DerivedRecording.of(inner, chosen, np.array([7.0, 8.0, 9.0]), note="three frames")
    assert isinstance(derived, Recording)
    assert len(derived) == 3
    np.testing.assert_array_equal(derived.stamps_s, inner.stamps_s[chosen])
    assert derived.notes[-1] == "three frames"
    for _ in range(2):
        frames = list(derived)
        assert [frame.index for frame in frames] == [0, 1, 2]
        assert [frame.exposure_ms for frame in frames] == [7, 8, 9]
        assert [frame.stamp_s for frame in frames] == list(inner.stamps_s[chosen])
        np.testing.assert_array_equal([frame.image for frame in frames], [grey(i) for i in chosen])


@pytest.mark.parametrize("lag", [-2, 1])
def test_wrappers_combine_in_any_order(lag: int) -> None:
    mask = grey(3) > 100
    first = with_exposure_lag(masked(recorded(), mask), lag)
    second = masked(with_exposure_lag(recorded(), lag), mask)
    assert identity(first) == identity(second)
    for one, other in zip(first, second, strict=True):
        assert (one.index, one.exposure_ms, one.stamp_s) == (other.index, other.exposure_ms, other.stamp_s)
        np.testing.assert_array_equal(one.image, other.image)
        np.testing.assert_array_equal(one.mask, mask)
        np.testing.assert_array_equal(other.mask, mask)


def test_the_identity_is_that_of_the_images_that_are_kept() -> None:
    whole = recorded()
    shifted = with_exposure_lag(whole, 1)
    same = ArrayRecording([grey(i) for i in range(COUNT - 1)], 2.0 + np.arange(COUNT - 1), np.arange(COUNT - 1) / 10)
    assert identity(shifted) == identity(same)
    assert identity(shifted)["images_sha256"] != identity(whole)["images_sha256"]


@pytest.mark.parametrize(("top", "shift"), [(4, 0), (200, 0), (200, 4), (1000, 4), (4096, 0), (4096, 4)])
def test_dark_images_are_read_as_those_of_the_known_sensor(tum_folder, top: int, shift: int) -> None:
    images = {f"{i}.png": encoded(grey(i, dtype=np.uint16, top=top) << shift) for i in range(3)}
    opened = open_recording(tum_folder("0 0 1\n1 1 1\n2 2 1\n", images))
    for recording in (with_sensor_depth(opened, 4095), with_sensor_depth(masked(opened, grey(3) > 100), 4095)):
        assert recording.max_grey == 4095
        assert sum("12-bit" in note for note in recording.notes) == 1
        for index, frame in enumerate(recording):
            assert frame.max_grey == 4095
            np.testing.assert_array_equal(frame.image, grey(index, dtype=np.uint16, top=top))


def test_images_with_more_or_fewer_bits_than_the_sensor_keep_theirs(tum_folder) -> None:
    assert with_sensor_depth(recorded(), 4095).max_grey == 255
    images = {f"{i}.png": encoded(grey(i, dtype=np.uint16, top=2**14)) for i in range(3)}
    opened = open_recording(tum_folder("0 0 1\n1 1 1\n2 2 1\n", images))
    assert with_sensor_depth(opened, 4095) is opened
    assert with_sensor_depth(opened, None) is opened


@pytest.mark.parametrize("top", [1000, 4096])
def test_a_white_level_below_the_largest_number_is_that_of_all_images(tum_folder, top: int) -> None:
    images = {f"{i}.png": encoded(grey(i, dtype=np.uint16, top=top)) for i in range(3)}
    opened = open_recording(tum_folder("0 0 1\n1 1 1\n2 2 1\n", images))
    assert with_sensor_depth(opened, 4000).max_grey == next(iter(with_sensor_depth(opened, 4000))).max_grey == 4000


def test_images_in_memory_get_the_largest_grey_value_of_the_sensor() -> None:
    dark = ArrayRecording([grey(i, dtype=np.uint16, top=200) for i in range(COUNT)], np.ones(COUNT))
    assert dark.max_grey == 255
    deep = with_sensor_depth(dark, 4095)
    assert deep.max_grey == next(iter(deep)).max_grey == 4095
    for wrapped in (deep, masked(deep, grey(0) > 100)):
        deeper = with_sensor_depth(wrapped, 16383)
        assert deeper.max_grey == next(iter(deeper)).max_grey == 16383
        assert sum("sensor" in note for note in deeper.notes) == 1


def test_the_innermost_recording_has_the_frame(tum_folder) -> None:
    inner = open_recording(tum_folder())
    derived = masked(with_exposure_lag(with_exposure_lag(inner, -1), -1), np.ones((16, 24), bool))
    assert innermost(derived, 0) == (inner, 2)
    assert derived.stored_bytes(0).startswith(inner.stored_bytes(2))
    assert derived.path == Path(inner.path)
