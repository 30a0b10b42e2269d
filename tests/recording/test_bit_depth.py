"""Used bits of 16-bit images: left- or right-aligned bits are found, and frames that contradict them are errors."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from image_samples import encoded, grey

from ospc.errors import FrameError
from ospc.recording import open_recording
from ospc.recording.frame import Frame
from ospc.recording.options import ReadingOptions
from ospc.recording.pixel_layout import BitDepth, detect_bit_depth

Make = Callable[..., Path]


@given(st.sampled_from([8, 10, 12, 14, 16]), st.booleans(), st.integers(0, 1000))
def test_bits_and_their_place_are_found(bits: int, left: bool, seed: int) -> None:
    shift = 16 - bits if left else 0
    image = grey(seed, (40, 30), np.uint16, 2**bits)
    image[0, :2] = 2**bits - 1, 1
    assert detect_bit_depth([image << shift]) == BitDepth(bits, shift, 16)


@pytest.mark.parametrize("bits", [8, 10, 12])
def test_dark_left_aligned_images_are_recognised_by_their_low_bits(bits: int) -> None:
    image = grey(0, (40, 30), np.uint16, 2 ** (bits - 3))
    assert detect_bit_depth([image << (16 - bits)]) == BitDepth(bits, 16 - bits, 16)


def test_eight_bit_images_are_what_they_are() -> None:
    assert detect_bit_depth([grey()]) == BitDepth(8)
    assert BitDepth(8).note is None


def test_black_images_keep_the_full_bit_depth() -> None:
    assert detect_bit_depth([np.zeros((2, 2), np.uint16)]).max_grey == 65535


@pytest.mark.parametrize("shift", [0, 4])
def test_twelve_bit_recordings_give_values_up_to_4095(tum_folder: Make, shift: int) -> None:
    images = {f"{i}.png": encoded(grey(i, dtype=np.uint16, top=4096) << shift) for i in range(3)}
    recording = open_recording(tum_folder("0 0 1\n1 1 1\n2 2 1\n", images))
    assert recording.max_grey == 4095
    assert "12-bit" in recording.notes[-1]
    for index, frame in enumerate(recording):
        assert frame.max_grey == 4095
        np.testing.assert_array_equal(frame.image, grey(index, dtype=np.uint16, top=4096))


def test_the_longest_exposures_decide_not_the_dark_beginning(tum_folder: Make) -> None:
    tops = (300, 300, 300, 300, 300, 4096)
    images = {f"{i}.png": encoded(grey(i, dtype=np.uint16, top=top)) for i, top in enumerate(tops)}
    recording = open_recording(tum_folder("".join(f"{i} {i} {i + 1}\n" for i in range(6)), images))
    assert recording.max_grey == 4095


def test_a_dark_beginning_does_not_decide_if_exposures_are_unknown(tmp_path: Path) -> None:
    for i, top in enumerate((300, 300, 300, 300, 4096, 4096)):
        (tmp_path / f"{i}.png").write_bytes(encoded(grey(i, dtype=np.uint16, top=top)))
    assert open_recording(tmp_path, options=ReadingOptions(unknown_exposures=True)).max_grey == 4095


@pytest.mark.parametrize(("shift", "odd"), [(0, 5000), (4, 1)])
def test_a_frame_beyond_the_bits_found_is_an_error(tum_folder: Make, shift: int, odd: int) -> None:
    images = {f"{i}.png": encoded(grey(i, dtype=np.uint16, top=4096) << shift) for i in range(5)}
    images["4.png"] = encoded(np.full((16, 24), odd, np.uint16))
    recording = open_recording(tum_folder("".join(f"{i} {i} {5 - i}\n" for i in range(5)), images))
    with pytest.raises(FrameError, match=r"4\.png: has grey values outside the 12 bits"):
        _ = list(recording)[4].image


@pytest.mark.parametrize("max_grey", [255, 1023, 4095, 65_535])
def test_an_image_of_eight_bits_spans_the_same_range(max_grey: int) -> None:
    values = np.linspace(0, max_grey, 200, dtype=np.uint16)[None]
    found = Frame.of_array(values, 1.0, max_grey=max_grey).image_8_bit
    assert found.dtype == np.uint8
    np.testing.assert_allclose(found, values * (255 / max_grey), atol=0.5)
    brightest = Frame.of_array(np.full((2, 2), min(2 * max_grey, 65_535), np.uint16), 1.0, max_grey=max_grey)
    assert np.all(brightest.image_8_bit == 255)
