"""Stand-ins have the specified camera and exposures."""

from __future__ import annotations

import numpy as np
import pytest

from ospc.errors import FormatError
from ospc.photometry.vignette import radial_profile
from ospc.research.experiments.sources import EXPOSURES, RESPONSE, VIGNETTE, stand_ins
from ospc.research.source import GivenSource
from ospc.simulation import SimulationSettings, simulate


@pytest.fixture
def data(tmp_path):
    """Return a folder of invented reference data."""
    (tmp_path / "params").mkdir()
    grey = np.linspace(0, 255, 256)
    (tmp_path / RESPONSE).write_text(" ".join(f"{v:.6f}" for v in grey**1.5 / 255**0.5) + "\n")
    radius = np.linspace(0, 1, 257)
    rows = "\n".join(f"{r:.5f},{1 - 0.4 * r**2:.5f}" for r in radius)
    (tmp_path / VIGNETTE).write_text("# radius,vignette\n" + rows + "\n")
    course = np.concatenate([np.full(50, 2.0), np.geomspace(1, 8, 50), np.geomspace(1, 2, 50)])
    lines = "\n".join(f"{i} {i / 20} {e:.4f}" for i, e in enumerate(course))
    (tmp_path / EXPOSURES).write_text("# name stamp exposure\n" + lines + "\n")
    return tmp_path


def test_the_given_camera_and_the_liveliest_exposures_are_filmed_with(data):
    first, second = stand_ins(2, 50, (160, 120), data)
    assert first.truth().response.inverse(0.5) == pytest.approx(0.5**1.5, abs=1e-3)
    profile = radial_profile(first.truth().vignette)
    np.testing.assert_allclose(profile, 1 - 0.4 * ((np.arange(50) + 0.5) / 50) ** 2, atol=0.01)
    courses = [[f.exposure_ms for f in source.frames()] for source in (first, second)]
    np.testing.assert_allclose(courses[0], np.geomspace(1, 8, 50), rtol=1e-3)
    np.testing.assert_allclose(courses[1], np.geomspace(1, 2, 50), rtol=1e-3)


def test_without_data_the_camera_is_analytic():
    one, two = stand_ins(2, 4, (64, 48))
    frames = [list(source.frames()) for source in (one, two)]
    assert len(frames[0]) == one.count == 4
    assert not np.array_equal(frames[0][0].image, frames[1][0].image)
    again = next(iter(one.frames()))
    np.testing.assert_array_equal(again.image, frames[0][0].image)
    assert one.truth().response.inverse(88 / 255) == pytest.approx(0.068, abs=1e-3)


def test_a_given_recording_brings_its_truth(tmp_path):
    simulate(tmp_path / "room", SimulationSettings(size=(64, 48), frames=5))
    source = GivenSource.of(tmp_path / "room", 3)
    assert (source.name, source.count) == ("room", 3)
    assert len(list(source.frames())) == 3
    assert source.truth().response is not None
    assert source.truth().vignette is not None
    (tmp_path / "room" / "pcalib.txt").unlink()
    with pytest.raises(FormatError, match="pcalib"):
        GivenSource.of(tmp_path / "room")


def test_impossible_simulations_are_refused(data):
    with pytest.raises(FormatError, match="fewer frames"):
        stand_ins(1, 500, (64, 48), data)
    (data / VIGNETTE).write_text("0,1\n1,x\n")
    with pytest.raises(FormatError, match="radius,V"):
        stand_ins(1, 10, (64, 48), data)
    (data / VIGNETTE).write_text("0,1\n1,0.5\n")
    with pytest.raises(FormatError, match="increasing"):
        stand_ins(1, 10, (64, 48), data)


def test_the_narrow_camera_of_the_reference_data_is_used(real_data):
    (source,) = stand_ins(1, 60, (96, 72), real_data)
    assert source.truth().response.inverse(88 / 255) == pytest.approx(0.068, abs=0.02)
    profile = radial_profile(source.truth().vignette)
    assert 0.2 < profile[-1] < 0.8
    exposures = [f.exposure_ms for f in source.frames()]
    assert max(exposures) > 2 * min(exposures)
