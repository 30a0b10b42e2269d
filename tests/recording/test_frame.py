"""Frames made by hand: what is taken as what it means, and what is refused with a sentence."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ospc.errors import FrameError
from ospc.recording import ArrayRecording, Frame
from ospc.recording.derived import masked

IMAGE = np.full((16, 24), 200, np.uint8)
FRAME = Frame.of_array(IMAGE, 1.0)


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


@pytest.mark.parametrize("value", [1, 199, 4095])
def test_a_largest_grey_value_that_does_not_fit_8_bits_is_refused(value: int) -> None:
    with pytest.raises(FrameError, match=f"max_grey is {value}, which does not fit 8-bit grey values up to 200"):
        Frame.of_array(IMAGE, 1.0, max_grey=value)


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
    with pytest.raises(FrameError, match="frame 0: a mask is an array of bool or uint8 with two dimensions"):
        replace(FRAME, mask=mask)
