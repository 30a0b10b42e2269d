"""The independent sampler gives correct ratios from the true response, for any exposures."""

from __future__ import annotations

import numpy as np
import pytest

from ospc.calibrator import calibrate
from ospc.formats.dso import read_pcalib
from ospc.photometry.response import Response
from ospc.recording import open_recording
from ospc.recording.frame import Frame
from ospc.research.accuracy.real_video import SampledFrame, flat_pair, held_out_pairs
from ospc.research.scoring import predicted_ratio
from ospc.simulation import SimulationSettings, frames

GREYS = (5 / 255, 250 / 255)
SETTINGS = SimulationSettings(
    size=(400, 300),
    frames=4,
    fps=10.0,
    exposure="cycle",
    exposures_ms=(6.0, 12.0),
    vignette="none",
    seed=8,
    scene_seed=0,
)


@pytest.fixture(scope="module")
def sampled():
    return [SampledFrame.of(frame) for frame in frames(SETTINGS)]


def test_the_true_response_predicts_the_ratio(sampled):
    pair = flat_pair(sampled[0], sampled[1], GREYS, 1.0)
    assert pair.exposure_ratio == pytest.approx(0.5)
    assert len(pair.grey0) > 200
    assert np.log(predicted_ratio(pair, Response.gamma(2.2, 4097), None)) == pytest.approx(np.log(0.5), abs=0.01)


def test_the_order_of_the_frames_does_not_matter(sampled):
    there, back = (flat_pair(sampled[i], sampled[j], GREYS, 1.0) for i, j in ((1, 2), (2, 1)))
    log_k = [np.log(predicted_ratio(pair, Response.gamma(2.2, 4097), None)) for pair in (there, back)]
    assert log_k[0] == pytest.approx(-log_k[1], abs=0.01)


def test_limits_of_grey_and_of_radial_displacement_are_kept(sampled):
    pair = flat_pair(sampled[0], sampled[3], (0.2, 0.6), 0.005)
    assert np.all((np.minimum(pair.grey0, pair.grey1) > 0.2) & (np.maximum(pair.grey0, pair.grey1) < 0.6))
    middle = (np.array(SETTINGS.size) - 1) / 2
    radius = [
        np.linalg.norm(points - middle, axis=1) / np.linalg.norm(middle) for points in (pair.points0, pair.points1)
    ]
    assert np.max(np.abs(radius[0] - radius[1])) < 0.005


def test_frames_without_structure_give_nothing():
    plain = SampledFrame.of(Frame.of_array(np.full((60, 80), 90, np.uint8), 1.0))
    assert flat_pair(plain, plain, GREYS, 1.0) is None


def test_real_frames_agree_with_their_makers_calibration(real_data):
    place = real_data / "borealhdr_left"
    if not place.is_dir():
        pytest.skip(f"no real video at {place}")
    pairs = held_out_pairs(list(open_recording(place))[43:46])
    laboratory = read_pcalib(place / "pcalib.txt")
    assert len(pairs) == 3
    for pair in pairs:
        assert predicted_ratio(pair, laboratory, None) == pytest.approx(pair.exposure_ratio, rel=0.03)


def test_the_real_video_has_no_false_finding_and_its_makers_response(real_data):
    place = real_data / "borealhdr_left"
    if not place.is_dir():
        pytest.skip(f"no real video at {place}")
    made = calibrate(place)
    assert made.warnings == ()
    assert made.verdicts["response"].state == "identifiable"
    laboratory = read_pcalib(place / "pcalib.txt")
    found, expected = (
        np.log(response.inverse(0.75) / response.inverse(0.25)) for response in (made.response, laboratory)
    )
    assert found == pytest.approx(expected, abs=0.02)
