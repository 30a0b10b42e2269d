"""A preview during a run is close to the truth, and taking it changes nothing."""

from __future__ import annotations

import numpy as np
import pytest

from ospc import OnlineCalibrator, open_recording
from ospc.photometry.geometry import pixels_of
from ospc.simulation import SimulationSettings, simulate

SIZE = (240, 180)
FRAMES = 25


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return a calibrator previewed after every third frame, one without previews, the truth and the previews."""
    place = tmp_path_factory.mktemp("simulated") / "r"
    settings = SimulationSettings(size=SIZE, frames=FRAMES, exposure="sweep", exposure_min_ms=2, exposure_max_ms=16)
    truth = simulate(place, settings)
    watched, alone = OnlineCalibrator(), OnlineCalibrator()
    previews = []
    for frame in open_recording(place):
        watched.push(frame)
        if frame.index % 3 == 0:
            previews.append(watched.preview())
        alone.push(frame)
    return watched, alone, truth, previews


def test_before_the_first_pair_there_is_none(run):
    assert run[3][0] is None
    assert OnlineCalibrator().preview() is None
    assert OnlineCalibrator("paper").preview() is None


def test_a_preview_does_not_change_the_result(run):
    watched, alone, *_ = run
    one, other = watched.calibration().as_dict(), alone.calibration().as_dict()
    assert one == other


def test_it_converges_to_the_truth_and_says_how_far_it_is(run):
    _, _, truth, previews = run
    last = previews[-1]
    levels = np.linspace(0.1, 0.6, 20)
    error = np.abs(last.response.inverse(levels) - truth.response.inverse(levels))
    assert error.max() < 0.05
    spreads = [p.response.inverse_sigma.mean() for p in previews if p is not None and p.response is not None]
    assert spreads[-1] <= spreads[0]
    assert last.vignette_sigma.shape == (51,)


def test_coverage_grows_with_the_pairs(run):
    previews = [p for p in run[3] if p is not None]
    counts = [p.coverage.by_grey.sum() for p in previews]
    assert counts == sorted(counts)
    assert previews[-1].pairs >= 20


def test_the_latest_pair_is_in_the_image_and_shows_the_exposure_ratio(run):
    previews = [p for p in run[3] if p is not None and p.latest is not None and p.fit is not None]
    errors = []
    for preview in previews:
        latest, log_irradiance = preview.latest, preview.fit.log_irradiance(preview.latest)
        points = pixels_of(latest.position, SIZE)
        assert np.all((points >= 0) & (points <= np.array(SIZE) - 1))
        assert np.all(latest.frame[::2] < latest.frame[1::2])
        if len(latest.starts) > 100:
            log_ratio = np.median(log_irradiance[::2] - log_irradiance[1::2])
            errors.append(log_ratio - (latest.log_exposure[0] - latest.log_exposure[1]))
    assert np.median(np.abs(errors)) < 0.02
