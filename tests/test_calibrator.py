"""The calibrator: frames it uses, rejects and counts, and its result after an interruption."""

from __future__ import annotations

import copy
import gc
import json
import pickle
import sys
import weakref
from dataclasses import dataclass, field, fields, replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ospc.calibrator import OnlineCalibrator, calibrate
from ospc.correspondence.frame_sampling import FrameSampler
from ospc.engine.frame_checks import LATEST_REASONS
from ospc.engine.state import Epoch
from ospc.errors import FrameError, OspcError, SettingError
from ospc.live import LiveCalibrator
from ospc.methods.change_detection import Change
from ospc.methods.method import Progress
from ospc.photometry.calibration import Calibration
from ospc.recording import ArrayRecording, Frame
from ospc.recording.recording import identity
from ospc.settings import DefaultSettings, PaperSettings, as_dict, preset, with_overrides
from ospc.settings.methods import MAX_EPOCH_CALIBRATIONS
from workers import preprocessor

IMAGE = np.full((6, 8), 90, np.uint8)


class Noting:
    """A method that records its frames."""

    def __init__(self, size, max_grey):
        self.size, self.max_grey, self.frames = size, max_grey, []

    longest_pause = sys.maxsize

    def compare(self, brightness, exposures):
        return None

    def push(self, frame, prepared, exposures):
        if frame.name == "frame 13":
            raise FrameError("frame 13: the method cannot use it")
        self.frames.append(frame.index)

    @property
    def progress(self):
        return Progress(pairs=len(self.frames))

    def inputs(self, exposures, grey_range):
        return None

    def calibration(self, exposures, grey_range):
        return Calibration(self.size, max_grey=self.max_grey, counts={"pairs": len(self.frames)})


@dataclass(frozen=True)
class NotingSettings:
    """Settings of the recording method."""

    strength: float = 1.5
    made: list = field(default_factory=list, compare=False)

    name = "noting"
    real_time = True

    def sampler(self):
        return FrameSampler.every_frame()

    def preprocessor(self):
        return preprocessor()

    def state_type(self):
        return None

    def build(self, size, max_grey):
        self.made.append(Noting(size, max_grey))
        return self.made[-1]


def test_frames_without_an_index_are_numbered_in_their_order():
    settings = NotingSettings()
    calibrator = OnlineCalibrator(settings)
    for _ in range(3):
        calibrator.push(Frame.of_array(IMAGE, 1.0))
    assert settings.made[0].frames == [0, 1, 2]


def frame(index, exposure_ms=1.0, image=IMAGE):
    return Frame.of_array(image, exposure_ms, index=index)


def unreadable(index):
    def fail():
        raise FrameError(f"{index}.png: cannot be decoded; copy it again")

    return Frame(index, 0.0, 1.0, f"{index}.png", fail)


def in_colour(index):
    """Make a colour frame, as recordings opened for correction return them."""
    return Frame(index, 0.0, 1.0, f"{index}.png", lambda: np.zeros((6, 8, 3), np.uint8), colour=True)


@pytest.mark.parametrize("values", [{"max_points": 5e3}, {"max_points": np.float64(5)}, {"min_points": None}])
def test_settings_of_another_type_are_refused_before_the_run(values):
    with pytest.raises(SettingError, match="takes a value of type int"):
        DefaultSettings(**values)


def test_settings_may_be_numbers_of_numpy():
    assert DefaultSettings(max_points=np.int64(500), smoothing_px=np.float32(2)) == DefaultSettings(
        max_points=500, smoothing_px=2.0
    )


@pytest.mark.parametrize(
    ("setting", "most"), [("response_intervals", 256), ("series_intervals", 256), ("radial_terms", 32)]
)
def test_settings_that_no_calibration_or_state_may_have_are_refused(setting, most):
    DefaultSettings(**{setting: most})
    for value in (most + 1, most * 10) if setting == "radial_terms" else (1, most + 1):
        with pytest.raises(SettingError, match=rf"{setting} is {value}; give a number from \d to {most}"):
            DefaultSettings(**{setting: value})


def test_a_class_of_settings_is_no_settings():
    with pytest.raises(SettingError, match="settings are of type type"):
        OnlineCalibrator(DefaultSettings)


