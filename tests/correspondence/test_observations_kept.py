"""Observations: joining, selection, thinning and limits, and pixel series of a static camera."""

from __future__ import annotations

from collections import Counter
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ospc.correspondence.reservoir import Reservoir
from ospc.correspondence.static_series import StaticSeries
from ospc.observations import Observations
from ospc.photometry.geometry import normalised
from ospc.photometry.grey_range import GreyRange
from ospc.recording.frame import Frame

counts = st.lists(st.integers(1, 4), min_size=1, max_size=12)


def observations(counts, group=0, start=0):
    """Return scene points with ``counts`` observations each, identified by their grey level."""
    point = np.repeat(np.arange(len(counts)), counts) + start
    n = len(point)
    tag = group + np.arange(n) / 1e6
    return Observations(
        grey=tag,
        position=np.stack([tag, -tag], axis=1),
        gradient=tag + 2,
        grey_variance=np.zeros(n),
        grey_third_moment=np.zeros(n),
        frame_moments=np.zeros((n, 6), np.float32),
        surround_moments=np.zeros((n, 2, 7), np.float32),
        frame=np.arange(n),
        point=point,
        group=np.full(n, group),
    )


def assert_same(a, b):
    for f in fields(Observations):
        np.testing.assert_array_equal(getattr(a, f.name), getattr(b, f.name))


class Stated:
    """Exposures e^(frame number), unknown for some frames."""

    def __init__(self, unknown):
        self.unknown = unknown

    def log_exposure_of(self, frames):
        return np.where(np.isin(frames, self.unknown), np.nan, frames.astype(float))


@given(st.lists(st.integers(2, 6), max_size=8), st.sets(st.integers(0, 40)))
def test_exposures_are_looked_up_and_frames_without_one_left_out(counts, unknown):
    made = observations(counts)
    exposed = made.with_exposures(Stated(sorted(unknown)))
    np.testing.assert_array_equal(exposed.log_exposure, exposed.frame)
    known = [(p, f) for p, f in zip(made.point.tolist(), made.frame.tolist(), strict=True) if f not in unknown]
    seen = Counter(p for p, _ in known)
    assert exposed.frame.tolist() == [f for p, f in known if seen[p] >= 2]


@given(st.integers(0, 5))
def test_a_point_seen_by_many_frames_outlives_those_that_are_clipped(clipped):
    made = replace(observations([6]), grey=np.where(np.arange(6) < clipped, 1.0, np.linspace(0.3, 0.6, 6)))
    kept = made.with_exposures(Stated([])).stretched(GreyRange(16 / 255, 235 / 255))
    assert len(kept) == (6 - clipped if clipped < 5 else 0)


def test_a_reservoir_split_off_keeps_all_that_is_added():
    reservoir = Reservoir(capacity=64)
    for group in range(40):
        reservoir.add(observations([2] * 16, group))
    later, groups = reservoir.since(0)
    before = later.points
    later.add(observations([2] * 16, groups))
    assert later.points == before + 16


def test_a_reservoir_since_a_frame_has_all_that_is_seen_from_then_on():
    reservoir = Reservoir(100)
    for group in range(6):
        reservoir.add(replace(observations([2, 2], group=group), frame=np.array([group, group + 1] * 2)))
    later, groups = reservoir.since(3)
    assert later.kept.frame.min() >= 3
    assert (groups, sorted(set(later.kept.group.tolist()))) == (3, [0, 1, 2])
    assert later.points == 6
    assert [reservoir.groups_before(frame, 6) for frame in (0, 3, 6, 7)] == [0, 2, 5, 6]


def test_points_above_a_grey_level_are_forgotten():
    reservoir = Reservoir(100)
    grey0, grey1 = [0.2, 0.5, 0.9], [0.3, 0.8, 0.1]
    place = np.zeros((3, 2))
    reservoir.add(Observations.of_pairs(grey0, grey1, place, place, 0, 1))
    reservoir.forget_above(0.7)
    np.testing.assert_allclose(reservoir.kept.grey, [0.2, 0.3])
    reservoir.add(replace(Observations.of_pairs(grey0, grey1, place, place, 1, 2), group=np.ones(6, int)))
    assert reservoir.points == 4
    reservoir.forget_above(0.0)
    assert reservoir.kept is None


