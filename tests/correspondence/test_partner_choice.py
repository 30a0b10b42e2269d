"""Which earlier views are kept, and which is chosen."""

from __future__ import annotations

import weakref
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ospc.correspondence.flat_sampling import Samples
from ospc.correspondence.keyframe_selection import KeyframeSelector
from ospc.correspondence.preprocessing import PreprocessedFrame
from ospc.observations import Observations

TINY = np.zeros((1, 1), np.float32)
NOTHING = Observations(*([np.empty(0)] * 2), np.empty((0, 2)), *([np.empty(0)] * 2), *([np.empty(0, np.int64)] * 3))


def view(frame, log_exposure=0.0):
    return PreprocessedFrame(frame, log_exposure, (1, 1), 1, TINY, TINY, TINY > 0, TINY.astype(np.uint8), 1.0)


def kept_ages(capacity, count):
    """Return, oldest first, how long ago the views were added that are still held after so many."""
    partners, alive = KeyframeSelector(capacity), []
    for frame in range(count):
        alive.append(weakref.ref(one := view(frame)))
        partners.add(one)
        del one
    return np.array([count - frame for frame, ref in enumerate(alive) if ref() is not None])


@given(st.integers(4, 30), st.integers(1, 120))
def test_no_more_views_are_held_than_allowed(capacity, count):
    assert len(kept_ages(capacity, count)) == min(capacity, count)


@pytest.mark.parametrize("count", [50, 100, 200, 500, 1000])
def test_ages_of_the_views_kept_grow_geometrically(count):
    ages = kept_ages(20, count)
    assert set(range(1, 6)) <= set(ages)
    assert ages[0] > count / 3
    assert np.all(ages[:-1] / ages[1:] <= 2.5)
    # Half of the views are for the recent past; the other half reaches back as far again and again.
    assert np.all(ages[:5] / ages[5:10] >= min(count / 50, 4))


def test_there_is_no_partner_for_the_first_view():
    assert KeyframeSelector().choose(view(0)) is None


def chosen(partners, new):
    """Return the choices that serve the vignette and the response."""
    return [partners.choose(new).frame for _ in range(2)]


def test_every_second_choice_goes_for_the_change_of_exposure():
    partners = KeyframeSelector()
    for frame, log_exposure in enumerate([0.0, 0.1, 0.9, 0.1, 0.0]):
        partners.add(view(frame, log_exposure))
    assert chosen(partners, view(5, 0.0))[1] == 2


def test_without_change_of_exposure_older_views_promise_more_motion():
    partners = KeyframeSelector()
    for frame in range(12):
        partners.add(view(frame))
    assert partners.choose(view(12)).frame < 6


def test_a_view_that_was_used_steps_back_behind_its_equals():
    partners = KeyframeSelector()
    for frame in range(3):
        partners.add(view(frame, 0.5))
    picks = [partners.choose(view(9, 0.0)).frame for _ in range(6)]
    assert set(picks) == {0, 1, 2}


def test_changes_beyond_the_limit_count_no_more_than_the_limit():
    partners = KeyframeSelector(max_log_ratio=1.0)
    for frame, log_exposure in enumerate([5.0, 0.0, 0.0, 0.0, 1.0]):
        partners.add(view(frame, log_exposure))
    # The newest overlaps best, and a change by e is as good as one by e⁵.
    for _ in range(12):
        partners.learn(view(0), lost())
    picks = [partners.choose(view(5, 0.0)).frame for _ in range(2)]
    assert picks[1] in (0, 4)


def lost():
    return Samples(NOTHING, 0.0, 0.0, float("nan"))


def test_ages_at_which_nothing_was_found_again_are_avoided():
    partners = KeyframeSelector()
    views = [view(frame, 0.8 * (frame % 2)) for frame in range(16)]
    for one in views:
        partners.add(one)
    old = [v for v in views if v.frame < 8]
    for _ in range(20):
        for one in old:
            partners.learn(one, lost())
        for one in views[8:]:
            partners.learn(one, replace(lost(), overlap=0.9, radial_motion=0.05))
    picks = {partners.choose(view(16, 0.0)).frame for _ in range(8)}
    assert min(picks) >= 8


@given(st.lists(st.floats(-2, 2), min_size=2, max_size=40))
def test_the_same_course_makes_the_same_choices(course):
    def choices(shift):
        partners, made = KeyframeSelector(6), []
        for frame, log_exposure in enumerate(course):
            new = view(frame, log_exposure + shift)
            partner = partners.choose(new)
            made.append(None if partner is None else partner.frame)
            partners.add(new)
        return made

    assert choices(0.0) == choices(0.0)
