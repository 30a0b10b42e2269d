"""Which keyframes are kept, and which one is selected."""

from __future__ import annotations

import weakref
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ospc.correspondence.flat_sampling import Keyframe, Samples
from ospc.correspondence.thumbnail import Thumbnail
from ospc.observations import Observations
from ospc.photometry.grey_range import FULL_RANGE
from workers import keyframe_selector

TINY = np.zeros((1, 1), np.float32)
NONE = np.empty(0)
NOTHING = Observations.of_pairs(NONE, NONE, np.empty((0, 2)), np.empty((0, 2)), 0, 1)


def frame(number):
    thumbnail = Thumbnail(number, TINY, TINY, TINY > 0, TINY.astype(np.uint8), 1)
    none, small = NONE.astype(np.float32), (TINY.astype(np.uint8), thumbnail, NONE, NONE, TINY)
    return Keyframe(number, (1, 1), 1, *small, FULL_RANGE, *4 * [none], none > 0)


def kept_ages(capacity, count):
    """Return the ages of the keyframes still kept after adding ``count``, oldest first."""
    keyframes, alive = keyframe_selector(capacity), []
    for number in range(count):
        alive.append(weakref.ref(one := frame(number)))
        keyframes.add(one, 0.0)
        del one
    return np.array([count - number for number, ref in enumerate(alive) if ref() is not None])


@given(st.integers(1, 30), st.integers(1, 120))
def test_no_more_keyframes_are_held_than_allowed(capacity, count):
    assert len(kept_ages(capacity, count)) == min(capacity, count)


@pytest.mark.parametrize("count", [50, 100, 200, 500, 1000])
def test_ages_of_the_keyframes_grow_geometrically(count):
    ages = kept_ages(20, count)
    assert set(range(1, 6)) <= set(ages)
    assert ages[0] > count / 3
    assert np.all(ages[:-1] / ages[1:] <= 2.5)
    # Half of the keyframes cover the recent past; the ages of the others grow geometrically.
    assert np.all(ages[:5] / ages[5:10] >= min(count / 50, 4))


def test_there_is_no_keyframe_for_the_first_frame():
    assert keyframe_selector().select(0, 0.0) is None


def with_exposures(log_exposures, **limits):
    keyframes = keyframe_selector(**limits)
    for number, log_exposure in enumerate(log_exposures):
        keyframes.add(frame(number), log_exposure)
    return keyframes


def test_every_third_selection_goes_for_the_change_of_exposure():
    keyframes = with_exposures([0.0, 0.1, 0.9, 0.1, 0.0])
    assert [keyframes.select(5, 0.0).number for _ in range(3)][2] == 2


def test_without_change_of_exposure_older_keyframes_promise_more_motion():
    assert with_exposures([0.0] * 12).select(12, 0.0).number < 6


def test_a_keyframe_that_was_used_steps_back_behind_its_equals():
    keyframes = with_exposures([0.5] * 3)
    assert {keyframes.select(3, 0.0).number for _ in range(6)} == {0, 1, 2}


def test_changes_beyond_the_limit_count_no_more_than_the_limit():
    keyframes = keyframe_selector(max_log_ratio=1.0)
    frames = [frame(number) for number in range(5)]
    for one, log_exposure in zip(frames, [5.0, 0.0, 0.0, 0.0, 1.0], strict=True):
        keyframes.add(one, log_exposure)
    # The newest overlaps best, and an exposure change by e is as good as one by e⁵.
    for _ in range(12):
        keyframes.update(frames[0], 5, lost())
    assert [keyframes.select(5, 0.0).number for _ in range(3)][2] in (0, 4)


def lost():
    return Samples(NOTHING, 0.0, 0.0, float("nan"))


def test_pair_distances_without_matches_are_avoided():
    keyframes = keyframe_selector()
    frames = [frame(number) for number in range(16)]
    for one in frames:
        keyframes.add(one, 0.8 * (one.number % 2))
    for _ in range(20):
        for one in frames[:8]:
            keyframes.update(one, 16, lost())
        for one in frames[8:]:
            keyframes.update(one, 16, replace(lost(), overlap=0.9, radial_motion=0.05))
    assert min(keyframes.select(16, 0.0).number for _ in range(8)) >= 8
    assert keyframes.best_age <= 8


def test_frames_that_are_farther_apart_are_expected_to_overlap_no_more():
    # With a fast camera only neighbours overlap, so no other frame deserves many attempts.
    keyframes, attempts = keyframe_selector(), []
    for number in range(0, 400, 4):
        for one in (number, number + 1):
            selected = keyframes.select(one, 0.0)
            if selected is not None:
                attempts.append(one - selected.number)
                overlaps = attempts[-1] == 1
                found = replace(lost(), overlap=0.7, radial_motion=0.02) if overlaps else lost()
                keyframes.update(selected, one, found)
            keyframes.add(frame(one), 0.0)
    # Every second frame has a neighbour to compare with.
    assert np.mean(np.array(attempts[100:]) == 1) > 0.45
    assert keyframes.best_age <= 2


def test_a_camera_that_stops_moving_is_detected():
    keyframes = keyframe_selector()
    for number in range(120):
        if number:
            selected = keyframes.select(number, 0.0)
            found = replace(lost(), overlap=0.8, radial_motion=0.01) if number > 60 else lost()
            keyframes.update(selected, number, found)
        keyframes.add(frame(number), 0.0)
    assert keyframes.best_age > 1


@given(st.lists(st.floats(-2, 2), min_size=2, max_size=40), st.floats(-3, 3))
def test_the_unit_of_exposure_does_not_matter(course, shift):
    # Shifting numbers with few binary digits leaves their differences exact, so that ties remain ties.
    def selections(shift):
        keyframes, made = keyframe_selector(6), []
        for number, log_exposure in enumerate(np.round(1024 * np.array(course)) / 1024):
            found = keyframes.select(number, log_exposure + shift)
            made.append(None if found is None else found.number)
            keyframes.add(frame(number), log_exposure + shift)
        return made

    assert selections(round(shift)) == selections(0.0)


def test_it_forgets_what_was_before_a_frame():
    keyframes = with_exposures([0.0] * 10)
    keyframes.forget_before(7)
    assert keyframes.numbers == [7, 8, 9]