@given(counts, st.integers(0, 5))
def test_the_observations_of_a_point_follow_one_another(counts, start):
    made = observations(counts, start=start)
    assert len(made) == sum(counts)
    np.testing.assert_array_equal(made.starts, np.cumsum([0, *counts[:-1]]))
    np.testing.assert_array_equal(made.counts, counts)


@given(counts, st.data())
def test_points_are_chosen_with_all_their_observations(counts, data):
    made = observations(counts)
    mask = np.array(data.draw(st.lists(st.booleans(), min_size=len(counts), max_size=len(counts))))
    chosen = made.of_points(mask)
    np.testing.assert_array_equal(chosen.grey, made.grey[np.isin(made.point, np.flatnonzero(mask))])
    assert_same(made.of_points(np.flatnonzero(mask)), chosen)
    assert_same(made.of_points(slice(None)), made)
    np.testing.assert_array_equal(chosen.counts, np.array(counts)[mask])


# Reservoir


def filled(capacity, parts, points=50):
    reservoir = Reservoir(capacity)
    for group in range(parts):
        reservoir.add(observations([2] * points, group))
        assert reservoir.points <= capacity
        assert reservoir.points == len(reservoir.kept.starts)
    return reservoir


@given(st.integers(100, 400), st.integers(1, 12))
def test_a_reservoir_never_holds_more_than_it_may_and_only_what_it_was_given(capacity, parts):
    kept = filled(capacity, parts)
    if kept.points == 0:
        return
    given = [observations([2] * 50, group, start=50 * group) for group in range(parts)]
    columns = {f.name: np.concatenate([getattr(one, f.name) for one in given]) for f in fields(Observations)}
    everything = Observations(**columns)
    inside = np.isin(everything.grey, kept.kept.grey)
    expected = everything.where(inside)
    assert_same(replace(kept.kept, point=expected.point), expected)
    if 50 * parts <= capacity:
        assert inside.all()


