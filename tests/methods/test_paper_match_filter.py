"""The direction filter treats all directions equally and decides block by block."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ospc.methods.paper import follows_its_block
from ospc.settings import PaperSettings

SIZE = (300, 200)
seeds = st.integers(0, 2**32 - 1)
BLOCKS = 3
SETTINGS = replace(PaperSettings(), filter_blocks=BLOCKS)
ANY_LENGTH = replace(SETTINGS, filter_length_sigmas=1e9)


def matches(seed, count=150):
    """Return points and displacements: a common noisy motion and some in random directions."""
    random = np.random.default_rng(seed)
    points = random.uniform(0, 1, (count, 2)) * SIZE
    direction = random.uniform(-np.pi, np.pi) + random.normal(0, 0.3, count)
    astray = random.random(count) < 0.3
    direction[astray] = random.uniform(-np.pi, np.pi, astray.sum())
    return points, direction, random.uniform(5, 15, count)


def survivors(points, direction, length, *, size=SIZE, settings=SETTINGS):
    displacement = length[:, None] * np.stack([np.cos(direction), np.sin(direction)], axis=1)
    return follows_its_block(points, points + displacement, size, settings)


def blocks_of(points, blocks=BLOCKS, size=SIZE):
    cell = np.floor(points / np.array(size) * blocks).astype(int)
    return cell[:, 0] + blocks * cell[:, 1]


@given(seeds, st.floats(-np.pi, np.pi))
def test_turning_all_directions_changes_nothing(seed, angle):
    points, direction, length = matches(seed)
    kept = survivors(points, direction, length)
    np.testing.assert_array_equal(survivors(points, direction + angle, length), kept)


@pytest.mark.parametrize("axis", [0, np.pi / 2, np.pi, -np.pi / 2, np.pi / 10, -np.pi + np.pi / 10])
def test_a_common_motion_is_kept_together_whichever_way_it_points(axis):
    random = np.random.default_rng(1)
    points = random.uniform(0, 1, (400, 2)) * SIZE
    direction = axis + random.uniform(-0.2, 0.2, 400)
    assert survivors(points, direction, random.uniform(5, 15, 400)).all()


@given(seeds)
def test_mirroring_the_images_changes_nothing(seed):
    points, direction, length = matches(seed)
    kept = survivors(points, direction, length)
    mirrored = survivors([SIZE[0], 0] + points * [-1, 1], np.pi - direction, length)
    # If the bins on either side of a block's mean direction hold equally many matches, either may be kept.
    number = [np.bincount(blocks_of(points)[k], minlength=BLOCKS**2) for k in (kept, mirrored)]
    np.testing.assert_array_equal(*number)
    assert np.mean(kept == mirrored) > 0.75


@given(seeds)
def test_the_order_of_the_matches_does_not_matter(seed):
    points, direction, length = matches(seed)
    order = np.random.default_rng(seed).permutation(len(points))
    kept = survivors(points, direction, length)
    np.testing.assert_array_equal(survivors(points[order], direction[order], length[order]), kept[order])


@given(seeds, st.integers(2, 5))
def test_the_scale_of_the_image_does_not_matter(seed, scale):
    points, direction, length = matches(seed)
    larger = survivors(points * scale, direction, length * scale, size=(SIZE[0] * scale, SIZE[1] * scale))
    np.testing.assert_array_equal(larger, survivors(points, direction, length))


@given(seeds)
def test_survivors_of_a_block_point_one_way_and_outnumber_any_other_such_group(seed):
    points, direction, length = matches(seed)
    kept = survivors(points, direction, length, settings=ANY_LENGTH)
    for block in range(BLOCKS**2):
        inside = blocks_of(points) == block
        if inside.sum() <= 5:
            assert kept[inside].all()
            continue
        ways = direction[inside & kept]
        spread = np.angle(np.exp(1j * (ways - ways[0])))
        assert np.ptp(spread) <= 2 * np.pi / 10 + 1e-9
        # The block's matches fall into ten bins, so the fullest has at least a tenth of them.
        assert len(ways) * 10 >= inside.sum()


@given(seeds)
def test_blocks_decide_for_themselves(seed):
    points, direction, length = matches(seed)
    kept = survivors(points, direction, length, settings=ANY_LENGTH)
    block = blocks_of(points)
    for number in np.unique(block):
        alone = block == number
        np.testing.assert_array_equal(
            survivors(points[alone], direction[alone], length[alone], settings=ANY_LENGTH), kept[alone]
        )


@pytest.mark.parametrize(("count", "left"), [(5, 5), (6, 4)])
def test_only_blocks_of_more_than_five_matches_are_judged(count, left):
    points = np.full((count, 2), 50.0) + np.arange(count)[:, None]
    direction = np.zeros(count)
    direction[:2] = 2.0, -2.0
    assert survivors(points, direction, np.full(count, 8.0)).sum() == left


@given(seeds, st.floats(0.5, 3.0))
def test_no_survivor_is_longer_than_the_rule_allows(seed, sigmas):
    points, direction, length = matches(seed)
    kept = survivors(
        points, np.zeros_like(direction), length, settings=replace(SETTINGS, filter_length_sigmas=sigmas)
    )
    np.testing.assert_array_equal(kept, length <= length.mean() + sigmas * length.std())


def test_points_on_the_far_border_belong_to_the_last_block():
    corner = np.tile(np.array(SIZE, dtype=float), (8, 1))
    assert survivors(corner, np.zeros(8), np.ones(8)).all()


def test_empty_and_static_points_are_valid():
    empty = np.empty((0, 2))
    assert follows_its_block(empty, empty, SIZE, PaperSettings()).shape == (0,)
    still = np.full((8, 2), 10.0)
    assert follows_its_block(still, still, SIZE, PaperSettings()).all()
