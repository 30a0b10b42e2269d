"""Images lit only inside a circle: the surround is detected or masked, and not used."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ospc import OnlineCalibrator
from ospc.calibrator import drive
from ospc.methods import quick_fit
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.geometry import normalised, pixel_grid
from ospc.photometry.vignette import LogSplineVignette
from ospc.recording.frame import Frame
from ospc.simulation import SimulationSettings, frames, truth

SETTINGS = SimulationSettings(
    size=(240, 180), frames=30, speed=3.0, exposure="cycle", exposures_ms=(3.0, 6.0, 12.0, 24.0), response="srgb"
)
CIRCLE = 0.62
INSIDE = np.linalg.norm(normalised(pixel_grid(SETTINGS.size), SETTINGS.size), axis=-1) < CIRCLE


def circular(frame: Frame, *, flare: bool = False) -> Frame:
    random = np.random.default_rng(frame.index)
    dark = random.integers(0, 6, frame.image.shape, dtype=np.uint8) + np.uint8(60 * flare)
    return Frame.of_array(np.where(INSIDE, frame.image, dark), frame.exposure_ms, index=frame.index)


@pytest.fixture(scope="module")
def filmed() -> list[Frame]:
    return list(frames(SETTINGS))


def calibrated(filmed: list[Frame], *, masked: bool) -> Calibration:
    calibrator = OnlineCalibrator()
    for frame in filmed:
        seen = circular(frame)
        calibrator.push(replace(seen, mask=INSIDE) if masked else seen)
    return calibrator.calibration()


@pytest.fixture(scope="module", params=[False, True], ids=["found", "masked"])
def found(request: pytest.FixtureRequest, filmed: list[Frame]) -> Calibration:
    return calibrated(filmed, masked=request.param)


def test_the_vignette_is_known_where_there_is_an_image(found: Calibration) -> None:
    assert found.verdicts["vignette"].known
    assert found.vignette is not None
    inside = np.linalg.norm(normalised(pixel_grid(SETTINGS.size), SETTINGS.size), axis=-1) < CIRCLE - 0.03
    assert np.abs(found.vignette.image() - truth(SETTINGS).vignette.image())[inside].max() < 0.02


def test_nothing_is_made_up_beyond(found: Calibration) -> None:
    assert isinstance(found.vignette, LogSplineVignette)
    assert CIRCLE - 0.05 < found.vignette.limit < CIRCLE + 0.1
    # If the lens does illuminate more of the image, the stated deviations tell.
    beyond = PROFILE_RADII > CIRCLE + 0.1
    errors = [v.profile(PROFILE_RADII[beyond]) for v in (found.vignette, truth(SETTINGS).vignette)]
    assert np.all(np.abs(errors[0] - errors[1]) < 3 * found.vignette_sigma[beyond])
    values = found.vignette.image()
    assert values.min() >= 0.98 * values[INSIDE].min()
    assert values.max() <= 1.02 * values[INSIDE].max()


def test_the_response_is_found_all_the_same(found: Calibration) -> None:
    assert found.response is not None
    grey = np.linspace(0.2, 0.9, 8)
    ratio = found.response.inverse(grey) / truth(SETTINGS).response.inverse(grey)
    assert np.ptp(np.log(ratio)) < 0.05


def test_an_image_lit_everywhere_has_no_limit(filmed: list[Frame]) -> None:
    calibrator = OnlineCalibrator()
    for frame in filmed[:20]:
        calibrator.push(frame)
    vignette = calibrator.calibration().vignette
    assert isinstance(vignette, LogSplineVignette)
    assert vignette.limit == np.inf


def test_a_run_resumed_after_flare_in_the_surround_ends_the_same(
    filmed: list[Frame], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The flare hides the surround, but until the next quick fit, registration uses the vignette of the latest one.
    monkeypatch.setattr(quick_fit, "MAX_VIGNETTE_SIGMA", 1.0)
    shown = [circular(frame, flare=frame.index == 22) for frame in filmed]
    whole, begun = OnlineCalibrator(), OnlineCalibrator()
    drive(whole, shown)
    drive(begun, shown[:24])
    resumed = OnlineCalibrator.load_state(begun.save_state(tmp_path / "state.ospc"))
    drive(resumed, shown)
    assert resumed.calibration().as_dict() == whole.calibration().as_dict()


def test_the_limit_survives_saving(found: Calibration, tmp_path) -> None:
    again = Calibration.load(found.save(tmp_path / "calibration.json"))
    assert again.vignette == found.vignette


def test_beside_a_soft_edge_the_vignette_is_known_only_as_far_as_scene_points_reach(filmed: list[Frame]) -> None:
    distance = np.linalg.norm(normalised(pixel_grid(SETTINGS.size), SETTINGS.size), axis=-1)
    light, srgb = 1 / (1 + np.exp((distance - CIRCLE) / 0.015)), truth(SETTINGS).response
    calibrator = OnlineCalibrator()
    for frame in filmed:
        image = np.rint(255 * srgb(light * srgb.inverse(frame.image / 255))).astype(np.uint8)
        calibrator.push(Frame.of_array(image, frame.exposure_ms, index=frame.index))
    calibration = calibrator.calibration()
    assert calibration.verdicts["vignette"].known
    found, true = calibration.vignette, truth(SETTINGS).vignette.image() * light
    assert isinstance(found, LogSplineVignette)
    assert CIRCLE - 0.1 < found.limit < CIRCLE
    reached = distance < found.limit - np.hypot(*found.centre)
    assert np.abs(found.image() / true - 1)[reached].max() < 0.03
