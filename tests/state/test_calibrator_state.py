"""The state of a calibrator: resuming from it changes nothing, and wrong files are refused."""

from __future__ import annotations

import json
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ospc.calibrator import OnlineCalibrator, drive, remaining
from ospc.engine.state import Run
from ospc.errors import FormatError, FrameError, RecordingError, SettingError
from ospc.exposures import brightness_history
from ospc.exposures.monitor import ExposureMonitor
from ospc.methods.epoch_data import EpochData
from ospc.methods.maximum_likelihood import MaximumLikelihoodMethod
from ospc.methods.maximum_likelihood_state import MaximumLikelihoodState
from ospc.observations import Observations
from ospc.pooling.pool import Pool
from ospc.recording import Frame
from ospc.settings import DefaultSettings
from ospc.simulation import SimulationSettings, frames
from ospc.state import container
from ospc.state.run import KIND, VERSION

SMALL = {"points_per_pair": 80, "max_points": 1500, "keyframes": 6, "response_intervals": 8, "radial_terms": 4}
QUICK = replace(DefaultSettings(), rounds=2, **SMALL)
MOST_BYTES = 5_000_000


@pytest.fixture(scope="module", params=["handheld", "static"])
def recording(request):
    """A short recording with an unreadable frame."""
    simulated = list(frames(SimulationSettings(size=(128, 96), frames=30, motion=request.param, noise="low")))

    def fail():
        raise FrameError("frame 5: damaged")

    simulated[5] = replace(simulated[5], load=fail)
    return simulated


def pushed(recording, calibrator):
    for frame in remaining(calibrator, recording):
        calibrator.push(frame)
    return calibrator


def as_text(calibrator):
    return json.dumps(calibrator.calibration().as_dict())


@pytest.fixture(scope="module")
def uninterrupted(recording):
    return as_text(pushed(recording, OnlineCalibrator(QUICK)))


@settings(max_examples=2)
@given(data=st.data())
def test_interrupted_anywhere_and_resumed_it_ends_bit_identical(recording, uninterrupted, tmp_path_factory, data):
    place = tmp_path_factory.mktemp("state") / "state.ospc"
    stops = sorted(data.draw(st.lists(st.integers(0, len(recording)), min_size=1, max_size=4)))
    calibrator = OnlineCalibrator(QUICK)
    for stop in stops:
        pushed(recording[:stop], calibrator)
        calibrator.save_state(place)
        calibrator = OnlineCalibrator.load_state(place)
        assert calibrator.frames == stop
    assert as_text(pushed(recording, calibrator)) == uninterrupted


@settings(max_examples=2)
@given(gone=st.integers(0, 29))
def test_saved_after_the_recording_was_removed_it_ends_the_same(recording, uninterrupted, tmp_path_factory, gone):
    """All frames from one on are unreadable, as after removing a disk, and later readable again."""

    def fail():
        raise RecordingError("the folder was removed")

    place = tmp_path_factory.mktemp("state") / "state.ospc"
    calibrator = OnlineCalibrator(QUICK)
    removed = [replace(frame, load=fail, verify=fail) for frame in recording[gone:]]
    with suppress(RecordingError):
        pushed([*recording[:gone], *removed], calibrator)
    assert calibrator.frames == gone
    calibrator.save_state(place)
    assert as_text(pushed(recording, OnlineCalibrator.load_state(place))) == uninterrupted


def test_a_state_within_a_frame_is_not_saved(recording, tmp_path, monkeypatch):
    calibrator = pushed(recording[:4], OnlineCalibrator(QUICK))
    before = calibrator.save_state(tmp_path / "state.ospc").read_bytes()

    def fail(*_):
        waiting.append(another.submit(calibrator.save_state, tmp_path / "state.ospc"))
        time.sleep(0.1)
        raise MemoryError

    waiting = []
    monkeypatch.setattr(EpochData, "add", fail)
    with ThreadPoolExecutor(1) as another, pytest.raises(MemoryError):
        pushed(recording[:5], calibrator)
    for save in (waiting[0].result, lambda: calibrator.save_state(tmp_path / "state.ospc")):
        with pytest.raises(FormatError, match="frame 4 was only partly processed"):
            save()
    assert (tmp_path / "state.ospc").read_bytes() == before


