"""Rigs: overlapping views determine the relative scales of the cameras."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from ospc.cli.rig_scale import RIG_NAME, add_rig_scale
from ospc.errors import NotObservableError
from ospc.photometry.calibration import Calibration
from ospc.pooling.rig import PairScale, _solved, rig_scale
from ospc.recording import open_recording
from ospc.simulation import SimulationSettings, simulate

EXPOSURES = (3.0, 6.0, 12.0)
FRAMES = 4
CAMERAS = {
    # A camera whose sensor needs a longer exposure for the same light has a smaller scale.
    "left": {"reference_exposure_ms": 10.0, "response": "srgb", "horizontal_fov_deg": 75.0},
    "right": {"reference_exposure_ms": 16.0, "response": "gamma2.2", "horizontal_fov_deg": 68.0},
    "rear": {"reference_exposure_ms": 10.0, "response": "srgb", "scene_seed": 1},
}


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """Three cameras that move together; the third one sees a different scene."""
    place = tmp_path_factory.mktemp("rig")
    recordings, calibrations = {}, {}
    for name, own in CAMERAS.items():
        settings = {"exposure": "cycle", "exposures_ms": EXPOSURES, "scene_seed": 0, "seed": 2} | own
        made = simulate(place / name, SimulationSettings(size=(320, 240), frames=FRAMES, **settings))
        recordings[name] = open_recording(place / name)
        calibrations[name] = Calibration((320, 240), made.response, made.vignette)
    return recordings, calibrations


@pytest.fixture(scope="module")
def found(rig):
    return rig_scale(*rig)


def test_the_scale_is_that_of_the_sensors(found):
    expected = 10.0 / 16.0
    assert found.reference == "left"
    assert found.scale["left"] == 1.0
    assert abs(np.log(found.scale["right"] / expected)) < 0.02
    assert abs(found.scale["right"] - expected) < 4 * found.sigma["right"]


def test_a_camera_that_sees_something_else_is_left_out(found):
    assert "rear" not in found.scale
    assert "overlaps with no camera" in found.left_out["rear"]


def test_a_camera_that_is_not_calibrated_is_left_out_and_two_are_needed(rig):
    recordings, calibrations = rig
    partly = calibrations | {"rear": replace(calibrations["rear"], vignette=None)}
    names = ("left", "rear")
    with pytest.raises(NotObservableError, match=r"at least two cameras .* only one"):
        rig_scale({name: recordings[name] for name in names}, partly)


def test_cameras_that_recorded_at_other_times_have_nothing_in_common(rig):
    recordings, calibrations = rig

    class Later:
        def __init__(self, recording):
            self._recording = recording
            self.stamps_s, self.exposures_ms = recording.stamps_s + 100, recording.exposures_ms

        def __iter__(self):
            return iter(self._recording)

        def __len__(self):
            return len(self._recording)

    apart = {"left": recordings["left"], "right": Later(recordings["right"])}
    assert "time stamps of all cameras must come from one clock" in rig_scale(apart, calibrations).left_out["right"]


def test_estimated_exposures_of_two_cameras_have_no_common_scale(rig):
    recordings, calibrations = rig
    estimated = replace(calibrations["right"], exponent_sigma=0.1)
    found = rig_scale(recordings, calibrations | {"right": estimated})
    assert "right" not in found.scale
    assert "exposures are unknown" in found.left_out["right"]


def test_loops_are_closed_by_least_squares():
    pairs = (PairScale(("a", "b"), 0.1, 0.01, 5, 99), PairScale(("b", "c"), 0.1, 0.01, 5, 99))
    exact = _solved(("a", "b", "c"), pairs, {})
    assert np.log(exact.scale["c"]) == pytest.approx(-0.2)
    assert exact.misfit == 0.0
    loop = _solved(("a", "b", "c"), (*pairs, PairScale(("a", "c"), 0.26, 0.01, 5, 99)), {})
    assert np.log(loop.scale["c"]) == pytest.approx(-0.24)
    assert loop.misfit == pytest.approx(2.0)
    assert loop.sigma["c"] < exact.sigma["c"]


def test_it_is_written_as_plain_json(found, tmp_path):
    content = json.loads(found.save(tmp_path / "rig.json").read_text())
    assert content["schema"] == "ospc-rig/1"
    assert content["scale"] == found.scale
    assert content["pairs"][0]["cameras"] == ["left", "right"]


def test_the_command_writes_it_next_to_the_cameras_and_prints_it(rig, found, tmp_path, capsys):
    recordings, calibrations = rig
    for name, calibration in calibrations.items():
        (tmp_path / name).mkdir()
        calibration.save(tmp_path / name / "calibration.json")
    openers = {name: (lambda recording=recording: recording) for name, recording in recordings.items()}
    content = add_rig_scale(tmp_path, openers, prints_text=True)
    assert content == json.loads((tmp_path / RIG_NAME).read_text()) == json.loads(json.dumps(found.as_dict()))
    said = capsys.readouterr().out
    assert f"right: {found.scale['right']:.4f} ±" in said
    assert "rear: unknown, its view overlaps with no camera" in said
    (tmp_path / "right" / "calibration.json").unlink()
    (tmp_path / "rear" / "calibration.json").unlink()
    assert "error" in add_rig_scale(tmp_path, openers, prints_text=True)
