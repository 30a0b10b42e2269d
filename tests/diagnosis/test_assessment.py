"""When the exposures of a run are assessed, and what is assumed until then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from filmed import Film, observed, wandering

from ospc import Frame, OnlineCalibrator
from ospc.correspondence.thumbnail import Thumbnail
from ospc.exposures import brightness_history, monitor
from ospc.exposures.evidence import evidence_of_images
from ospc.exposures.lag_choice import LagChoice
from ospc.exposures.monitor import ExposureMonitor
from ospc.exposures.verdicts import findings_from
from ospc.settings.exposures import FIRST_ASSESSMENT_CHANGES
from workers import preprocessor

SIZE = (64, 48)


def image(number: int) -> np.ndarray:
    """Return a view that moves across one large picture."""
    picture = np.random.default_rng(0).integers(40, 160, (12, 16)).repeat(16, 0).repeat(16, 1).astype(np.uint8)
    return picture[number % 90 : number % 90 + SIZE[1], number % 80 : number % 80 + SIZE[0]]


def thumbnail(number: int) -> Thumbnail:
    return preprocessor().thumbnail(Frame.of_array(image(number), 1.0, index=number))


def after(frames: int, choice: LagChoice = "auto") -> ExposureMonitor:
    """Return the monitor after ``frames`` frames of equal exposure."""
    exposures = ExposureMonitor(choice)
    for number in range(frames):
        exposures.table.append(1.0)
        exposures.history.observe(thumbnail(number))
        if exposures.assessment_is_due:
            exposures.adopt(exposures.findings())
    return exposures


def test_a_long_run_goes_on_being_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(brightness_history, "MAX_BRIGHTNESS_CHANGES", 50)
    judged = []
    monkeypatch.setattr(ExposureMonitor, "findings", lambda self: judged.append(len(self.table)) or found)
    found = findings_from(evidence_of_images((), np.zeros(3)))
    after(140)
    assert judged == [40, 59, 88, 131]


def test_a_change_is_measured_against_the_latest_certain_lag(monkeypatch: pytest.MonkeyPatch) -> None:
    """The change itself makes the lag over all frames uncertain."""
    film = Film(wandering(100, 5))
    certain = findings_from(evidence_of_images(observed(film)[0].changes, film.log_exposure))
    uncertain = findings_from(evidence_of_images((), np.zeros(3)))
    found, known_lags = iter([certain, uncertain]), []
    monkeypatch.setattr(ExposureMonitor, "findings", lambda _: next(found))
    monkeypatch.setattr(monitor, "detect_lag_change", lambda _changes, _exposures, known: known_lags.append(known))
    exposures = after(70)
    assert next(found, None) is None
    assert exposures.detect_lag_change(camera_changed=True) is None
    assert known_lags == [0]
    assert not exposures.table.trusted


@pytest.mark.parametrize(("choice", "lag"), [("auto", 2), (2, 2)])
def test_a_new_epoch_keeps_the_lag_and_trusts_nothing_yet(choice: LagChoice, lag: int) -> None:
    exposures = after(20, choice)
    exposures.table.lag_frames, exposures.table.trusted = lag, True
    exposures.begin_epoch(10)
    assert (exposures.table.lag_frames, exposures.table.trusted) == (lag, False)


def test_a_stated_lag_that_leaves_nothing_yet_does_not_end_the_run() -> None:
    calibrator = OnlineCalibrator(correct_lag=FIRST_ASSESSMENT_CHANGES + 6)
    assert all(calibrator.push(Frame.of_array(image(n), 1.0 + n % 3)) for n in range(FIRST_ASSESSMENT_CHANGES + 20))


@pytest.mark.parametrize(
    ("unexplained", "said"),
    [(3.0, "explain none of"), (0.998, "explain hardly any of"), (0.4, "explain only 60% of")],
)
def test_exposures_never_explain_less_than_none_of_the_changes(unexplained: float, said: str) -> None:
    film = Film(wandering(100))
    found = findings_from(evidence_of_images(observed(film)[0].changes, film.log_exposure))
    assert found.brightness is not None
    brightness = replace(found.brightness, unexplained_share=unexplained, fits_badly=True)
    lag = replace(found.lag, candidates=(0,), state="determined")
    evidence = replace(found.evidence, brightness=brightness, remaining_lag=lag)
    reason = findings_from(evidence).verdict.reason
    assert f"exposures fit poorly: they {said} the brightness changes; the rest" in reason