def test_saving_changes_nothing_and_equal_states_are_equal_files(recording, uninterrupted, tmp_path):
    calibrator = OnlineCalibrator(QUICK)
    for frame in recording:
        calibrator.push(frame)
        if calibrator.frames % 8 == 0:
            calibrator.save_state(tmp_path / "a.ospc")
    assert as_text(calibrator) == uninterrupted
    OnlineCalibrator.load_state(tmp_path / "a.ospc").save_state(tmp_path / "b.ospc")
    assert (tmp_path / "a.ospc").read_bytes() == (tmp_path / "b.ospc").read_bytes()


def test_without_the_earlier_frames_it_goes_on_all_the_same(recording, tmp_path):
    calibrator = pushed(recording[:16], OnlineCalibrator(QUICK))
    before = calibrator.calibration().counts["pairs"]
    calibrator.save_state(tmp_path / "state.ospc")
    robot = OnlineCalibrator.load_state(tmp_path / "state.ospc")
    assert robot.frames_to_replay
    with pytest.raises(FrameError, match="not one of frames_to_replay; set its index to its number in the run"):
        robot.replay(Frame.of_array(recording[10].image, 1.0))  # without an index it would pass as the first frame
    for frame in recording[16:]:
        robot.push(frame)
    after = robot.calibration().counts
    assert after["frames"] == len(recording)
    # The first new frame has no earlier one to compare with.
    assert before + 11 <= after["pairs"] < before + 14


def test_the_state_of_a_large_and_long_recording_is_small(tmp_path):
    """The largest possible state: all points kept, noise in every digit, and the series of a static camera."""
    random = np.random.default_rng(0)
    noise = random.integers(0, 65535, (600, 800), dtype=np.uint16)
    calibrator = OnlineCalibrator()
    calibrator.push(Frame.of_array(noise, 1.0))
    data = calibrator._method._data
    kept, series = data.reservoir, data.stationary.series
    points = kept.capacity // 300
    for pair in range(300):
        kept.add(seen_twice(random, points, pair))
    for index in range(1, series.frames):
        series.observe(Frame.of_array(noise, 1.0, index=index))
    assert (kept.points, len(series)) == (DefaultSettings().max_points, series.frames)
    assert calibrator.save_state(tmp_path / "state.ospc").stat().st_size < MOST_BYTES


def seen_twice(random, points, pair):
    n = 2 * points
    return Observations(
        grey=random.random(n).astype(np.float32).astype(np.float64),
        position=random.random((n, 2)),
        gradient=random.random(n).astype(np.float32).astype(np.float64),
        grey_variance=np.zeros(n),
        grey_third_moment=np.zeros(n),
        frame_moments=np.zeros((n, 6), np.float32),
        surround_moments=np.zeros((n, 2, 7), np.float32),
        frame=np.tile([pair, pair + 7], points),
        point=np.repeat(np.arange(points), 2),
        group=np.full(n, pair),
    )


def test_everything_a_method_learns_is_in_its_state():
    """An attribute that is neither saved nor recreated would be lost silently."""
    made_anew = {"settings", "size", "max_grey", "register", "sample", "second"}
    not_needed = {"inputs", "latest", "lost"}
    saved = {"data", "changes"}
    method = MaximumLikelihoodMethod(DefaultSettings(), (64, 48), 255)
    known = {name.lstrip("_") for name in vars(method)}
    assert known == made_anew | not_needed | saved | {"quick_fit", "select_keyframe"}
    of_quick_fit = {"fit", "trusts_stated"}
    made_anew = {"settings", "size", "max_grey", "basis", "normalize", "response_sigma", "vignette_sigma"}
    assert {name.lstrip("_") for name in vars(method._quick_fit)} - made_anew == of_quick_fit
    assert set(MaximumLikelihoodState.__dataclass_fields__) == saved | of_quick_fit | {"keyframes"}


def test_everything_an_engine_knows_is_in_its_state():
    made_anew = {"settings", "lock", "second", "preprocess", "prior"}
    not_needed = {"expected", "partly_processed"}
    calibrator = OnlineCalibrator()
    assert {name.lstrip("_") for name in vars(calibrator)} == made_anew | not_needed | {"run", "method"}
    assert vars(calibrator._run).keys() == Run.__dataclass_fields__.keys()


def test_everything_known_of_the_exposures_is_in_their_state():
    known = {name.lstrip("_") for name in vars(ExposureMonitor("auto"))}
    assert known - {"findings"} == {name.lstrip("_") for name in ExposureMonitor.__dataclass_fields__}


