"""When a live calibrator estimates on its own."""

import pytest

from calibrations import calibration
from ospc.calibrator import OnlineCalibrator
from ospc.live.status import ESTIMATE_GROWTH, FIRST_ESTIMATE, Findings


@pytest.mark.parametrize(("asked_at", "next_at"), [((), FIRST_ESTIMATE), ((30,), ESTIMATE_GROWTH * 30)])
def test_an_estimate_that_was_asked_for_puts_off_the_next(asked_at, next_at, monkeypatch):
    engine, estimated_at = OnlineCalibrator(), []
    found = Findings(engine, 0.005)
    monkeypatch.setattr(
        OnlineCalibrator, "calibration", lambda engine: estimated_at.append(processed) or calibration()
    )
    for processed in range(1, next_at + 2):
        monkeypatch.setattr(OnlineCalibrator, "processed", processed)
        monkeypatch.setattr(OnlineCalibrator, "frames", processed)
        if processed in asked_at:
            found.estimate(processed)
        found.follow(processed)
    assert estimated_at == [*asked_at, next_at]
