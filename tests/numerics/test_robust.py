"""Medians of groups are those of their members, in any order."""

from __future__ import annotations

import numpy as np
import pytest

from ospc.numerics.robust import medians


@pytest.mark.parametrize("groups", [1, 7])
def test_the_median_of_each_group_is_that_of_its_members(groups: int) -> None:
    random = np.random.default_rng(groups)
    group = random.permutation(np.append(np.arange(groups), random.integers(0, groups, 50)))
    values = random.normal(size=len(group))
    before = values.copy()
    expected = [np.median(values[group == number]) for number in range(groups)]
    assert np.array_equal(medians(values, group), expected)
    assert np.array_equal(values, before)