@pytest.mark.parametrize("choice", ["auto", "never", "estimated", 0, -2])
def test_the_choice_about_a_lag_is_saved(tmp_path, choice):
    calibrator = OnlineCalibrator(QUICK, correct_lag=choice)
    calibrator.push(Frame.of_array(np.zeros((48, 64), np.uint8), 1.0))
    again = OnlineCalibrator.load_state(calibrator.save_state(tmp_path / "state.ospc"))
    assert again.correct_lag == choice
    assert again._run.exposures.table.lag_frames == calibrator._run.exposures.table.lag_frames


def test_before_the_first_usable_frame_there_is_a_state_too(tmp_path):
    calibrator = OnlineCalibrator(QUICK)
    calibrator.push(Frame.of_array(np.zeros((8, 8), np.uint8), float("nan")))
    calibrator.save_state(tmp_path / "state.ospc", complete=True)
    again = OnlineCalibrator.load_state(tmp_path / "state.ospc")
    assert again.status == calibrator.status
    assert again.settings == QUICK


def test_the_papers_method_has_no_state(tmp_path):
    with pytest.raises(SettingError, match="preset paper"):
        OnlineCalibrator("paper").save_state(tmp_path / "state.ospc")
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    calibrator = OnlineCalibrator(QUICK)
    for frame in frames(SimulationSettings(size=(160, 120), frames=6)):
        calibrator.push(frame)
    return calibrator.save_state(tmp_path_factory.mktemp("saved") / "state.ospc")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"layout": "0123456789abcdef"}, r"another version of the method .* cannot be continued"),
        ({"run": {}}, "not readable as a state"),
        ({"run": None}, "not readable as a state"),
        ({"method": {}}, "not readable as a state"),
    ],
)
def test_a_file_of_another_version_is_refused(saved, tmp_path, change, said):
    found = container.load(saved, KIND, VERSION)
    other = container.save(replace(found, content=found.content | change), tmp_path / "other.ospc")
    with pytest.raises(FormatError, match=rf"^{other}: .*{said}"):
        OnlineCalibrator.load_state(other)


@pytest.mark.parametrize(
    "settings_of_another",
    [
        {"preset": "future"},
        {"preset": "default", "unknown": 1},
        {"preset": "paper"},
        {"preset": "default", "keyframes": -1},
    ],
)
def test_settings_of_another_version_are_refused(saved, tmp_path, settings_of_another):
    found = container.load(saved, KIND, VERSION)
    run = found.content["run"] | {"settings": settings_of_another}
    other = container.save(replace(found, content=found.content | {"run": run}), tmp_path / "other.ospc")
    with pytest.raises(FormatError, match=rf"^{other}: "):
        OnlineCalibrator.load_state(other)


@pytest.mark.parametrize(("version", "age"), [(VERSION - 1, "an older"), (VERSION + 1, "a newer")])
def test_states_of_other_versions_are_refused_by_name(saved, tmp_path, version, age):
    found = container.load(saved, KIND, VERSION)
    other = container.save(replace(found, version=version), tmp_path / "other.ospc")
    for load in (OnlineCalibrator.load_state, Pool.load):
        with pytest.raises(FormatError, match=rf"^{other}: was written by {age} version .* create it again"):
            load(other)


@pytest.mark.parametrize("listed", [1000, 0])
def test_a_run_interrupted_within_repeated_images_skips_the_same_frames(tmp_path, monkeypatch, listed):
    monkeypatch.setattr(brightness_history, "MAX_REPEATED_FRAMES", listed)
    images = list(np.random.default_rng(4).integers(60, 200, (4, 96, 128)).astype(np.uint8))
    images[2] = images[3] = images[1]
    exposures_ms = (4.0, 5.0, 6.0, 6.0)
    pushed = [Frame.of_array(*each, index=i) for i, each in enumerate(zip(images, exposures_ms, strict=True))]
    whole, begun = OnlineCalibrator(), OnlineCalibrator()
    drive(whole, pushed)
    drive(begun, pushed[:3])
    resumed = OnlineCalibrator.load_state(begun.save_state(tmp_path / "state.ospc"))
    drive(resumed, pushed)
    assert whole.status.skipped == resumed.status.skipped
    assert len(whole.status.skipped) == 2