def test_an_impossible_exposure_costs_one_frame_and_not_the_state(tmp_path):
    online = OnlineCalibrator()
    for exposure_ms in (1.0, 1.4e-41, 1e300, 1.0):
        online.push(Frame.of_array(IMAGE, exposure_ms))
    assert OnlineCalibrator.load_state(online.save_state(tmp_path / "a.ospc")).frames == 4
    assert any("not between" in reason for reason in online.first_reasons)


@pytest.mark.parametrize("choice", ["Never", "3", "", 1.5, None, True, [1]])
@pytest.mark.parametrize(
    "make", [OnlineCalibrator, LiveCalibrator, partial(calibrate, ArrayRecording([IMAGE] * 3, [1.0] * 3))]
)
def test_a_lag_that_is_no_choice_is_refused(make, choice):
    with pytest.raises(SettingError, match="'auto', 'never', 'estimated' or a whole number"):
        make(correct_lag=choice)


@pytest.mark.parametrize("make", [OnlineCalibrator, LiveCalibrator])
def test_a_lag_that_no_state_could_contain_is_refused(make):
    with pytest.raises(SettingError, match="a lag of 1001 frames is too large"):
        make(correct_lag=-1001)


@pytest.mark.parametrize("choice", ["auto", "never", "estimated", 0, -2, np.int64(3)])
def test_a_lag_is_kept_as_it_was_chosen(choice):
    kept = OnlineCalibrator(correct_lag=choice).correct_lag
    assert kept == choice
    assert type(kept) in (str, int)


def test_a_lag_from_numpy_may_not_be_longer_than_the_recording_either():
    with pytest.raises(SettingError, match="too large for 3 frames"):
        calibrate(ArrayRecording([IMAGE] * 3, [1.0] * 3), correct_lag=np.int64(2))


def test_a_lag_of_zero_is_possible_for_a_single_frame():
    image = np.random.default_rng(0).integers(0, 256, (48, 64)).astype(np.uint8)
    single = ArrayRecording([image], [1.0])
    assert calibrate(single, correct_lag=0).verdicts["response"] == calibrate(single).verdicts["response"]


# Frame by frame.


def test_a_calibrator_that_is_no_longer_used_is_freed_without_a_garbage_collection():
    calibrator = OnlineCalibrator()
    image = np.random.default_rng(1).integers(0, 200, (48, 64), dtype=np.uint8)
    for index in range(4):
        calibrator.push(frame(index, 1.0 + index, np.roll(image, index, axis=1)))
    calibrator.end_threads()
    kept = weakref.ref(calibrator)
    gc.disable()
    try:
        calibrator = None
        assert kept() is None
    finally:
        gc.enable()


class GrowingWhileRead(list):
    """A list that grows after each iteration, as if another thread appended to it."""

    def __iter__(self):
        yield from tuple(super().__iter__())
        self.append(Epoch(10 * len(self), 10 * len(self) + 9, None, None))


class Changing(Noting):
    """A method in whose view every third frame shows another camera."""

    def push(self, frame, prepared, exposures):
        super().push(frame, prepared, exposures)
        change = Change(frame.index, frame.index, "vignette", "it has another lens")
        return change if frame.index and frame.index % 3 == 0 else None

    def since(self, number):
        return self


def test_only_the_latest_epochs_keep_their_calibrations_and_all_keep_their_exposures(monkeypatch):
    monkeypatch.setattr(NotingSettings, "build", lambda _, *given: Changing(*given))
    calibrator = OnlineCalibrator(NotingSettings(), correct_lag=1)
    for number in range(3 * (MAX_EPOCH_CALIBRATIONS + 5) + 1):
        calibrator.push(frame(number))
    *ended, _ = calibrator.epochs
    assert [epoch.first_frame for epoch in ended] == list(range(0, 3 * len(ended), 3))
    changes = [f"since about frame {epoch.last_frame + 1}, it has another lens" for epoch in ended]
    assert [epoch.change.text for epoch in ended] == changes
    assert [epoch.calibration is not None for epoch in ended] == [False] * 5 + [True] * MAX_EPOCH_CALIBRATIONS
    assert {epoch.corrected_lag_frames for epoch in ended} == {1}
    calibrator._run.epochs[0] = replace(ended[0], corrected_lag_frames=2, wrong_exposures=(1,))
    source = calibrator.calibration().source
    assert source["exposure_lags_corrected_until"] == [[3, 2], *([epoch.last_frame + 1, 1] for epoch in ended[1:])]
    assert source["exposures_ignored_of_frames"] == [1]


