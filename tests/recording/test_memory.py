"""The memory needed to read a recording of any format does not grow with its length."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from test_same_from_every_format import FORMATS, SIZE, filmed

from ospc.recording import ArrayRecording, open_recording
from ospc.recording.stream import frames_of

IMAGE_BYTES = SIZE[0] * SIZE[1]
# Bags are read in chunks of one megabyte; both recordings are longer.
FEW, SHORT, LONG = 8, 120, 240
MOST_BYTES = 5 * 2**20
# Frames' names and numbers are kept in memory; they are far smaller than the images.
MOST_BYTES_MORE = 0.2 * (LONG - SHORT) * IMAGE_BYTES


def peak_of_reading(path: Path) -> int:
    tracemalloc.start()
    try:
        pixels = sum(frame.image.size for frame in open_recording(path))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert pixels % IMAGE_BYTES == 0
    return peak


SAME_READER = {"16 bit, left-aligned", "grey as colour", "ROS 2 bag, mcap by mcap", "ROS 2 bag, JPEG and s"}
"""Formats that share a reader with another format."""


@pytest.mark.parametrize("name", [name for name in FORMATS if name not in SAME_READER])
def test_a_recording_twice_as_long_takes_no_more_memory(name: str, tmp_path: Path) -> None:
    paths = [FORMATS[name](tmp_path / f"{n}", filmed(n)) for n in (SHORT, LONG)]
    for _ in open_recording(FORMATS[name](tmp_path / "few", filmed(FEW))):
        pass  # reading a format for the first time imports modules
    # This also counts allocations by threads of earlier tests. If the total is too high, measure again.
    short, long = (peak_of_reading(path) for path in paths)
    if not (long - short < MOST_BYTES_MORE and short < MOST_BYTES):
        short, long = (min(peak_of_reading(path), before) for path, before in zip(paths, (short, long), strict=True))
    assert long - short < MOST_BYTES_MORE
    assert short < MOST_BYTES


def test_frames_from_an_iterable_are_not_kept() -> None:
    def images(count: int) -> int:
        tracemalloc.start()
        try:
            made = ((np.full(SIZE[::-1], i % 256, np.uint8), 1.0) for i in range(count))
            assert sum(frame.image.size for frame in frames_of(made)) == count * IMAGE_BYTES
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    images(8)
    assert images(200) < images(100) + 5 * IMAGE_BYTES


def test_frames_in_memory_are_not_copied() -> None:
    images = np.zeros((100, *SIZE[::-1]), np.uint8)
    recording = ArrayRecording(images, np.ones(100))
    tracemalloc.start()
    try:
        for frame in recording:
            assert np.shares_memory(frame.image, images)
        assert tracemalloc.get_traced_memory()[1] < 5 * IMAGE_BYTES
    finally:
        tracemalloc.stop()
