"""Tables of the coverage of observations and of their residuals."""

from __future__ import annotations

import json

import numpy as np
import pytest

from ospc.errors import FormatError
from ospc.methods.coverage import coverage_of
from ospc.observations import ExposedObservations
from ospc.photometry.coverage import Coverage
from ospc.photometry.grey_range import GreyRange

SIZE = (640, 480)


def observations(points: int = 4000, seed: int = 0) -> ExposedObservations:
    """Return points seen twice at random positions, at exposures of 2 and 8 ms."""
    random = np.random.default_rng(seed)
    n = 2 * points
    return ExposedObservations(
        grey=random.random(n),
        log_exposure=np.log(np.tile([2.0, 8.0], points)),
        log_exposure_rate=np.zeros(2 * points),
        position=random.uniform(-0.55, 0.55, (n, 2)),
        gradient=np.zeros(n),
        grey_variance=np.zeros(n),
        grey_third_moment=np.zeros(n),
        frame_moments=np.zeros((n, 6)),
        surround_moments=np.zeros((n, 2, 7)),
        frame=np.tile([0, 1], points),
        point=np.repeat(np.arange(points), 2),
        group=np.zeros(n, np.int64),
    )


def test_every_sighting_is_counted_once_by_grey_and_every_pair_by_radius():
    coverage = coverage_of(observations(), None, SIZE)
    assert coverage.grey_exposure.sum() == 8000
    assert coverage.radius_radius.sum() == 4000
    assert coverage.residual_by_grey is None
    assert coverage.exposure_edges_ms.shape == (3,)
    np.testing.assert_array_equal(coverage.grey_exposure.sum(axis=1), [4000, 4000])
    radius = np.linalg.norm(observations().position[1::2], axis=1)
    np.testing.assert_array_equal(coverage.by_radius, np.histogram(radius, 20, (0, 1))[0])


def test_grey_levels_are_those_of_the_images():
    """Observations are stretched to a limited range, but reports and advice speak of the grey levels of images."""
    limited = GreyRange(0.25, 0.75)
    coverage = coverage_of(observations(), None, SIZE, limited)
    assert coverage.by_grey[:8].sum() == coverage.by_grey[24:].sum() == 0
    assert coverage.by_grey[8:24].all()
    assert not any("grey" in gap for gap in coverage.gaps(255, limited))
    assert any("0–64, 191–255" in gap for gap in coverage.gaps(255))


def test_tables_survive_their_dictionary():
    coverage = coverage_of(observations(), None, SIZE)
    again = Coverage.from_dict(json.loads(json.dumps(coverage.as_dict(), allow_nan=False)))
    np.testing.assert_array_equal(again.grey_exposure, coverage.grey_exposure)
    np.testing.assert_array_equal(again.exposure_edges_ms, coverage.exposure_edges_ms)


def test_unknown_residuals_come_back_as_nan():
    by_grey = np.full((32, 3), np.nan)
    by_grey[4] = (-0.01, 0.0, 0.01)
    known = Coverage(np.ones(2), np.zeros((1, 32), np.int64), np.zeros((20, 20), np.int64), by_grey)
    again = Coverage.from_dict(json.loads(json.dumps(known.as_dict(), allow_nan=False)))
    np.testing.assert_array_equal(again.residual_by_grey, by_grey)
    assert again.residual_by_place is None


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("exposure_edges_ms", [1.0]),
        ("exposure_edges_ms", 1.0),
        ("grey_exposure", 1),
        ("radius_radius", [1, 2, 3]),
        ("grey_exposure", [1, 2]),
        ("radius_radius", [[1, 2, 3]]),
        ("residual_by_grey", [[0.0, 0.0, 0.0]]),
        ("residual_by_place", [0.0]),
    ],
)
def test_tables_that_do_not_fit_together_are_refused(name, value):
    content = coverage_of(observations(), None, SIZE).as_dict()
    with pytest.raises(FormatError):
        Coverage.from_dict(content | {name: value})


def test_gaps_are_named_by_their_ends():
    grey, radius = np.full((6, 32), 100), np.full((20, 20), 100)
    grey[:, :4] = 0
    radius[:, -2:] = radius[-2:] = 0
    holes = Coverage(np.geomspace(1, 10, 7), grey, radius)
    assert "grey levels 0–32:" in holes.gaps(255)[0]
    assert "grey levels 0–512:" in holes.gaps(4095)[0]
    assert "radii 0.90–1.00 " in holes.gaps(255)[1]
    assert Coverage(holes.exposure_edges_ms, grey + 100, radius + 100).gaps(255) == ()


def test_tables_that_would_take_much_memory_are_refused():
    content = coverage_of(observations(), None, SIZE).as_dict()
    many = {"radius_radius": [[0] * 129] * 129, "residual_by_radius": None}
    with pytest.raises(FormatError, match="too large"):
        Coverage.from_dict(content | many)
