"""Charts put every value where its axis says, and never draw what is not finite."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ospc.report.svg import WIDTH, Chart, Scale, figure

ENDS = st.floats(1e-3, 1e3)


@given(low=ENDS, ratio=st.floats(1.01, 1e4), logarithmic=st.booleans(), share=st.floats(0, 1))
def test_a_place_on_an_axis_is_the_share_of_its_length(low, ratio, logarithmic, share):
    scale = Scale(low, low * ratio, logarithmic=logarithmic)
    value = low * ratio**share if logarithmic else low + share * (low * ratio - low)
    assert float(scale.place(value)) == pytest.approx(share, abs=1e-6)
    assert float(Scale(low * ratio, low, logarithmic=logarithmic).place(value)) == pytest.approx(1 - share, abs=1e-6)


@given(low=ENDS, ratio=st.floats(1.001, 1e5), logarithmic=st.booleans(), most=st.integers(3, 8))
def test_ticks_are_few_round_and_on_the_axis(low, ratio, logarithmic, most):
    high = low * ratio
    ticks = Scale(low, high, logarithmic=logarithmic).ticks(most)
    assert 1 <= len(ticks) <= most + 1
    assert all(low * 0.998 <= tick <= high * 1.002 for tick in ticks)
    assert all(float(f"{tick:.6g}") == pytest.approx(tick) for tick in ticks)


VALUES = arrays(np.float64, 7, elements=st.floats(-1e300, 1e300) | st.just(np.nan) | st.just(np.inf))


@given(y=VALUES, low=VALUES)
def test_only_finite_numbers_are_drawn(y, low):
    chart = Chart(Scale(0, 6), Scale(-1, 1), "any")
    x = np.arange(7.0)
    chart.line(x, y, "blue")
    chart.steps(x, y, "blue")
    chart.band(x, low, y, "blue")
    chart.points(x, y, "blue")
    chart.bars(np.arange(8.0), y, "blue")
    chart.cells(np.arange(8.0), [0, 1], y[None], "blue")
    numbers = re.findall(r"[-\d.]+(?:e[-+]?\d+)?|nan|inf", " ".join(re.findall(r' d="([^"]*)"', chart.svg())))
    assert "nan" not in numbers
    assert "inf" not in numbers
    assert max((abs(float(n)) for n in numbers), default=0) <= 4 * WIDTH


def test_a_line_breaks_where_nothing_is_known():
    chart = Chart(Scale(0, 4), Scale(0, 1), "broken")
    chart.line(np.arange(5), [0, 1, np.nan, 1, 0], "blue")
    (outline,) = re.findall(r'class="line blue" d="([^"]*)"', chart.svg())
    assert outline.count("M") == 2


def test_a_grid_is_filled_the_more_strongly_the_larger_the_value():
    chart = Chart(Scale(0, 3), Scale(0, 1), "grid")
    chart.cells([0, 1, 2, 3], [0, 1], np.array([[0.0, 0.5, 1.0]]), "green")
    strengths = [float(s) for s in re.findall(r'fill-opacity="([\d.]+)"', chart.svg())]
    assert len(strengths) == 2
    assert strengths == sorted(strengths)


def test_texts_are_escaped():
    chart = Chart(Scale(0, 1, "<x>"), Scale(0, 1, "a & b"), '"title"')
    drawn = figure([chart.svg()], [("line blue", "<key>")], "<caption>")
    for raw in ("<x>", "a & b", "<key>", "<caption>", '""'):
        assert raw not in drawn


def test_many_points_are_thinned_out():
    chart = Chart(Scale(0, 1), Scale(0, 1), "many")
    chart.points(np.linspace(0, 1, 100_000), np.linspace(0, 1, 100_000), "blue")
    assert 500 < chart.svg().count("h0") <= 1500
