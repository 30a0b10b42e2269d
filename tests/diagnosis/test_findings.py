"""What a calibration reports and does about its exposures: little if they are right, and no silence if not."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import cycle

import numpy as np
import pytest
from filmed import LARGE, Film, fitted, found, observed, wandering

from ospc.calibrator import OnlineCalibrator, calibrate, drive
from ospc.evaluation.metrics import log_ratio_error
from ospc.exposures import evidence
from ospc.exposures.brightness_series import BrightnessSeries
from ospc.exposures.evidence import evidence_of_images
from ospc.exposures.lag_choice import LagChoice
from ospc.exposures.lag_selection import LagEstimate
from ospc.exposures.used import corrected_as_source, used_exposures, with_earlier_exposures
from ospc.exposures.verdicts import findings_from
from ospc.methods.maximum_likelihood import MaximumLikelihoodMethod
from ospc.photometry.calibration import Calibration
from ospc.photometry.coverage import ExposureRatios
from ospc.photometry.verdict import LATE_EXPOSURES, EffectEstimate, Verdict
from ospc.recording import Frame
from ospc.settings import DefaultSettings

FRAMES = 56
LATE = Film(wandering(FRAMES), lag=2)
STALE = Film(np.zeros(FRAMES), hidden_log_gain=wandering(FRAMES))
RISING = Film(0.6 * np.linspace(-1, 1, 60) + 0.1 * np.linspace(-1, 1, 60) ** 2)
HALF_STOPS = Film(np.repeat(np.resize([0.0, 0.35], 4), 14), hidden_log_gain=wandering(FRAMES))
FLICKERING = Film(0.5 * wandering(FRAMES), hidden_log_gain=np.random.default_rng(5).normal(0, 0.02, FRAMES))
QUICK = replace(DefaultSettings(), points_per_pair=120, rounds=5, response_intervals=16)


def test_a_good_recording_gives_no_messages() -> None:
    told = found(Film(wandering(FRAMES)))
    assert (told.lag.frames, told.corrected_frames, told.notes, told.warnings) == (0, 0, (), ())
    assert told.verdict.state == "identifiable"


def test_a_lag_is_corrected_and_reported() -> None:
    told = found(LATE)
    assert (told.lag.frames, told.corrected_frames, told.warnings) == (2, 2, ())
    assert "2 frames late" in told.notes[0]


@pytest.mark.parametrize(
    ("effect", "state"),
    [
        (EffectEstimate(LATE_EXPOSURES, 0.6, 0.08), "marginal"),
        (EffectEstimate(LATE_EXPOSURES, -0.6, 0.08), "marginal"),
        (EffectEstimate(LATE_EXPOSURES, 0.6, 0.08, corrected=True), "identifiable"),
        (EffectEstimate(LATE_EXPOSURES, -0.6, 0.08, corrected=True), "identifiable"),  # late by 1.4 frames
        (EffectEstimate(LATE_EXPOSURES, 0.6, 0.2), "identifiable"),
        (EffectEstimate(LATE_EXPOSURES, 0.05, 0.001), "identifiable"),
        (EffectEstimate("exposure offset", 0.6, 0.08), "identifiable"),
    ],
)
def test_a_fit_that_shows_exposures_of_other_frames_leaves_a_doubt(effect: EffectEstimate, state: str) -> None:
    assert fitted(found(LATE), effect).verdict.state == state


@pytest.mark.parametrize(
    ("frames", "sigma", "state"),
    [
        (0.4, 0.02, "identifiable"),
        (-0.02, 0.002, "identifiable"),
        (-0.1, 0.03, "identifiable"),
        (-0.1, 0.01, "marginal"),
        (-0.4, 0.02, "marginal"),
    ],
)
def test_a_part_of_a_frame_late_is_usual_and_early_is_noise_reduction(
    frames: float, sigma: float, state: str
) -> None:
    effect = EffectEstimate(LATE_EXPOSURES, frames, sigma, corrected=True)
    verdict = fitted(found(Film(wandering(FRAMES))), effect).verdict
    assert verdict.state == state
    assert ("noise reduction" in verdict.remedy) == (state == "marginal")


@pytest.mark.parametrize(
    ("effect", "state"),
    [
        (EffectEstimate(LATE_EXPOSURES, 0.02, 0.01), "identifiable"),
        (EffectEstimate(LATE_EXPOSURES, 0.02, 0.2), "marginal"),
        (EffectEstimate(LATE_EXPOSURES, 0.97, 0.01), "marginal"),
        (EffectEstimate(LATE_EXPOSURES, 0.97, 0.01, corrected=True), "marginal"),
        (EffectEstimate("exposure offset", 0.0, 0.01), "marginal"),
    ],
)
def test_a_fit_settles_a_lag_that_changes_of_brightness_leave_open(effect: EffectEstimate, state: str) -> None:
    unsettled = found(RISING)
    assert (unsettled.lag.frames, unsettled.verdict.state) == (None, "marginal")
    judged = fitted(unsettled, effect)
    assert judged.verdict.state == state
    assert (judged.lag.frames == 0) is (not judged.notes) is (state == "identifiable")


@pytest.mark.parametrize("choice", ["auto", "never"])
@pytest.mark.parametrize(
    ("effect", "lag"),
    [
        (EffectEstimate(LATE_EXPOSURES, 0.97, 0.1), 1),
        (EffectEstimate(LATE_EXPOSURES, -0.8, 0.1, corrected=True), -1),
        (EffectEstimate(LATE_EXPOSURES, 0.97, 0.3), 0),
        (EffectEstimate(LATE_EXPOSURES, 0.4, 0.01), 0),
        (EffectEstimate(LATE_EXPOSURES, 20.0, 0.1), 0),
        (EffectEstimate("exposure offset", 0.97, 0.1), 0),
    ],
)
def test_a_fit_shows_a_lag_that_changes_of_brightness_leave_open(
    effect: EffectEstimate, lag: int, choice: LagChoice
) -> None:
    assert fitted(found(RISING, choice), effect).evidence.lag_of_fit == (lag if choice == "auto" else 0)


def test_a_fit_does_not_show_another_lag_than_changes_of_brightness() -> None:
    for film in (LATE, Film(wandering(FRAMES))):
        assert fitted(found(film), EffectEstimate(LATE_EXPOSURES, 0.97, 0.1)).evidence.lag_of_fit == 0


@pytest.mark.parametrize(("frames", "state"), [(0.01, "identifiable"), (0.7, "marginal")])
def test_exposures_moved_by_the_lag_of_the_fit_have_to_agree_with_it(frames: float, state: str) -> None:
    moved = findings_from(found(RISING).evidence.moved(1))
    again = fitted(moved, EffectEstimate(LATE_EXPOSURES, frames, 0.01))
    assert (again.verdict.state, again.corrected_frames) == (state, 1)
    assert "1 frame late, as the fit shows" in again.notes[0]
    if state == "identifiable":
        assert (again.lag.frames, again.warnings) == (1, ())
        assert "belong to their frames, as the fit shows" in again.verdict.reason


def test_a_lag_that_only_the_fit_shows_is_corrected(monkeypatch) -> None:
    slow, certain = Film(0.8 * np.cos(np.arange(FRAMES) / 9), size=LARGE), evidence.estimate_lag

    def either(seen: BrightnessSeries, log_exposure: np.ndarray) -> LagEstimate:
        return replace(certain(seen, log_exposure), state="ambiguous", candidates=(0, 1))

    monkeypatch.setattr(evidence, "estimate_lag", either)
    right, late = (calibrate(replace(slow, lag=lag).recording(), QUICK) for lag in (0, 1))
    assert "exposure_lag_corrected_frames" not in right.source
    assert late.source["exposure_lag_corrected_frames"] == 1
    assert "1 frame late, as the fit shows" in late.notes[0]
    assert {n: v.state for n, v in late.verdicts.items()} == {n: v.state for n, v in right.verdicts.items()}
    assert log_ratio_error(late.response, right.response) < 0.002


@pytest.mark.parametrize(("frames", "sigma", "state"), [(0.02, 0.01, "identifiable"), (0.02, 0.2, "marginal")])
def test_a_fit_settles_the_lag_if_no_consecutive_frames_overlap(frames: float, sigma: float, state: str) -> None:
    unsettled = findings_from(evidence_of_images([], wandering(FRAMES)))
    assert (unsettled.lag.state, unsettled.verdict.state) == ("too few pairs", "marginal")
    judged = fitted(unsettled, EffectEstimate(LATE_EXPOSURES, frames, sigma))
    assert judged.verdict.state == state
    assert (judged.lag.frames == 0) is (not judged.notes) is (state == "identifiable")


@pytest.mark.parametrize(("frames", "sigma", "state"), [(0.0, 0.01, "identifiable"), (0.0, 0.2, "marginal")])
def test_a_fit_settles_a_lag_that_it_refutes_if_it_is_certain(frames: float, sigma: float, state: str) -> None:
    refuted = findings_from(found(LATE).evidence.without_correction())
    assert (refuted.verdict.state, refuted.lag.frames, refuted.corrected_frames) == ("marginal", None, 0)
    assert fitted(refuted, EffectEstimate(LATE_EXPOSURES, frames, sigma)).verdict.state == state


@pytest.mark.parametrize(
    ("effect", "doubts"),
    [
        (EffectEstimate(LATE_EXPOSURES, -1.9, 0.1), True),
        (EffectEstimate(LATE_EXPOSURES, -0.3, 0.05, corrected=True), True),
        (EffectEstimate(LATE_EXPOSURES, -1.9, 0.5), False),
        (EffectEstimate(LATE_EXPOSURES, 1.9, 0.1), False),
        (EffectEstimate("exposure offset", -1.9, 0.1), False),
    ],
)
def test_a_fit_doubts_a_correction_that_went_too_far(effect: EffectEstimate, doubts: bool) -> None:
    assert fitted(found(LATE), effect).evidence.fit_doubts_correction is doubts


def test_of_exposures_as_recorded_and_as_moved_those_with_the_smaller_fitted_lag_are_right() -> None:
    moved, recorded = found(LATE).evidence, found(LATE).evidence.without_correction()
    late = [replace(moved, late=EffectEstimate(LATE_EXPOSURES, frames, 0.05)) for frames in (-0.3, 1.7)]
    recorded = replace(recorded, late=EffectEstimate(LATE_EXPOSURES, 0.5, 0.05))
    assert [recorded.lag_is_smaller_than(each) for each in late] == [False, True]
    assert not recorded.lag_is_smaller_than(moved)


def test_a_lag_correction_is_undone_if_the_fit_refutes_it(monkeypatch) -> None:
    film = Film(wandering(FRAMES), size=LARGE)
    as_written = calibrate(film.recording(), QUICK, correct_lag="never")
    right = evidence.estimate_lag

    def one_late(seen: BrightnessSeries, log_exposure: np.ndarray) -> LagEstimate:
        """Report exposures one frame late, unless they were already moved and one fewer remains."""
        return replace(right(seen, log_exposure), candidates=(int(len(log_exposure) == FRAMES),))

    monkeypatch.setattr(evidence, "estimate_lag", one_late)
    moved_back = calibrate(film.recording(), QUICK)
    assert "exposure_lag_corrected_frames" not in moved_back.source
    assert moved_back.verdicts["exposures"].reason.startswith("exposures belong to their frames, as the fit shows")
    assert not moved_back.warnings
    assert log_ratio_error(moved_back.response, as_written.response) < 0.005


def test_a_lag_that_the_fit_refutes_is_not_corrected_during_the_run_either(monkeypatch) -> None:
    """The right lag would later seem to be a change of the camera."""
    right, late = evidence.estimate_lag, cycle([1, 0])  # of the exposures as recorded, and as moved

    def one_late(seen: BrightnessSeries, log_exposure: np.ndarray) -> LagEstimate:
        return replace(right(seen, log_exposure), state="determined", candidates=(next(late),))

    monkeypatch.setattr(evidence, "estimate_lag", one_late)
    recording = Film(wandering(100), size=LARGE).recording()
    calibrator = OnlineCalibrator.of(recording, QUICK)
    drive(calibrator, recording)
    exposures = calibrator._run.exposures
    assert (exposures.table.lag_frames, exposures._known_lag) == (0, 0)


def test_a_number_is_obeyed_and_checked() -> None:
    right, wrong = found(LATE, 2), found(LATE, -1)
    assert (right.lag.frames, right.corrected_frames, right.warnings) == (2, 2, ())
    assert (wrong.lag.frames, wrong.corrected_frames) == (2, -1)
    assert "2 frames late" in wrong.warnings[0]


@pytest.mark.parametrize("given", [0, 1, -1, "never"])
def test_a_wrong_number_is_met_with_the_right_one(given: LagChoice) -> None:
    told = found(LATE, given)
    assert "exposures are recorded 2 frames late" in told.verdict.reason
    assert told.verdict.remedy == "set correct_lag to 2"
    # Curves fitted to exposures of other frames deserve no advice of their own.
    unknown = told.doubted(Verdict("not identifiable", "the vignette moves", "switch off stabilisation"))
    assert (unknown.state, unknown.remedy) == ("not identifiable", told.verdict.remedy)


def test_a_number_for_exposures_that_do_not_lag_is_to_be_zero() -> None:
    told = found(Film(wandering(FRAMES)), 1)
    assert "exposures are recorded with their frames" in told.verdict.reason
    assert told.verdict.remedy == "set correct_lag to 0"


@pytest.mark.parametrize("choice", ["auto", 0, 1])
def test_alternating_exposures_without_an_effect_are_wrong_though_slow_changes_agree(choice: LagChoice) -> None:
    alternation = np.resize([-0.35, 0.35], FRAMES)
    told = found(Film(wandering(FRAMES) + alternation, hidden_log_gain=-alternation), choice)
    assert told.verdict.state == "not identifiable"
    assert "does not follow them" in told.verdict.reason


def test_a_short_cycle_is_corrected_whichever_lag_it_is() -> None:
    exposures = np.log([1.0, 2.0, 4.0])[np.arange(FRAMES) % 3] - 1
    findings = found(Film(exposures, lag=1))
    assert (findings.lag.frames, findings.corrected_frames) == (None, 1)
    assert (findings.verdict.state, findings.warnings) == ("identifiable", ())


@pytest.mark.parametrize("step", [0.02, -0.05])
def test_a_lag_of_exposures_that_change_evenly_would_not_matter(step: float) -> None:
    sweep = step * np.arange(FRAMES)
    findings = found(Film(sweep))
    assert (findings.verdict.state, findings.notes) == ("identifiable", ())
    assert "a lag would not change their ratios" in findings.verdict.reason
    # It would change those of a sweep that turns back.
    assert found(Film(np.abs(sweep - sweep[-8]))).verdict.state == "marginal"


def test_exposures_right_up_to_whole_cycles_are_identifiable() -> None:
    findings = found(Film(np.log([1.0, 2.0, 4.0])[np.arange(FRAMES) % 3] - 1))
    assert (findings.corrected_frames, findings.verdict.state, findings.notes) == (0, "identifiable", ())


def test_stale_exposures_are_a_warning() -> None:
    findings = found(STALE)
    assert "stale" in findings.warnings[0]
    assert findings.verdict.remedy
    assert findings.corrected_frames == 0


def ratios_with(errors: np.ndarray) -> ExposureRatios:
    """Return exposure ratios, half of them of unchanged exposures, that a fit explains up to these errors in ln."""
    n = len(errors)
    metadata = np.where(np.arange(n) % 2, 1.0, 1.4)
    return ExposureRatios(np.arange(2 * n).reshape(n, 2), metadata, metadata * np.exp(errors), np.full(n, 100))


@pytest.mark.parametrize(
    ("error", "exceptions", "state"),
    [
        (0.003, 0, "identifiable"),
        (0.003, 1, "identifiable"),
        (0.003, 8, "not identifiable"),
        (0.02, 0, "not identifiable"),
    ],
)
def test_exposures_that_a_fit_explains_are_not_stale(error: float, exceptions: int, state: str) -> None:
    errors = np.full(40, error)
    errors[1 : 2 * exceptions : 2] = 0.3  # pairs of unchanged exposure
    judged = fitted(found(HALF_STOPS), ratios=ratios_with(errors))
    assert judged.verdict.state == state
    assert (judged.warnings == ()) == (state == "identifiable")


@pytest.mark.parametrize(("error", "state"), [(0.003, "identifiable"), (0.02, "marginal")])
def test_exposures_that_a_fit_explains_do_not_fit_badly(error: float, state: str) -> None:
    unjudged = found(FLICKERING)
    assert "exposures fit poorly" in unjudged.warnings[0]
    judged = fitted(unjudged, ratios=ratios_with(np.full(40, error)))
    assert judged.verdict.state == state
    assert (judged.warnings == ()) == (state == "identifiable")


@pytest.mark.parametrize(
    ("error", "lag_sigma", "state"),
    [(0.003, 0.01, "identifiable"), (0.003, 0.3, "marginal"), (0.02, 0.01, "not identifiable")],
)
def test_exposures_that_a_fit_explains_have_an_effect(error: float, lag_sigma: float, state: str) -> None:
    alternation = np.resize([-0.35, 0.35], FRAMES)
    unjudged = found(Film(wandering(FRAMES) + alternation, hidden_log_gain=-alternation))
    assert unjudged.lag.state == "no response to exposure"
    effect = EffectEstimate(LATE_EXPOSURES, 0.0, lag_sigma)
    judged = fitted(unjudged, effect, ratios=ratios_with(np.full(40, error)))
    assert judged.verdict.state == state
    assert bool(judged.warnings) == (state == "not identifiable")
    assert "jumps" not in judged.verdict.reason


def test_noise_that_a_fit_explains_is_no_misfit() -> None:
    doubted = found(FLICKERING)
    errors = np.random.default_rng(2).normal(0, 0.02, 60)
    for sigma, state in ((0.02, "identifiable"), (0.005, "marginal")):
        ratios = replace(ratios_with(errors), log_sigma=np.full(len(errors), sigma))
        assert fitted(doubted, ratios=ratios).verdict.state == state


@pytest.mark.parametrize(("factor", "state"), [(1.5, "marginal"), (1 / 1.5, "marginal"), (1.02, "identifiable")])
def test_a_large_jump_that_the_exposures_do_not_explain_is_doubted(factor: float, state: str) -> None:
    film = Film(wandering(FRAMES), hidden_log_gain=np.where(np.arange(FRAMES) < 30, 0.0, np.log(factor)))
    told = found(film)
    assert told.verdict.state == state
    assert ("at frame 30" in told.verdict.reason) == (state == "marginal")
    assert not told.warnings  # response and vignette are found from all other changes


def test_a_change_between_the_first_two_frames_that_can_be_compared_is_no_jump() -> None:
    film = Film(wandering(FRAMES), hidden_log_gain=np.where(np.arange(FRAMES) == 20, -0.4, 0.0))
    history, stated = observed(film)
    # A sweep from white: the frames before are white, and in this one, few points are exposed well.
    later = [change for change in history.changes if change.frame0 >= 20]
    findings = findings_from(evidence_of_images(later, stated, "auto"))
    assert findings.brightness is not None
    assert not findings.brightness.jumps
    assert findings.verdict.state == "identifiable"


@pytest.mark.parametrize("lag", [-3, 0, 2])
def test_a_jump_is_stated_at_its_frame_in_a_later_epoch_and_with_a_lag(lag: int) -> None:
    film = Film(wandering(FRAMES), hidden_log_gain=np.where(np.arange(FRAMES) < 30, 0.0, np.log(1.5)), lag=lag)
    told = found(film)
    assert told.corrected_frames == lag
    assert "at frame 30" in told.verdict.reason
    assert "at frame 130" in findings_from(told.evidence.renumbered(100)).verdict.reason


def ratios_across(jump: float, samples: int, at: int = 250) -> ExposureRatios:
    """Return exposure ratios of pairs of frames up to 20 apart, with exposures that jump in ln at a frame."""
    random = np.random.default_rng(5)
    first = np.arange(0, 480, 4)
    frames = np.stack([first, first + random.integers(1, 20, len(first))], axis=1)
    across = (frames[:, 0] < at) & (frames[:, 1] >= at)
    metadata = np.exp(np.where(across, -jump, 0.0))
    estimated = np.exp(random.normal(0, 0.002, len(first)))
    return ExposureRatios(frames, metadata, estimated, np.full(len(first), samples), np.full(len(first), 0.002))


@pytest.mark.parametrize("factor", [1.5, 1 / 1.5, 1000.0, 1 / 1000])
def test_a_jump_that_only_pairs_of_distant_frames_show_is_doubted(factor: float) -> None:
    told = fitted(found(Film(wandering(FRAMES))), ratios=ratios_across(np.log(factor), samples=400))
    assert told.verdict.state == "marginal"
    first, last = map(int, re.findall(r"between frames (\d+) and (\d+)", told.verdict.reason)[0])
    assert first < 250 <= last
    assert last - first < 10
    stated = {1.5: "-3[34]%", 1 / 1.5: r"\+(49|50|51)%", 1000.0: "a factor of 0.001", 1 / 1000: "a factor of 1000"}
    assert re.search(f"jumps by {stated[factor]} between", told.verdict.reason)
    assert not told.warnings


@pytest.mark.parametrize("length", [1, 3])
@pytest.mark.parametrize("offset", [0, 100])
def test_a_flash_is_no_jump_although_pairs_of_frames_show_it(length: int, offset: int) -> None:
    flash = np.arange(30, 30 + length)
    gain = np.where(np.isin(np.arange(FRAMES), flash), np.log(1.5), 0.0)
    findings = found(Film(wandering(FRAMES), hidden_log_gain=gain))
    frames = np.stack([np.arange(FRAMES - 12), np.arange(12, FRAMES)], axis=1)
    estimated = np.exp(gain[frames[:, 0]] - gain[frames[:, 1]])
    of_pairs = np.full(len(frames), 400), np.full(len(frames), 0.002)
    ratios = ExposureRatios(frames + offset, np.ones(len(frames)), estimated, *of_pairs)
    seen = findings_from(findings.evidence.renumbered(offset).with_fit((), ratios))
    assert "jumps" not in seen.verdict.reason


@pytest.mark.parametrize(("jump", "samples"), [(0.03, 400), (0.4, 20), (0.0, 400)])
def test_small_jumps_and_those_of_few_points_are_not_doubted(jump: float, samples: int) -> None:
    findings = found(Film(wandering(FRAMES)))
    assert fitted(findings, ratios=ratios_across(jump, samples)).verdict == findings.verdict


def test_a_fit_to_constant_exposures_or_to_few_pairs_does_not_make_them_right() -> None:
    good = ratios_with(np.full(40, 0.001))
    assert fitted(found(STALE), ratios=good).warnings
    assert fitted(found(HALF_STOPS), ratios=ratios_with(np.full(8, 0.001))).warnings
    assert fitted(found(HALF_STOPS)).warnings


def test_a_verdict_that_warns_is_the_warning_whatever_a_fit_settles_besides() -> None:
    """Stale exposures, recorded late: the fit may explain the brightness, or refute the lag, but not both."""
    late = replace(HALF_STOPS, lag=2)
    explained = fitted(found(late, "never"), ratios=ratios_with(np.full(40, 0.003)))
    refuted = findings_from(found(late).evidence.without_correction())
    for told, said in ((explained, "recorded 2 frames late"), (refuted, "stale")):
        assert said in told.verdict.reason
        assert told.warnings == (told.verdict.reason,)
        assert not told.notes


@pytest.mark.parametrize(("choice", "said"), [("auto", "fit shows"), (0, "are taken"), ("estimated", "estimated")])
def test_what_is_stated_needs_no_fit_to_settle_it(choice: LagChoice, said: str) -> None:
    told = fitted(found(RISING, choice), EffectEstimate(LATE_EXPOSURES, 0.02, 0.01))
    assert said in told.verdict.reason
    assert (told.lag.frames == 0) is (choice == "auto")


def test_constant_exposures_that_are_true_are_none() -> None:
    findings = found(Film(np.zeros(60)))
    assert (findings.lag.frames, findings.notes, findings.warnings) == (None, (), ())


def test_an_uncertain_lag_is_a_note_not_a_warning() -> None:
    findings = found(RISING)
    assert findings.lag.frames is None
    assert findings.warnings == ()
    assert "uncertain" in findings.notes[0]


def test_a_stated_lag_settles_an_uncertain_one() -> None:
    stated = found(RISING, 0)
    assert (stated.verdict.state, stated.notes, stated.warnings) == ("identifiable", (), ())
    assert "exposures are taken to belong to their frames; the images do not" in stated.verdict.reason
    assert "stale" in found(STALE, 0).warnings[0]


def test_a_stated_lag_that_nothing_could_be_compared_with_is_not_said_to_be_confirmed() -> None:
    told = findings_from(evidence_of_images([], wandering(3), 0))
    assert told.verdict.reason.endswith("to their frames; the images are too few or too different to check it")


def test_photographs_have_no_exposure_lag(monkeypatch: pytest.MonkeyPatch) -> None:
    # Comparing pairs of frames takes most of the time and is not needed here.
    monkeypatch.setattr(MaximumLikelihoodMethod, "push", lambda *_: None)
    recording = RISING.recording()
    assert OnlineCalibrator.of(recording).correct_lag == "auto"
    object.__setattr__(recording, "kind", "exif_photos")
    assert OnlineCalibrator.of(recording).correct_lag == 0
    assert found(RISING).verdict.state == "marginal"
    assert calibrate(recording).verdicts["exposures"].state == "identifiable"


def test_a_lag_found_late_applies_to_all_that_was_observed_before() -> None:
    """The exposures are constant at first, so the lag cannot be determined yet."""
    course = np.concatenate([np.zeros(20), wandering(45, 3, step=0.12)])
    true, late = (calibrate(Film(course, lag=lag).recording(), QUICK) for lag in (0, 2))
    assert late.source["exposure_lag_corrected_frames"] == 2
    levels = np.linspace(0.2, 0.8, 13)
    step, expected = (np.diff(np.log(c.response.inverse(levels))) for c in (late, true))
    np.testing.assert_allclose(step, expected, atol=0.03)


def test_exposures_before_a_change_of_their_lag_keep_the_earlier_one() -> None:
    earlier, later = (
        Calibration((8, 6), source={"exposure_lag_corrected_frames": lag} if lag else {}) for lag in (0, 2)
    )
    later = replace(later, source=with_earlier_exposures(later.source, [(5, 0, ())]))
    recorded = np.array([10.0, 20, 30, 40, 50, 40, 50, 60, 70, 80])
    np.testing.assert_allclose(used_exposures(later, recorded), [10, 20, 30, 40, 50, 60, 70, 80, np.nan, np.nan])
    undone = replace(earlier, source=with_earlier_exposures({}, [(5, 2, ()), (7, 0, ())]))
    np.testing.assert_allclose(used_exposures(undone, recorded), [30, 40, 50, 40, 50, 40, 50, 60, 70, 80])
    np.testing.assert_array_equal(used_exposures(earlier, recorded), recorded)


@pytest.mark.parametrize("stated", [5, [[3]], [[0, 1]], [[20, 1]], [["a", 1]], {"a": 1}])
def test_a_calibration_with_impossible_lags_moves_nothing(stated: object) -> None:
    recorded = np.arange(1.0, 11)
    damaged = Calibration((8, 6), source={"exposure_lags_corrected_until": stated})
    np.testing.assert_array_equal(used_exposures(damaged, recorded), recorded)


def test_exposures_are_corrected_as_the_calibration_states() -> None:
    """Beyond the stated exposures, the error stays the same in milliseconds."""
    corrected = Calibration((8, 6), source=corrected_as_source(np.array([1.0, 2, 4]), np.array([1.5, 2.5, 5])))
    recorded = np.array([0.5, 1, 3, 4, 8, np.nan, 0])
    np.testing.assert_allclose(used_exposures(corrected, recorded), [1, 1.5, 3.75, 5, 9, np.nan, 0])
    moved = replace(corrected, source=corrected.source | {"exposure_lag_corrected_frames": 1})
    np.testing.assert_allclose(used_exposures(moved, recorded[:5]), [1.5, 3.75, 5, 9, np.nan])


@pytest.mark.parametrize(
    "stated",
    [5, [], [[], []], [1.0, 2.0], [[[1.0]], [[2.0]]], [[1.0], [1.0, 2.0]], [["a"], [1.0]], [[1.0], [None]], {"a": 1}],
)
def test_a_calibration_with_impossible_corrections_corrects_nothing(stated: object) -> None:
    recorded = np.arange(1.0, 11)
    damaged = Calibration((8, 6), source={"exposures_corrected_ms": stated})
    np.testing.assert_array_equal(used_exposures(damaged, recorded), recorded)


def test_a_frame_without_an_exposure_hides_nothing_of_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(MaximumLikelihoodMethod, "push", lambda *_: None)
    recording = list(Film(wandering(FRAMES), lag=1).recording())
    broken = [Frame.of_array(f.image, float("nan") if f.index in (20, 21, 40) else f.exposure_ms) for f in recording]
    calibrator = OnlineCalibrator()
    assert [calibrator.push(frame) for frame in broken].count(False) == 3
    assert calibrator.exposure_findings().lag.frames == 1


@pytest.mark.parametrize("share", [0.15, 0.25])
def test_swapped_exposures_are_not_trusted(share: float) -> None:
    film = Film(wandering(100, 4))
    swapped = film.log_exposure.copy()
    for i in np.random.default_rng(1).permutation(np.arange(1, 100))[: int(share * 100)]:
        swapped[[i - 1, i]] = swapped[[i, i - 1]]
    assert found(film, stated_log_exposure=swapped).warnings


OPPOSED = "the images get darker when the recorded exposures get longer"


@pytest.mark.parametrize(
    "log_exposure",
    [wandering(FRAMES), np.linspace(-0.6, 0.6, 60), np.log([1.0, 2, 4, 8] * 15) - 1],
    ids=["wandering", "rising", "repeating"],
)
@pytest.mark.parametrize("lag", [0, 2])
def test_inverse_exposures_are_recognised(log_exposure: np.ndarray, lag: int) -> None:
    inverse = found(Film(-log_exposure, lag=lag, hidden_log_gain=2 * log_exposure))
    assert inverse.verdict.state == "not identifiable"
    assert inverse.verdict.reason.startswith(OPPOSED)
    assert "1/250 s is 4 ms" in inverse.verdict.remedy
    assert inverse.warnings == (inverse.verdict.reason,)


@pytest.mark.parametrize("film", [STALE, LATE, Film(wandering(FRAMES), hidden_log_gain=-wandering(FRAMES))])
def test_other_exposure_faults_are_not_mistaken_for_inverse_exposures(film: Film) -> None:
    assert OPPOSED not in found(film).verdict.reason


def test_a_moving_camera_with_inverse_exposures_does_not_count_as_static() -> None:
    log_exposure = wandering(40)
    made = calibrate(Film(-log_exposure, hidden_log_gain=2 * log_exposure, size=LARGE, speed_px=4).recording(), QUICK)
    for verdict in made.verdicts.values():
        assert verdict.state == "not identifiable"
        assert "is stationary" not in verdict.reason
    assert made.warnings == (made.verdicts["exposures"].reason,)