def test_old_and_new_points_are_thinned_alike():
    kept = filled(1500, 200, points=60).kept
    left = np.bincount(kept.group, minlength=200) / 2
    assert kept.counts.min() == kept.counts.max() == 2
    rate = left.mean() / 60
    assert 0.05 < rate < 0.13
    deviation = np.sqrt(60 * rate * (1 - rate))
    assert np.all(np.abs(left - left.mean()) < 5 * deviation)
    quarters = left.reshape(4, 50).sum(axis=1)
    assert np.all(np.abs(quarters - quarters.mean()) < 4 * np.sqrt(50) * deviation)
    # The position of a point within its pair does not matter either.
    place = np.bincount(np.rint(kept.grey % 1 * 1e6).astype(int) // 40, minlength=3)
    assert np.all(np.abs(place - place.mean()) < 5 * np.sqrt(place.mean()) + 200)


def test_thinning_a_group_does_not_depend_on_the_others():
    many = filled(300, 200).kept
    for group in np.unique(many.group).tolist():
        alone, halvings = observations([2] * 50, group), 0
        while not np.isin(alone.grey, many.grey).all():
            chosen = np.random.default_rng([group, halvings]).random(len(alone.starts)) < 0.5
            alone, halvings = alone.of_points(chosen), halvings + 1
        np.testing.assert_array_equal(alone.grey, many.grey[many.group == group])


def test_returned_observations_never_change():
    reservoir, given = Reservoir(300), []
    for group in range(40):
        reservoir.add(observations([2] * 20, group))
        if group % 7 == 3:
            reservoir.forget_before(group // 2)
        given.append((reservoir.kept, replace(reservoir.kept, grey=reservoir.kept.grey.copy())))
    for shown, copied in given:
        assert_same(shown, copied)


def test_what_is_forgotten_is_gone_and_all_else_is_kept():
    reservoir = filled(2000, 30)
    before = reservoir.kept
    reservoir.forget_before(11)
    assert_same(reservoir.kept, before.where(before.group >= 11))
    reservoir.add(observations([2] * 20, 30))
    assert_same(reservoir.kept.where(slice(-40)), before.where(before.group >= 11))
    reservoir.forget_before(99)
    assert (reservoir.kept, reservoir.points, reservoir.groups_before(0, 31)) == (None, 0, 31)


def test_nothing_follows_in_an_empty_reservoir():
    later, groups = Reservoir(10).since(0)
    assert (later.points, groups) == (0, 0)


def test_the_same_points_make_the_same_choice():
    assert_same(filled(700, 40).kept, filled(700, 40).kept)


def test_a_bounded_choice_is_spread_over_all_that_is_kept():
    reservoir = filled(2000, 30)
    some = reservoir.some(400)
    assert 200 <= len(some.starts) <= 400
    assert np.all(np.bincount(some.group, minlength=30) > 0)
    assert_same(reservoir.some(10**6), reservoir.kept)


# Static camera

SIZE = (40, 30)


def still_frames(count, max_grey=255, seed=0):
    """Yield frames of a scene with many brightness levels, at exposures that double and halve."""
    radiance = np.random.default_rng(seed).uniform(0.02, 0.6, SIZE[::-1])
    exposures = 2.0 ** (np.arange(count) % 4 - 1.5)
    dtype = np.uint8 if max_grey == 255 else np.uint16
    for index, exposure_ms in enumerate(exposures):
        image = np.clip(np.rint(radiance * exposure_ms * max_grey), 0, max_grey).astype(dtype)
        yield Frame.of_array(image, exposure_ms, index=index * 3, max_grey=max_grey)


def series(count, max_grey=255, **settings):
    made = StaticSeries(**settings)
    for frame in still_frames(count, max_grey):
        made.observe(frame)
    return made


@pytest.mark.parametrize("max_grey", [255, 4095])
def test_a_series_holds_what_each_frame_shows_at_one_place(max_grey):
    made = series(8, max_grey, pixels=600, points=150).observations()
    by_index = {frame.index: frame for frame in still_frames(8, max_grey)}
    assert np.all(made.counts == 8)
    np.testing.assert_array_equal(made.frame.reshape(-1, 8), np.tile(sorted(by_index), (150, 1)))
    # Undo the normalisation of the position.
    half = np.hypot(SIZE[0] - 1, SIZE[1] - 1) / 2
    column, row = np.rint(made.position * half + [(SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2]).astype(int).T
    np.testing.assert_allclose(normalised(np.stack([column, row], axis=1), SIZE), made.position, atol=1e-12)
    for index, frame in by_index.items():
        here = made.frame == index
        np.testing.assert_allclose(made.grey[here], frame.image[row[here], column[here]] / max_grey)
        assert len(np.unique(made.group[here])) == 1


@given(st.integers(1, 100), st.integers(2, 16))
def test_a_series_keeps_a_bounded_number_of_frames_evenly_spaced(count, most):
    made = series(count, frames=most, pixels=20, points=5)
    assert 1 <= len(made) <= most
    kept = np.unique(made.observations().frame)
    if len(kept) > 1:
        assert kept[0] == 0
        assert len(np.unique(np.diff(kept))) == 1
        assert count * 3 - kept[-1] <= 2 * (kept[1] - kept[0])
        assert len(kept) >= min(count, most // 2)


def test_points_are_spread_over_brightness_and_seen_well_twice():
    made = series(8, pixels=1200, points=100).observations()
    grey = made.grey.reshape(100, 8)
    exposed = (grey > 1.5 / 255) & (grey < 253.5 / 255)
    assert np.all(exposed.sum(axis=1) >= 2)
    level = np.log(grey.sum(axis=1))
    everything = series(8, pixels=1200, points=1200).observations()
    levels = np.log(everything.grey.reshape(-1, 8).sum(axis=1))
    share = [np.histogram(v, bins=4, range=(levels.min(), levels.max()))[0] / len(v) for v in (level, levels)]
    assert np.ptp(share[0]) < 0.6 * np.ptp(share[1])


def test_two_cameras_that_see_the_same_give_the_same():
    assert_same(series(9, pixels=100, points=30).observations(), series(9, pixels=100, points=30).observations())
