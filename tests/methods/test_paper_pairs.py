"""Which frames the paper's method compares, checked against the definition applied to all possible pairs."""

from __future__ import annotations

import weakref
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ospc.correspondence.features import Features
from ospc.methods.paper import Correspondences, PaperMethod
from ospc.recording.frame import Frame
from ospc.settings import PaperSettings
from stated_exposures import StatedExposures

SIZE = (64, 48)
NEVER = 10**6
exposures = st.lists(st.floats(0.5, 2.0), max_size=60)
windows = st.integers(2, 25)


class NotingMatcher:
    """Records which frames it is asked to match, and finds no matches."""

    def __init__(self):
        self.asked = []
        self.alive = []

    def features(self, frame):
        found = Features(frame.index, np.empty((0, 2)), np.empty(0), np.empty((0, 128), np.uint8))
        self.alive.append(weakref.ref(found))
        return found

    def correspondences(self, left, right, size):
        self.asked.append((left.frame, right.frame))
        return Correspondences((left.frame, right.frame), size, *np.empty((2, 0, 2)), *np.empty((2, 0)))


def pushed(course, **settings):
    """Return the pairs that each frame completes."""
    matcher, known, pairs = NotingMatcher(), StatedExposures(), []
    method = PaperMethod(replace(PaperSettings(), **settings), SIZE, 255, matcher)
    for index, exposure_ms in enumerate(course):
        known.add(index, exposure_ms)
        method.push(Frame.of_array(np.zeros((1, 1), np.uint8), exposure_ms, index=index), None, known)
        pairs.append(matcher.asked)
        matcher.asked = []
    assert method.progress.pairs == sum(map(len, pairs))
    return pairs


def for_response(course, window=200, low=0.92, high=1.08):
    limits = {"exposure_ratio_low": low, "exposure_ratio_high": high}
    return pushed(course, response_window=window, vignette_offset=NEVER, vignette_window=NEVER, **limits)


def log_ratios(course):
    log = np.log(course)
    return log[:, None] - log


@given(exposures, windows, st.floats(0.7, 0.99), st.floats(1.01, 1.4))
def test_each_frame_meets_the_first_of_its_window_with_another_exposure(course, window, low, high):
    ratio = log_ratios(course)
    expected = [[] for _ in course]
    for left in range(len(course)):
        for right in range(left + 1, min(len(course), (left // window + 1) * window)):
            if not np.log(low) < ratio[left, right] < np.log(high):
                expected[right].append((left, right))
                break
    assert for_response(course, window, low, high) == expected


@given(exposures, windows)
def test_a_factor_on_all_exposures_changes_no_pair(course, window):
    # Exactly at a limit, rounding decides.
    assume(all(np.abs(log_ratios(course) - limit).min(initial=1) > 1e-12 for limit in np.log([0.92, 1.08])))
    assert for_response([4 * e for e in course], window) == for_response(course, window)


def test_a_constant_exposure_makes_no_pair():
    assert not any(for_response([3.0] * 50, 10))


@pytest.mark.parametrize(("second", "paired"), [(1.0, False), (1 / 1.07, False), (1 / 1.09, True), (1 / 0.91, True)])
def test_the_limits_are_those_of_the_paper(second, paired):
    assert for_response([1.0, second])[1] == ([(0, 1)] if paired else [])


@given(exposures, windows, st.integers(1, 30))
def test_pairs_a_fixed_offset_apart_slide_over_the_whole_course(course, window, offset):
    unchanging = {"exposure_ratio_low": 1e-9, "exposure_ratio_high": 1e9}
    pairs = pushed(course, vignette_window=window, vignette_offset=offset, **unchanging)
    assert pairs == [[(i - offset, i)] if i >= offset else [] for i in range(len(course))]


def test_exposures_known_late_decide_for_the_frames_that_wait():
    """Two frames are recorded with the same exposure; the first one's turns out to be wrong."""
    matcher, known = NotingMatcher(), StatedExposures()
    method = PaperMethod(PaperSettings(), SIZE, 255, matcher)
    for index in range(3):
        known.add(index, 2.0)
        if index == 2:
            known.add(0, 1.0)
        method.push(Frame.of_array(np.zeros((1, 1), np.uint8), 2.0, index=index), None, known)
    assert matcher.asked == [(0, 2)]


def test_no_more_frames_are_held_than_can_still_be_paired():
    matcher, known = NotingMatcher(), StatedExposures()
    settings = replace(PaperSettings(), response_window=12, vignette_window=40, vignette_offset=12)
    method = PaperMethod(settings, SIZE, 255, matcher)
    for index in range(100):
        known.add(index, 1.0)
        method.push(Frame.of_array(np.zeros((1, 1), np.uint8), 1.0, index=index), None, known)
        assert sum(ref() is not None for ref in matcher.alive) <= 13