def test_epochs_follow_each_other_while_another_thread_ends_one():
    calibrator = OnlineCalibrator()
    calibrator._run.epochs = GrowingWhileRead([Epoch(0, 9, None, None)])
    for _ in range(3):
        epochs = calibrator.epochs
        assert [e.first_frame for e in epochs[1:]] == [e.last_frame + 1 for e in epochs[:-1]]


@dataclass(frozen=True)
class Comparing(NotingSettings):
    """Settings that process the first frame and compare the following ones."""

    def sampler(self):
        return FrameSampler(1, 1, 99, 100, 100, _pause=0, processed=99)


@pytest.mark.parametrize("pauses", [False, True])
def test_frames_that_repeat_the_previous_image_with_another_exposure_are_skipped(monkeypatch, pauses):
    """A recorder repeats an image if one was lost, and goes on to state the exposures of the lost ones."""
    settings = NotingSettings()
    if pauses:  # every second frame is processed
        sampler = FrameSampler(1, 99, 1, 1000, 0, processed=2, expects_repeats=True)
        monkeypatch.setattr(NotingSettings, "sampler", lambda _: sampler)
    calibrator = OnlineCalibrator(settings)
    random = np.random.default_rng(2)
    images = [random.integers(60, 200, (48, 64)).astype(np.uint8) for _ in range(16)]
    repeats = [1, 6, 9, 10, 12, 14]
    for number in repeats:
        images[number] = images[number - 1]
    exposures_ms = [4.0 + number for number in range(16)]
    exposures_ms[10] = exposures_ms[9]  # not that of its image
    exposures_ms[12] = exposures_ms[11]
    for image, exposure_ms in zip(images, exposures_ms, strict=True):
        calibrator.push(Frame.of_array(image, exposure_ms))
    used = settings.made[0].frames
    assert used == ([0, 2, 4, 7, 11, 15] if pauses else [0, 2, 3, 4, 5, 7, 8, 11, 15])  # frame 12 shows nothing new
    assert "frame 14: repeats the previous image with another exposure" in " ".join(calibrator.status.skipped)


def test_a_frame_that_repeats_the_previous_image_does_not_use_up_a_turn(monkeypatch):
    """A video of more frames per second than the camera shows each image several times, with its exposure."""
    settings = NotingSettings()
    every_second = FrameSampler(1, 99, 1, 1000, 0, processed=2, expects_repeats=True)
    monkeypatch.setattr(NotingSettings, "sampler", lambda _: every_second)
    calibrator = OnlineCalibrator(settings)
    random = np.random.default_rng(3)
    for number in range(6):
        image = random.integers(60, 200, (48, 64)).astype(np.uint8)
        for _ in range(3):
            calibrator.push(Frame.of_array(image, 4.0 + number))
    assert settings.made[0].frames == [0, 3, 6, 9, 12, 15]
    assert not calibrator.status.skipped


