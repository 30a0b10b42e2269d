"""The report of a check on recordings with known defects."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from filmed import LARGE, LARGEST, SIZE, Film, jumping, wandering

from ospc.calibrator import calibrate
from ospc.diagnosis import RecordingReport, check_recording
from ospc.errors import RecordingError, SettingError
from ospc.exposures import brightness_history
from ospc.methods.maximum_likelihood import MaximumLikelihoodMethod
from ospc.recording import ArrayRecording
from ospc.recording.derived import masked

FRAMES = 50


def check(**film) -> RecordingReport:
    chosen = {"log_exposure": wandering(FRAMES), **film}
    return check_recording(Film(**chosen).recording())


@pytest.fixture(scope="module")
def good() -> RecordingReport:
    return check(log_exposure=wandering(80, seed=0), size=LARGE)


@pytest.fixture(scope="module")
def still() -> RecordingReport:
    return check(speed_px=0.0, log_exposure=wandering(40), size=LARGEST)


@pytest.fixture
def no_pairs(monkeypatch) -> None:
    """Skip the comparison of frame pairs, which takes most of the time."""
    monkeypatch.setattr(MaximumLikelihoodMethod, "push", lambda *_: None)


def states(report: RecordingReport) -> dict[str, str]:
    return {name: verdict.state for name, verdict in report.verdicts.items()}


def said(report: RecordingReport, *words: str) -> bool:
    return any(all(word in note for word in words) for note in report.notes)


def test_a_good_recording_is_good_in_every_respect(good: RecordingReport) -> None:
    assert states(good)["response"] == states(good)["exposures"] == "identifiable"
    assert states(good)["vignette"] != "not identifiable"
    assert good.exposure_lag_frames == 0
    assert good.exposures.brightness is not None
    assert not good.exposures.brightness.stale
    assert not good.exposures.brightness.jumps
    assert not good.exposures.brightness.flicker
    assert good.exposures.brightness.unexplained_share < 0.02
    assert (good.timing.dropped_frames, good.timing.duplicates) == (0, 0)
    assert good.notes == ()


def test_a_slope_of_the_response_is_found_without_knowing_it(good: RecordingReport) -> None:
    assert good.exposures.lag.fit is not None
    assert np.median(good.exposures.lag.fit.slopes) == pytest.approx(1 / 2.2, rel=0.1)


@pytest.mark.usefixtures("no_pairs")
@pytest.mark.parametrize("lag", [-2, 3])
def test_a_lag_is_found_and_reported(lag: int) -> None:
    report = check(lag=lag, seed=lag + 3)
    assert (report.exposure_lag_frames, report.exposures.corrected_frames) == (lag, lag)
    assert said(report, f"{abs(lag)} frame", "late" if lag > 0 else "early")
    assert report.exposures.warnings == ()


def test_constant_exposures_leave_no_response() -> None:
    report = check(log_exposure=np.zeros(FRAMES))
    assert report.exposure_lag_frames is None
    assert states(report)["response"] == states(report)["vignette"] == "not identifiable"
    assert states(report)["exposures"] == "identifiable"
    assert "auto exposure" in report.verdicts["response"].remedy


def test_constant_metadata_of_a_camera_that_adapts_are_stale() -> None:
    report = check(log_exposure=np.zeros(FRAMES), hidden_log_gain=wandering(FRAMES))
    assert report.exposures.brightness is not None
    assert report.exposures.brightness.stale
    assert states(report)["exposures"] == states(report)["response"] == "not identifiable"
    assert "stale" in report.verdicts["exposures"].reason


@pytest.mark.usefixtures("no_pairs")
@pytest.mark.parametrize("seed", [2, 5])
def test_the_drift_is_that_at_constant_exposure(seed: int) -> None:
    exact = wandering(FRAMES, seed, step=0.2)
    half_stop = np.log(2) / 2
    rounded = np.rint(exact / half_stop) * half_stop
    report = check(log_exposure=rounded, hidden_log_gain=exact - rounded)
    constant = np.split(exact, np.flatnonzero(np.diff(rounded)) + 1)
    assert report.exposures.brightness is not None
    # The logarithm of a grey level changes by no more than that of the light.
    assert 0 < report.exposures.brightness.drift_at_constant_exposure_log < max(map(np.ptp, constant))


def test_exposures_of_another_recording_are_never_given_a_lag() -> None:
    report = check(hidden_log_gain=wandering(FRAMES, 50) - wandering(FRAMES))
    assert report.exposure_lag_frames is None
    assert states(report)["exposures"] != "identifiable"
    assert states(report)["response"] != "identifiable"


@pytest.mark.usefixtures("no_pairs")
def test_jumps_of_a_hidden_gain_are_reported() -> None:
    gain = np.where(np.arange(FRAMES) < 40, 0.0, np.log(1.5))
    report = check(hidden_log_gain=gain)
    assert report.exposures.brightness is not None
    assert [jump.frame for jump in report.exposures.brightness.jumps] == [40]
    assert said(report, "jumps by +", "at frame 40", "gain")
    assert report.verdicts["exposures"].state == "marginal"
    assert "at frame 40" in report.verdicts["exposures"].reason


def test_a_camera_that_stands_still_shows_no_vignette(still: RecordingReport) -> None:
    assert still.motion.stationary
    assert states(still)["vignette"] == "not identifiable"
    assert states(still)["response"] == "identifiable"


@pytest.mark.usefixtures("no_pairs")
def test_flicker_is_found_with_its_frequency() -> None:
    cycles = 0.23
    flicker = 0.05 * np.sin(2 * np.pi * cycles * np.arange(FRAMES))
    report = check(hidden_log_gain=flicker)
    assert report.exposures.brightness is not None
    assert report.exposures.brightness.flicker[0].cycles_per_frame == pytest.approx(cycles, abs=0.005)
    # Grey changes by the slope of the response times the change of ln of the light.
    assert report.exposures.brightness.flicker[0].brightness_amplitude == pytest.approx(0.05 / 2.2, rel=0.25)
    assert said(report, "flickers")


@pytest.mark.usefixtures("no_pairs")
def test_saturation_and_darkness_are_reported() -> None:
    bright = check(log_exposure=wandering(FRAMES) + 1.4)
    assert said(bright, "saturated")
    dark = check(log_exposure=wandering(FRAMES) - 4.5, gamma=1.0)
    assert said(dark, "black")


def test_grey_levels_that_hardly_vary_leave_the_response_unknown() -> None:
    report = check(log_exposure=0.1 * wandering(FRAMES) - 3.2, gamma=1.0, noise=0.2)
    assert report.pixels.covered_grey.mean() < 0.4
    assert states(report)["response"] != "identifiable"


@pytest.mark.usefixtures("no_pairs")
def test_a_disc_and_a_border_are_distinguished() -> None:
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    disc = np.hypot(x - SIZE[0] / 2, y - SIZE[1] / 2) > SIZE[1] * 0.48
    report = check(black=disc, log_exposure=wandering(40))
    assert report.pixels.surround == "disc"
    assert report.pixels.surround_share == pytest.approx(disc.mean(), abs=0.06)
    report = check(black=y < 9, log_exposure=wandering(40))
    assert report.pixels.surround == "border"
    assert report.pixels.surround_share == pytest.approx(9 / SIZE[1], abs=0.02)


@pytest.mark.usefixtures("no_pairs")
def test_what_is_masked_is_not_looked_at() -> None:
    recording = Film(wandering(50)).recording()
    lamp = np.broadcast_to(np.arange(SIZE[0]) > SIZE[0] * 0.7, SIZE[::-1])
    images = [np.where(lamp, 255, frame.image).astype(np.uint8) for frame in recording]
    spoiled = ArrayRecording(images, recording.exposures_ms, recording.stamps_s)
    assert check_recording(spoiled).pixels.saturated_share > 0.25
    report = check_recording(masked(spoiled, ~lamp))
    assert report.pixels.saturated_share < 0.05
    assert report.exposure_lag_frames == 0


@pytest.mark.usefixtures("no_pairs")
def test_all_repeated_frames_are_counted_however_few_are_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(brightness_history, "MAX_REPEATED_FRAMES", 3)
    recording = Film(wandering(60)).recording()
    images = [frame.image for frame in recording]
    images[1::2] = images[::2]
    report = check_recording(ArrayRecording(images, np.repeat(recording.exposures_ms[::2], 2), np.arange(60) / 20))
    assert (report.timing.duplicates, report.timing.duplicate_frames) == (30, (1, 3, 5))
    assert report.as_dict()["timing"]["duplicate_frames"] == 30
    assert said(report, "30 of 59 frames repeat", "frame 1:")


@pytest.mark.usefixtures("no_pairs")
def test_repeated_and_missing_frames_are_counted() -> None:
    recording = Film(wandering(60)).recording()
    images = [frame.image for frame in recording]
    images[20] = images[19]
    stamps = np.arange(60) / 20 + np.where(np.arange(60) >= 30, 0.1, 0.0)
    report = check_recording(ArrayRecording(images, recording.exposures_ms, stamps))
    assert (report.timing.duplicates, report.timing.duplicate_frames) == (1, (20,))
    assert (report.timing.gaps, report.timing.dropped_frames) == (1, 2)
    assert said(report, "1 of 59 frames repeat", "frame 20")
    assert said(report, "2 frames missing in 1 gap", "20 frames a second")


@pytest.mark.usefixtures("no_pairs")
def test_padded_bits_are_reported() -> None:
    recording = Film(wandering(40), max_grey=1023).recording()
    padded = ArrayRecording([frame.image << 2 for frame in recording], recording.exposures_ms, max_grey=4095)
    report = check_recording(padded)
    assert report.pixels.empty_low_bits == 2
    assert said(report, "multiples of 4, with 2 unused low bits")


def test_few_frames_cannot_be_checked_and_do_not_speak_against_the_response() -> None:
    exposures = np.log(2.0) * np.arange(6) - 2
    report = check(log_exposure=exposures, speed_px=0.0, size=LARGE)
    assert report.exposure_lag_frames is None
    assert states(report)["exposures"] == "marginal"
    assert "only 6 frames" in report.verdicts["exposures"].reason
    assert states(report)["response"] == "identifiable"


@pytest.mark.usefixtures("no_pairs")
def test_frames_that_cannot_be_read_are_passed_over() -> None:
    recording = Film(wandering(50)).recording()
    broken = _WithHoles(recording, frozenset({3, 17}))
    report = check_recording(broken)
    assert report.unreadable == 2
    assert said(report, "2 of 50 frames skipped: damaged; damaged")
    with pytest.raises(RecordingError, match="none of its frames can be used"):
        check_recording(_WithHoles(recording, frozenset(range(50))))


class _WithHoles:
    """A recording with some damaged images."""

    def __init__(self, inner: ArrayRecording, damaged: frozenset[int]) -> None:
        self._inner, self._damaged = inner, damaged

    def __getattr__(self, name: str):
        return getattr(self._inner, name)

    def __len__(self) -> int:
        return len(self._inner)

    def __iter__(self):
        from ospc.errors import FrameError

        def fail():
            raise FrameError("damaged")

        for frame in self._inner:
            yield replace(frame, load=fail) if frame.index in self._damaged else frame


@pytest.mark.usefixtures("no_pairs")
def test_only_as_many_frames_are_taken_as_allowed() -> None:
    recording = Film(wandering(200)).recording()
    seen: list[tuple[int, int]] = []
    report = check_recording(recording, frames=80, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (80, 80) == (len(seen), 80)
    assert report.frames == 200
    assert report.exposure_lag_frames == 0


@pytest.mark.parametrize("frames", [0, -3])
def test_a_check_of_no_frames_is_refused(frames: int) -> None:
    with pytest.raises(SettingError, match="give at least 1"):
        check_recording(Film(wandering(9)).recording(), frames=frames)


@pytest.mark.parametrize("film", [{"lag": 2}, {"hidden_log_gain": wandering(36, 9)}])
def test_it_agrees_with_a_calibration(film: dict) -> None:
    recording = Film(wandering(36), **film).recording()
    report, calibration = check_recording(recording), calibrate(recording)
    assert report.verdicts == calibration.verdicts
    assert report.warnings == calibration.warnings
    assert calibration.source.get("exposure_lag_corrected_frames", 0) == report.exposures.corrected_frames


def test_the_answer_is_json_with_units(good: RecordingReport) -> None:
    content = json.loads(json.dumps(good.as_dict(), allow_nan=False))
    assert content["exposure_lag_frames"] == 0
    assert content["verdicts"] == states(good)
    assert content["exposure"]["lowest_ms"] == pytest.approx(good.exposures.evidence.recorded.lowest_ms)
    assert content["timing"]["frames_per_s"] == pytest.approx(20)
    unknown = check(log_exposure=jumping(3)).as_dict()
    assert unknown["exposure_lag_frames"] is None
    json.dumps(unknown, allow_nan=False)
