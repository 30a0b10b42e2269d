"""Effect of a calibration on tracking: it helps if exposures change, and does nothing if no correction is needed."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from ospc.cli.evaluate import command
from ospc.errors import FrameError, NotObservableError, SettingError
from ospc.evaluation.lucas_kanade import follow, windows
from ospc.evaluation.tracking import compare_tracking
from ospc.evaluation.tracks import LifeTable, StreamingMedian
from ospc.photometry.calibration import Calibration
from ospc.photometry.correction import Corrector
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette
from ospc.recording import ArrayRecording, Frame, open_recording
from ospc.simulation import SimulationSettings, frames, simulate, truth

SMALL = SimulationSettings(size=(240, 180), frames=24)
CHANGING = replace(SMALL, exposure="cycle", exposures_ms=(4.0, 10.0))
LINEAR = Response(np.linspace(0, 1, 256))


@cache
def recording_of(settings):
    made = list(frames(settings))
    return ArrayRecording([f.image for f in made], [f.exposure_ms for f in made], max_grey=settings.max_grey)


def compared(settings, corrector=None):
    known = truth(settings)
    chosen = corrector or Corrector(known.response, known.vignette, settings.max_grey)
    return compare_tracking(recording_of(settings), chosen)


# --- simulated recordings and their true calibrations ------------------------------------------------------------


@pytest.mark.parametrize(
    "settings",
    [
        CHANGING,
        replace(CHANGING, response="linear", bit_depth=12),
        replace(CHANGING, response="tum_narrow", seed=2, scene_seed=0, noise="high"),
        replace(CHANGING, exposures_ms=(4.0,) * 4 + (12.0,) * 4, seed=3, scene_seed=0, vignette="decentred"),
    ],
    ids=["gamma", "linear, 12 bit", "tum, noisy", "steps"],
)
def test_with_exposure_jumps_tracks_last_twice_as_long_and_the_residual_falls_to_a_fifth(settings):
    result = compared(settings)
    assert result.largest_step > 2
    assert result.life_ratio > 2
    assert result.residual_ratio > 5
    assert result.corrected.residual < 0.06
    assert "helps" in result.sentence


def test_with_slow_exposure_changes_only_brightness_limits_tracks():
    result = compared(replace(SMALL, exposure="sweep", exposure_min_ms=4.0, exposure_max_ms=10.0))
    assert result.largest_step < 1.05
    assert result.life_ratio > 2
    on_the_way = [
        sum(kind.lost.values()) - kind.lost["different brightness"] for kind in (result.raw, result.corrected)
    ]
    assert abs(on_the_way[0] / result.raw.steps - on_the_way[1] / result.corrected.steps) < 0.02
    assert result.corrected.lost["different brightness"] < 0.1 * result.raw.lost["different brightness"]
    assert result.residual_ratio > 5
    assert "helps" in result.sentence


def test_a_calibration_that_changes_nothing_gives_the_same_tracks():
    settings = replace(SMALL, exposure="constant", response="linear", vignette="none", frames=16)
    result = compared(settings, Corrector(LINEAR, None, assume_missing=True))
    assert result.corrected == result.raw
    assert "hardly changes anything" in result.sentence
    assert "as long as before" in result.sentence


def test_a_wrong_calibration_is_reported():
    settings = replace(SMALL, exposure="constant", vignette="none", frames=16)
    result = compared(settings, Corrector(Response.gamma(2.2), PolynomialVignette((240, 180), (-0.6, 0.0, 0.0))))
    assert result.residual_ratio < 0.5
    assert "harms" in result.sentence
    assert "times as large" in result.sentence


def test_the_direction_of_time_hardly_matters():
    known = truth(CHANGING)
    images = [frame.image for frame in recording_of(CHANGING)]
    backwards = ArrayRecording(images[::-1], known.exposures_ms[::-1])
    result = compare_tracking(backwards, Corrector(known.response, known.vignette))
    assert result.life_ratio > 2
    assert result.residual_ratio > 5


def test_on_a_real_recording_the_laboratory_calibration_helps(real_data):
    recording = open_recording(real_data / "borealhdr_left")
    from ospc.formats.dso import read_pcalib

    response = read_pcalib(real_data / "borealhdr_left" / "pcalib.txt")
    first = [frame for frame, _ in zip(recording, range(30), strict=False)]
    some = ArrayRecording([f.image for f in first], [f.exposure_ms for f in first], max_grey=recording.max_grey)
    result = compare_tracking(some, Corrector(response, None, recording.max_grey, assume_missing=True))
    assert result.life_ratio > 2
    assert result.residual_ratio > 5


# --- unusable input ----------------------------------------------------------------------------------------------


class _WithGaps:
    """A recording with some unreadable frames."""

    def __init__(self, whole, missing):
        self._whole, self._missing = whole, missing
        self.path, self.size, self.max_grey = whole.path, whole.size, whole.max_grey

    def __len__(self):
        return len(self._whole)

    def __iter__(self):
        def fail():
            raise FrameError("gone")

        for frame in self._whole:
            if frame.index in self._missing:
                yield Frame(frame.index, frame.stamp_s, frame.exposure_ms, frame.name, fail)
            else:
                yield frame


def test_frames_that_cannot_be_read_are_skipped_and_counted():
    known = truth(CHANGING)
    corrector = Corrector(known.response, known.vignette)
    whole = recording_of(CHANGING)
    calls = []
    result = compare_tracking(
        _WithGaps(whole, {0, 7}), corrector, progress=lambda done, total: calls.append((done, total))
    )
    assert (result.frames, result.skipped) == (22, 2)
    assert calls[-1] == (24, 24)
    with pytest.raises(NotObservableError, match="1 readable"):
        compare_tracking(_WithGaps(whole, set(range(1, 24))), corrector)


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_without_structure_there_is_nothing_to_follow(grey):
    recording = ArrayRecording(np.full((3, 180, 240), grey, np.uint8), [1.0, 2.0, 3.0])
    with pytest.raises(NotObservableError, match="nothing to track"):
        compare_tracking(recording, Corrector(LINEAR, PolynomialVignette((240, 180), (-0.3, 0.0, 0.0))))


def test_an_unknown_part_and_another_size_are_refused():
    recording = recording_of(replace(SMALL, frames=3))
    with pytest.raises(NotObservableError, match="no vignette"):
        compare_tracking(recording, Corrector(LINEAR, None))
    with pytest.raises(SettingError, match=r"240×180.*64×48"):
        compare_tracking(recording, Corrector(LINEAR, PolynomialVignette((64, 48), (-0.3, 0.0, 0.0))))


# --- the parts ---------------------------------------------------------------------------------------------------


def textured(seed, size=(160, 120)):
    noise = np.random.default_rng(seed).normal(size=size[::-1]).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.5)
    return np.clip(128 + 40 * smooth / smooth.std(), 0, 255).astype(np.uint8)


def test_a_shift_is_followed():
    image = textured(0)
    places = np.stack(np.meshgrid(np.arange(40.0, 120, 16), np.arange(40.0, 80, 13)), axis=-1).reshape(-1, 2)
    matrix = np.array([[1, 0, 3.4], [0, 1, -2.7]])
    moved = cv2.warpAffine(image, matrix, (160, 120), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    there, losses = follow(image, moved, places)
    assert not losses.any()
    np.testing.assert_allclose(there - places, np.broadcast_to([3.4, -2.7], places.shape), atol=0.1)
    assert follow(image, textured(1), places)[1].any(axis=0).all()
    assert len(follow(image, moved, places[:0])[0]) == 0


def test_a_step_is_lost_in_one_way_at_most_and_brightness_counts():
    image = textured(0)
    places = np.array([[60.0, 60.0], [90.0, 50.0]])
    brighter = cv2.convertScaleAbs(image, alpha=1.0, beta=60)
    _, losses = follow(image, brighter, places)
    assert losses.shape == (3, 2)
    assert np.all(losses.sum(axis=0) == 1)


def test_windows_are_bilinear():
    ramp = np.add.outer(2.0 * np.arange(40), np.arange(50)).astype(np.float32)
    values = windows(ramp, np.array([[20.5, 10.25]]), 3)
    expected = [[2 * (10.25 + j) + 20.5 + i for i in (-1, 0, 1)] for j in (-1, 0, 1)]
    np.testing.assert_allclose(values.reshape(3, 3), expected, atol=0.1)


lives = st.lists(st.tuples(st.integers(1, 12), st.booleans()), min_size=1, max_size=40)


def life_table(observed, horizon=10):
    """Return a life table of tracks, each given by its number of attempted steps and whether the last one failed."""
    table = LifeTable(horizon)
    for steps, lost in observed:
        ages = np.arange(min(steps, horizon))
        table.add(ages, ages[-1:] if lost and steps <= horizon else ages[:0])
    return table


@given(lives)
def test_watched_to_the_end_survival_is_the_share_alive(observed):
    table = life_table([(steps, True) for steps, _ in observed])
    ages = np.array([steps for steps, _ in observed])
    np.testing.assert_allclose(table.survival, [(ages > age).mean() for age in range(11)], atol=1e-12)
    assert table.horizon == 10
    assert table.mean_life(10) == pytest.approx(np.minimum(ages, 10).mean())
    median = table.median_life(10)
    if median is None:
        assert np.median(ages) > 10
    else:
        assert (ages <= median).mean() >= 0.5 > (ages < median).mean() - 1e-12


@given(lives)
def test_survival_is_the_product_limit(observed):
    table = life_table(observed)
    survival, share = [1.0], 1.0
    for age in range(10):
        risk = sum(steps > age for steps, _ in observed)
        lost = sum(steps == age + 1 and gone for steps, gone in observed)
        share *= 1 - lost / risk if risk else 1.0
        survival.append(share)
    np.testing.assert_allclose(table.survival, survival, atol=1e-12)
    assert table.steps == sum(min(steps, 10) for steps, _ in observed)


def test_unwatched_frames_are_not_claimed():
    table = life_table([(4, False), (3, False), (2, True)])
    assert table.horizon == 4
    assert table.median_life(4) is None
    assert table.mean_life(4) == pytest.approx(1 + 1 + 2 / 3 + 2 / 3)
    assert life_table([(2, True), (3, True)]).horizon == 10


@given(st.lists(st.floats(1e-4, 1e3), min_size=1, max_size=60))
def test_the_streaming_median_is_the_median_to_its_resolution(values):
    median = StreamingMedian()
    for part in np.array_split(np.array([*values, np.nan, np.inf]), 3):
        median.add(part)
    low, high = np.sort(values)[[(len(values) - 1) // 2, len(values) // 2]]
    assert low * 0.994 <= median.value <= high * 1.006
    assert np.isnan(StreamingMedian().value)


# --- the command -------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return simulate(tmp_path_factory.mktemp("simulated") / "recording", replace(CHANGING, frames=12))


def run(*arguments):
    return CliRunner().invoke(command, ["tracking", *(str(a) for a in arguments)])


def test_the_command_prints_a_table_and_a_sentence(made):
    result = run(made.path, "--calibration", made.path)
    assert result.exit_code == 0, result.output
    for expected in (
        "raw",
        "corrected",
        "mean lifetime",
        "median lifetime",
        "residual",
        "2.5:1",
        "The calibration helps",
    ):
        assert expected in result.output
    assert result.output.strip().splitlines()[-1].startswith("The calibration helps")


def test_the_command_as_json(made, tmp_path):
    partial = Calibration(CHANGING.size, made.response).save(tmp_path / "c.json")
    content = json.loads(run(made.path, "--calibration", partial, "--assume-missing", "--json").output)
    assert content["life_ratio"] > 2
    assert content["raw"]["mean_life"] * content["life_ratio"] == pytest.approx(content["corrected"]["mean_life"])
    assert content["assumed_identity"] == ["vignette"]
    assert content["sentence"].startswith("The calibration helps")
    causes = {"tracking failed", "forward-backward error", "different appearance", "different brightness"}
    assert set(content["raw"]["lost"]) == causes


def test_the_command_refuses_unsuitable_calibrations(made, tmp_path):
    partial = Calibration(CHANGING.size, made.response).save(tmp_path / "c.json")
    assert isinstance(run(made.path, "--calibration", partial).exception, NotObservableError)
    small = PolynomialVignette((64, 48), (-0.3, 0.0, 0.0))
    other = Calibration((64, 48), made.response, small).save(tmp_path / "o.json")
    assert isinstance(run(made.path, "--calibration", other).exception, SettingError)
    assert run(made.path).exit_code == 2