def test_good_frames_reach_the_method_in_their_order():
    settings = NotingSettings()
    calibrator = OnlineCalibrator(settings)
    assert all(calibrator.push(frame(i)) for i in range(5))
    (method,) = settings.made
    assert method.frames == [0, 1, 2, 3, 4]
    assert (method.size, method.max_grey) == ((8, 6), 255)
    result = calibrator.calibration()
    assert result.counts == {"frames": 5, "skipped": 0, "pairs": 5}
    assert result.size == (8, 6)
    assert result.settings["strength"] == 1.5
    assert result.settings["preset"] == "noting"
    assert not result.partial


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (unreadable(7), "7.png: cannot be decoded; copy it again"),
        (frame(7, float("nan")), "frame 7: its exposure is unknown"),
        (frame(7, None), "frame 7: its exposure is unknown"),
        (Frame(7, 0.0, None, "7.png", lambda: IMAGE), "7.png: its exposure is unknown"),
        (frame(7, float("inf")), "frame 7: exposure inf ms is not a positive number"),
        (frame(7, 0.0), "frame 7: exposure 0.0 ms is not a positive number"),
        (frame(7, -1.0), "frame 7: exposure -1.0 ms is not a positive number"),
        (frame(7, image=np.zeros((8, 6), np.uint8)), "frame 7: 6×8 pixels, but the first frame has 8×6"),
        (
            replace(frame(7), max_grey=127),
            "frame 7: its largest grey value is 127, but that of the first frame is 255",
        ),
        (replace(frame(7), mask=np.ones((3, 4), bool)), "frame 7: its mask has 4×3 pixels, but the frames have 8×6"),
        (replace(frame(7), mask=np.zeros((6, 8), bool)), "frame 7: its mask excludes every pixel"),
        (frame(13), "frame 13: the method cannot use it"),
        (in_colour(7), "7.png: is in colour; open the recording with one of its channels"),
    ],
    ids=[
        *("unreadable", "nan", "none", "none given directly", "infinite", "zero", "negative"),
        *("other size", "other depth", "mask of another size", "empty mask", "refused by the method", "in colour"),
    ],
)
def test_a_bad_frame_is_skipped_counted_and_its_reason_kept(bad, reason):
    settings = NotingSettings()
    calibrator = OnlineCalibrator(settings)
    assert calibrator.push(frame(0))
    assert not calibrator.push(bad)
    assert calibrator.push(frame(1))
    assert settings.made[0].frames == [0, 2]
    status = calibrator.status
    assert status.frames == 3
    assert len(status.skipped) == 1
    assert status.skipped[0].startswith(reason)
    assert calibrator.calibration().counts == {"frames": 3, "skipped": 1, "pairs": 2}


@pytest.mark.parametrize(("kind", "max_grey"), [(np.uint8, 1), (np.uint8, 65535), (np.uint16, 50)])
def test_frames_whose_grey_values_do_not_match_the_largest_one_are_skipped(kind, max_grey):
    calibrator = OnlineCalibrator()
    images = np.random.default_rng(3).integers(60, 200, (3, 48, 64)).astype(kind)
    for i, image in enumerate(images):
        assert not calibrator.push(Frame(i, float(i), 1.0 + i, f"{i}.png", lambda image=image: image, max_grey))
    assert f"0.png: max_grey is {max_grey}, which does not match" in calibrator.status.skipped[0]


def test_what_is_black_in_the_image_of_a_mask_is_not_used():
    image = np.random.default_rng(3).integers(60, 200, (48, 64)).astype(np.uint8)
    mask = np.full(image.shape, 255, np.uint8)
    image[:10], mask[:10] = 240, 0
    calibrator = OnlineCalibrator()
    assert calibrator.push(replace(Frame.of_array(image, 1.0), mask=mask))
    assert calibrator.pixels.report().highest_grey < 200


def test_the_first_frame_that_can_be_read_says_how_large_they_are():
    calibrator = OnlineCalibrator(NotingSettings())
    assert not calibrator.push(unreadable(0))
    assert not calibrator.push(frame(1, 0.0, np.zeros((3, 3), np.uint8)))
    assert calibrator.push(frame(2))
    assert calibrator.calibration().size == (8, 6)


@pytest.mark.parametrize(("used", "told"), [(3, True), (4, False)])
def test_the_remedy_is_about_unusable_frames_if_most_are(used, told):
    calibrator = OnlineCalibrator()
    for index in range(used):
        calibrator.push(Frame.of_array(np.zeros((48, 64), np.uint8), 1.0, index=index))
    for index in range(used, used + 4):
        assert not calibrator.push(Frame.of_array(np.zeros((96, 128), np.uint8), 1.0, index=index))
    found = calibrator.calibration()
    lost = f"4 of {used + 4} frames could not be used: frame {used}: 128×96 pixels, but the first frame has 64×48"
    unknown = [verdict for verdict in found.verdicts.values() if verdict.state != "identifiable"]
    assert unknown
    assert [verdict.remedy.startswith(lost) for verdict in unknown] == [told] * len(unknown)
    assert any(text.startswith(lost) for text in found.advice) == told


