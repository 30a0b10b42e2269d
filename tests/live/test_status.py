"""When a live calibrator estimates on its own."""

from dataclasses import replace

import pytest

from calibrations import calibration
from ospc.calibrator import OnlineCalibrator
from ospc.engine.state import Epoch
from ospc.live.status import LiveFindings
from ospc.methods.change_detection import Change
from ospc.settings.live import ESTIMATE_GROWTH, FIRST_ESTIMATE_FRAMES, UNKNOWN_GROWTH


@pytest.mark.parametrize(
    ("asked_at", "converged", "next_at"),
    [
        ((), True, FIRST_ESTIMATE_FRAMES),
        ((30,), True, ESTIMATE_GROWTH * 30),
        # The status must not say for long that something is not identifiable if it has become so.
        ((40,), False, int(UNKNOWN_GROWTH * 40)),
    ],
)
def test_an_estimate_puts_off_the_next_one(asked_at, converged, next_at, monkeypatch):
    engine, estimated_at = OnlineCalibrator(), []
    known = replace(calibration(), converged=converged)
    found = LiveFindings(engine, 0.005)
    monkeypatch.setattr(OnlineCalibrator, "calibration", lambda engine: estimated_at.append(processed) or known)
    for processed in range(1, next_at + 2):
        monkeypatch.setattr(OnlineCalibrator, "processed", processed)
        monkeypatch.setattr(OnlineCalibrator, "frames", processed)
        if processed in asked_at:
            found.estimate(processed)
        found.follow(processed)
    assert estimated_at == [*asked_at, next_at]


def test_a_change_of_the_camera_begins_the_estimates_anew_however_long_it_ran_before(monkeypatch):
    engine, estimated_at, begun = OnlineCalibrator(), [], 9000
    known = replace(calibration(), converged=False)
    found = LiveFindings(engine, 0.005)
    monkeypatch.setattr(OnlineCalibrator, "calibration", lambda _: estimated_at.append(engine.processed) or known)
    engine._run.epochs = [Epoch(0, begun, None, Change(begun, begun, "response", "the response changed"))]
    for processed in range(begun, begun + 4 * FIRST_ESTIMATE_FRAMES):
        monkeypatch.setattr(OnlineCalibrator, "processed", processed)
        monkeypatch.setattr(OnlineCalibrator, "frames", processed)
        found.follow(processed)
    since = [at - begun for at in estimated_at]
    assert since[:2] == [FIRST_ESTIMATE_FRAMES, int(UNKNOWN_GROWTH * FIRST_ESTIMATE_FRAMES)]


def test_the_latest_calibration_names_a_change_until_the_next_one(monkeypatch):
    engine, known = OnlineCalibrator(), replace(calibration(), converged=True)
    found = LiveFindings(engine, 0.005)
    monkeypatch.setattr(OnlineCalibrator, "calibration", lambda _: known)
    found.estimate(1)
    engine._run.epochs = [Epoch(0, 9, None, Change(10, 20, "vignette", "the vignette changed by -20%"))]
    found.follow(21)
    assert "the vignette changed by -20%; the calibration is for earlier frames" in found.latest.warnings[-1]
    assert not found.latest.converged
    assert not found.latest.complete
