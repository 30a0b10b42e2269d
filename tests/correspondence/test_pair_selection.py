"""Pairs of the paper's method, against looking at all pairs there are."""

from __future__ import annotations

import weakref

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ospc.correspondence.features import Features
from ospc.correspondence.pair_selection import ExposureChangePairs, OffsetPairs

exposures = st.lists(st.floats(0.5, 2.0), max_size=60)
windows = st.integers(2, 25)


def features(frame, exposure_ms):
    return Features(frame, exposure_ms, np.empty((0, 2)), np.empty(0), np.empty((0, 128), np.uint8))


def pushed(selection, course):
    """Return for each frame the pairs it completes, and whether it ends a window."""
    pairs, ends = [], []
    for frame, exposure_ms in enumerate(course):
        pairs.append([(left.frame, right.frame) for left, right in selection.push(features(frame, exposure_ms))])
        ends.append(selection.window_full)
    return pairs, ends


@given(exposures, windows, st.floats(0.7, 0.99), st.floats(1.01, 1.4))
def test_each_frame_meets_the_first_of_its_window_with_another_exposure(course, window, low, high):
    expected = [[] for _ in course]
    for left in range(len(course)):
        for right in range(left + 1, min(len(course), (left // window + 1) * window)):
            if not low < course[left] / course[right] < high:
                expected[right].append((left, right))
                break
    pairs, ends = pushed(ExposureChangePairs(window, low, high), course)
    assert pairs == expected
    assert ends == [(i + 1) % window == 0 for i in range(len(course))]


@given(exposures, windows)
def test_a_factor_on_all_exposures_changes_no_pair(course, window):
    pairs, _ = pushed(ExposureChangePairs(window, 0.92, 1.08), course)
    assert pushed(ExposureChangePairs(window, 0.92, 1.08), [4 * e for e in course])[0] == pairs


def test_a_constant_exposure_makes_no_pair():
    assert not any(pushed(ExposureChangePairs(10, 0.92, 1.08), [3.0] * 50)[0])


@pytest.mark.parametrize(("second", "paired"), [(1.0, False), (1 / 1.07, False), (1 / 1.09, True), (1 / 0.91, True)])
def test_the_limits_are_those_of_the_paper(second, paired):
    pairs, _ = pushed(ExposureChangePairs(200, 0.92, 1.08), [1.0, second])
    assert pairs[1] == ([(0, 1)] if paired else [])


@given(exposures, windows, st.integers(1, 30))
def test_pairs_a_fixed_offset_apart_slide_over_the_whole_course(course, window, offset):
    pairs, ends = pushed(OffsetPairs(window, offset), course)
    assert pairs == [[(i - offset, i)] if i >= offset else [] for i in range(len(course))]
    assert ends == [(i + 1) % window == 0 for i in range(len(course))]


@pytest.mark.parametrize(
    ("selection", "most"),
    [(ExposureChangePairs(12, 0.92, 1.08), 13), (OffsetPairs(40, 12), 13)],
    ids=["change", "offset"],
)
def test_no_more_frames_are_held_than_can_still_be_paired(selection, most):
    alive = []
    for frame in range(100):
        alive.append(weakref.ref(one := features(frame, 1.0)))
        selection.push(one)
        del one
        assert sum(ref() is not None for ref in alive) <= most