def test_only_the_latest_reasons_are_remembered_but_all_are_counted():
    calibrator = OnlineCalibrator(NotingSettings())
    calibrator.push(frame(0))
    for index in range(1, 101):
        assert not calibrator.push(unreadable(index))
    status = calibrator.status
    assert len(status.skipped) == LATEST_REASONS
    assert status.skipped[-1].startswith("100.png")
    assert calibrator.calibration().counts["skipped"] == 100


def test_before_any_frame_there_is_progress_but_no_calibration():
    calibrator = OnlineCalibrator()
    assert calibrator.status.frames == 0
    assert calibrator.status.progress == Progress()
    with pytest.raises(OspcError, match=r"^no frame could be used$"):
        calibrator.calibration()
    calibrator.push(unreadable(3))
    with pytest.raises(OspcError, match=r"^no frame could be used: 3\.png: cannot be decoded; copy it again$"):
        calibrator.calibration()


def test_errors_that_are_not_the_frames_are_not_swallowed():
    class Broken(Noting):
        def push(self, frame, prepared, exposures):
            raise ZeroDivisionError

    @dataclass(frozen=True)
    class BrokenSettings(NotingSettings):
        def build(self, size, max_grey):
            return Broken(size, max_grey)

    with pytest.raises(ZeroDivisionError):
        OnlineCalibrator(BrokenSettings()).push(frame(0))


def test_an_unknown_preset_is_named_with_the_known_ones():
    with pytest.raises(SettingError, match="'hasty'; known: default, fast, paper"):
        OnlineCalibrator("hasty")


def test_settings_of_another_type_are_refused():
    with pytest.raises(
        SettingError, match=r"of type dict; .*DefaultSettings\(max_points=5000\); .* zip\(images, exp"
    ):
        OnlineCalibrator({"max_points": 5000})


def test_a_wrong_setting_is_an_error_not_a_bad_frame():
    with pytest.raises(SettingError, match="brisk"):
        OnlineCalibrator(replace(PaperSettings(), features="brisk")).push(frame(0))


# Whole recordings.


def recording(count=9, images=None):
    images = images or [IMAGE] * count
    return ArrayRecording(images, np.linspace(1, 2, len(images)), name="kitchen")


def test_a_recording_is_calibrated_and_named():
    seen = []
    result = calibrate(recording(), NotingSettings(), progress=seen.append)
    assert result.counts == {"frames": 9, "skipped": 0, "pairs": 9}
    assert result.source.items() >= identity(recording()).items()
    assert result.source["name"] == "kitchen"
    assert not result.partial
    assert [status.frames for status in seen] == list(range(1, 10))
    assert [status.progress.pairs for status in seen] == list(range(1, 10))


@pytest.mark.parametrize("last", [1, 4, 9])
def test_interrupted_it_returns_what_is_known_marked_as_partial(last):
    def interrupt(status):
        if status.frames == last:
            raise KeyboardInterrupt

    result = calibrate(recording(), NotingSettings(), progress=interrupt)
    assert result.partial
    assert result.counts == {"frames": last, "skipped": 0, "pairs": last}
    assert result.source.items() >= identity(recording()).items()


@pytest.mark.parametrize("name", ["default", "paper"])
def test_images_without_anything_to_see_give_an_empty_calibration(name, tmp_path):
    grey = [np.full((96, 128), 40 + 9 * i, np.uint8) for i in range(6)]
    result = calibrate(ArrayRecording(grey, 2.0 ** np.arange(6)), name)
    assert result.vignette is None
    assert result.verdicts["vignette"].state == "not identifiable"
    saved = Calibration.load(result.save(tmp_path / "calibration.json"))
    assert saved.as_dict() == result.as_dict()


# Presets.


@pytest.mark.parametrize(("name", "kind"), [("default", DefaultSettings), ("paper", PaperSettings)])
def test_presets_have_names_and_json_compatible_values(name, kind):
    settings = preset(name)
    assert isinstance(settings, kind)
    content = as_dict(settings)
    assert content["preset"] == name
    assert set(content) == {"preset", *(f.name for f in fields(kind))}
    assert json.loads(json.dumps(content, allow_nan=False)) == content


def test_the_papers_numbers_are_those_of_the_paper():
    paper = PaperSettings()
    assert (paper.response_window, paper.vignette_window, paper.vignette_offset) == (200, 400, 30)
    assert (paper.exposure_ratio_low, paper.exposure_ratio_high) == (0.92, 1.08)
    assert (paper.response_max_radial_displacement, paper.vignette_min_radial_displacement) == (0.01, 0.2)
    assert (paper.filter_blocks, paper.filter_bins, paper.filter_min_matches) == (15, 10, 5)
    assert (paper.features, paper.response_degree, paper.vignette_solver) == ("sift", 2, "m-estimator")


@given(st.sampled_from(["default", "paper"]), st.data())
def test_any_setting_can_be_given_as_text(name, data):
    settings = preset(name)
    setting = data.draw(st.sampled_from([f.name for f in fields(settings)]))
    value = getattr(settings, setting)
    choices = {"features": "orb", "response_positivity": "always", "vignette_solver": "l2"}
    choices |= {"registration": "mine", "response_functions": "mine"}
    other = choices[setting] if isinstance(value, str) else value + type(value)(1)
    other = 0.25 if setting == "exposure_ratio_low" else other
    changed = with_overrides(settings, {setting: str(other)})
    assert getattr(changed, setting) == other
    assert type(getattr(changed, setting)) is type(value)
    assert replace(changed, **{setting: value}) == settings
    assert preset(name) == settings


@given(st.sampled_from(["default", "paper"]), st.data(), st.sampled_from(["0", "-1", "nan", "inf", "magic"]))
def test_settings_that_make_no_sense_are_refused(name, data, text):
    settings = preset(name)
    # These two name plug-ins, which are looked up when the method is built.
    named = {"registration", "response_functions"}
    setting = data.draw(st.sampled_from([f.name for f in fields(settings) if f.name not in named]))
    with pytest.raises(SettingError, match=setting):
        with_overrides(settings, {setting: text})


def test_settings_that_do_not_exist_or_do_not_fit_are_refused():
    with pytest.raises(SettingError, match=r"no setting is called 'speed' in preset 'default'; known: .*keyframes"):
        with_overrides(DefaultSettings(), {"speed": "3"})
    with pytest.raises(SettingError, match=r"'keyframe' in preset 'default'; did you mean keyframes\?$"):
        with_overrides(DefaultSettings(), {"keyframe": "3"})
    with pytest.raises(SettingError, match=r"keyframes takes a value of type int, not '2\.5'"):
        with_overrides(DefaultSettings(), {"keyframes": "2.5"})


def test_frames_too_small_to_compare_are_refused():
    calibrator = OnlineCalibrator()
    assert not calibrator.push(Frame.of_array(np.zeros((400, 31), np.uint8), 1.0))
    assert "31×400 pixels are too small" in calibrator.status.skipped[0]


@pytest.mark.parametrize("name", ["default", "paper"])
@pytest.mark.parametrize("size", [(32, 32), (33, 70), (400, 32)])
@pytest.mark.parametrize("moving", [False, True])
def test_the_smallest_frames_give_a_verdict(name, size, moving):
    scene = np.random.default_rng(0).integers(10, 200, (size[1] + 30, size[0] + 30)).astype(np.uint8)
    calibrator = OnlineCalibrator(name)
    for i in range(12):
        shift = i * moving
        image = scene[shift : shift + size[1], shift : shift + size[0]]
        # Noise: exactly equal images with different exposures are skipped.
        assert calibrator.push(Frame.of_array(image + np.uint8(i % 2), 1.0 + i % 5, index=i))
    assert set(calibrator.calibration().verdicts) >= {"response", "vignette"}


@pytest.mark.parametrize(("lag", "frames"), [(0, 1), (2, 2), (2, 3), (5, 4)])
def test_a_given_lag_needs_no_minimum_of_frames(lag: int, frames: int) -> None:
    calibrator = OnlineCalibrator(correct_lag=lag)
    for number in range(frames):
        image = np.random.default_rng(number).integers(20, 200, (120, 160)).astype(np.uint8)
        calibrator.push(Frame.of_array(image, 5.0 + number))
    found = calibrator.calibration()
    assert found.response is None
    assert found.verdicts["response"].state == "not identifiable"


@pytest.mark.parametrize("copied", [pickle.dumps, copy.deepcopy])
def test_a_calibrator_says_how_to_keep_it_instead_of_being_pickled(copied):
    with pytest.raises(OspcError, match="save it with save_state"):
        copied(OnlineCalibrator())
