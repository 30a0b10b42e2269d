"""Recordings without exposures: determined up to one exponent, and every output is labelled accordingly."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from command_line import leave_out, ospc
from ospc.calibrator import calibrate
from ospc.cli.main import cli
from ospc.errors import ExposureError, NotObservableError, RecordingError
from ospc.exposures.estimated import labelled
from ospc.exposures.used import check_exposures_fit
from ospc.formats.dso import CAVEAT
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.response import Response
from ospc.photometry.verdict import Verdict
from ospc.recording import ArrayRecording, Recording, open_recording
from ospc.recording.derived import DerivedRecording, Region, masked
from ospc.recording.exposure_lists import read_times
from ospc.recording.frame import Frame
from ospc.recording.options import ReadingOptions
from ospc.report.charts import ReportFindings
from ospc.report.examples import examples_of
from ospc.report.output_folder import OutputFolder
from ospc.report.pictures import figure_of
from ospc.settings.unknown_exposures import EXPONENT_SIGMA, OBSERVED_OFFSETS_PX, RESPONSE_SAMPLES
from ospc.simulation import SimulationSettings, simulate, truth
from ospc.unknown_exposures import recover_exposures
from ospc.unknown_exposures.joint_estimation import JointEstimate
from ospc.unknown_exposures.recovery import typical_exponent
from ospc.unknown_exposures.response_model import learned_model
from ospc.unknown_exposures.tracking import GainRobustTracker

SETTINGS = SimulationSettings(
    size=(200, 150), frames=40, speed=3.0, exposure="cycle", exposures_ms=(3.0, 6.0, 12.0, 24.0), response="srgb"
)
GREYS = np.linspace(0.15, 0.85, 15)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording whose times.txt has no exposures."""
    place = tmp_path_factory.mktemp("simulated") / "walk"
    simulate(place, SETTINGS)
    lines = [line.split()[:2] for line in (place / "times.txt").read_text().splitlines()]
    (place / "times.txt").write_text("".join(f"{a} {b}\n" for a, b in lines))
    return place


@pytest.fixture(scope="module")
def recovered(folder: Path) -> Recording:
    return recover_exposures(open_recording(folder, options=ReadingOptions(unknown_exposures=True)))


@pytest.fixture(scope="module")
def found(recovered: Recording) -> Calibration:
    return calibrate(recovered)


def test_exposures_are_found_up_to_a_factor_and_an_exponent(recovered: Recording) -> None:
    true = np.log(truth(SETTINGS).exposures_ms)[recovered.frames]
    estimated = np.log(recovered.exposures_ms)
    exponent, factor = np.polyfit(true, estimated, 1)
    assert len(recovered) > 0.9 * SETTINGS.frames
    assert np.std(estimated - exponent * true - factor) < 0.03
    assert abs(np.log(exponent)) < 2 * EXPONENT_SIGMA
    assert any("relative, and up to one exponent" in note for note in recovered.notes)


def slope_on_the_truth(recording: Recording) -> float:
    found = recover_exposures(recording)
    return float(np.polyfit(np.log(truth(SETTINGS).exposures_ms)[found.frames], np.log(found.exposures_ms), 1)[0])


def test_a_static_overlay_outside_the_mask_has_no_effect(folder: Path) -> None:
    opened = open_recording(folder, options=ReadingOptions(unknown_exposures=True))
    images = np.stack([frame.image for frame in opened])
    region = Region(80, 0, 120, 150)
    clean = masked(ArrayRecording(images, np.ones(len(images))), region=region)
    pattern = np.random.default_rng(0).integers(30, 220, (25, 14)).repeat(6, axis=0).repeat(6, axis=1)
    overlaid = images.copy()
    overlaid[:, :, :80] = pattern[:, :80]
    recording = ArrayRecording(overlaid, np.ones(len(images)))
    assert slope_on_the_truth(recording) < 0.4
    slope = slope_on_the_truth(masked(recording, region=region))
    assert slope == slope_on_the_truth(clean)
    assert abs(np.log(slope)) < 2 * EXPONENT_SIGMA


def test_no_point_outside_the_mask_is_observed() -> None:
    rng = np.random.default_rng(1)
    scene = cv2.GaussianBlur(rng.integers(0, 256, (150, 240)).astype(np.uint8), (0, 0), 2)
    scene = cv2.normalize(scene, None, 20, 230, cv2.NORM_MINMAX)
    usable = np.zeros((150, 200), bool)
    usable[40:110, 60:160] = True
    tracker = GainRobustTracker(every=1)
    for index in range(10):
        frame = Frame.of_array(scene[:, 2 * index : 2 * index + 200].copy(), None, index=index, mask=usable)
        tracker.push(frame)
        places = tracker._points.astype(np.float64)
        assert len(places) > 10
        column, row = np.rint(places[:, None] + OBSERVED_OFFSETS_PX).astype(int).T
        assert usable[row, column].all()
    tracker.push(replace(frame, mask=np.zeros_like(usable)))
    assert not len(tracker._points)


def test_the_unit_of_estimated_exposures_is_arbitrary() -> None:
    verdict = Verdict("not identifiable", "if the ratios of the exposures (0.6 to 1.1 ms) are right")
    reason = labelled(Calibration(SETTINGS.size, verdicts={"response": verdict})).verdicts["response"].reason
    assert reason == f"{verdict.reason} (exposures are estimated: their unit is arbitrary)"


def test_response_and_vignette_are_the_true_ones_to_one_power(found: Calibration) -> None:
    known = truth(SETTINGS)
    assert found.response is not None
    assert found.vignette is not None
    exponents = np.log(found.response.inverse(GREYS)) / np.log(known.response.inverse(GREYS))
    assert np.ptp(np.log(exponents)) < 0.12
    power = float(np.median(exponents))
    profile = known.vignette.profile(PROFILE_RADII) ** power
    error = np.abs(found.vignette.profile(PROFILE_RADII) - profile)
    assert error[PROFILE_RADII <= 0.9].max() < 0.03
    # In forty small frames hardly any scene point reaches the corners, and the uncertainty reflects that.
    assert np.all(error <= 0.03 + found.vignette_sigma)


def test_the_truth_is_within_the_uncertainty_that_the_exponent_adds(found: Calibration) -> None:
    known = truth(SETTINGS)
    assert found.response is not None
    assert found.response.inverse_sigma is not None
    assert found.vignette is not None
    assert found.vignette_sigma is not None
    error = np.abs(found.response.inverse_table - found.response.matched(known.response))
    assert np.all(error <= 2 * found.response.inverse_sigma + 1e-9)
    error = np.abs(found.vignette.profile(PROFILE_RADII) - known.vignette.profile(PROFILE_RADII))
    assert np.all(error <= 2 * found.vignette_sigma + 0.01)


def test_the_label_is_in_the_calibration_and_survives_saving(found: Calibration, tmp_path: Path) -> None:
    assert found.exponent_sigma == EXPONENT_SIGMA
    assert not found.converged
    for verdict in found.verdicts.values():
        assert verdict.state == "marginal"
        assert verdict.reason.startswith("up to one exponent: no exposures were known")
    found.save(tmp_path / "calibration.json")
    assert Calibration.load(tmp_path).exponent_sigma == EXPONENT_SIGMA
    content = json.loads((tmp_path / "calibration.json").read_text())
    del content["exponent_sigma"]
    (tmp_path / "calibration.json").write_text(json.dumps(content))
    assert Calibration.load(tmp_path).exponent_sigma == 0


def test_only_the_exposures_that_were_estimated_are_used_with_the_calibration(
    recovered: Recording, found: Calibration, tmp_path: Path
) -> None:
    stated_ms = truth(SETTINGS).exposures_ms[recovered.frames]
    stated = DerivedRecording.of(recovered, np.arange(len(recovered)), stated_ms, note="as stated")
    out = OutputFolder.at(tmp_path)
    out.write(found, recovered)
    np.testing.assert_array_equal(out.findings(found, stated).exposures_ms, recovered.exposures_ms)
    (captions, *_) = ([caption for _, caption in scene] for scene in examples_of(found, recovered).pictures)
    assert all(", exposure " in caption and " ms" not in caption for caption in captions)
    refused = examples_of(found, stated)
    assert refused.pictures == ()
    assert "do not fit the calibration" in refused.notes[0]
    written = read_times(tmp_path / "times.txt").exposures_ms
    check_exposures_fit(DerivedRecording.of(stated, np.arange(len(stated)), written, note="estimated"), found)


def test_commands_refuse_other_exposures_than_the_estimated_ones(tmp_path: Path) -> None:
    recording = simulate(tmp_path / "walk", replace(SETTINGS, frames=4)).path
    known = truth(SETTINGS)
    Calibration(SETTINGS.size, known.response, known.vignette, exponent_sigma=0.3).save(tmp_path / "calibration.json")
    correct = ("correct", recording, tmp_path, "-o", tmp_path / "out")
    for command in (
        [*correct, "--normalise-exposure"],
        ["evaluate", "tracking", recording, "--calibration", tmp_path],
    ):
        result = ospc(*command)
        assert isinstance(result.exception, ExposureError)
        assert "do not fit the calibration" in str(result.exception)
    assert ospc(*correct).exit_code == 0


def test_the_exponent_is_that_of_the_mean_response() -> None:
    curve = learned_model().mean
    made = JointEstimate((2, 2), np.zeros(4), np.zeros(3), np.arange(2), np.zeros(2))
    assert typical_exponent(made) == pytest.approx(1, abs=0.01)
    # A response with any exponent is mapped back.
    assert typical_exponent(replace(made, exponent=1.7)) == pytest.approx(1 / 1.7, rel=0.02)
    assert isinstance(made.response, Response)
    assert len(curve) == RESPONSE_SAMPLES


def test_the_command_needs_the_option_and_labels_every_output(
    folder: Path, recovered: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ospc.unknown_exposures.recover_exposures", lambda *_: recovered)  # avoid a second recovery
    leave_out(monkeypatch, "draw")
    out = tmp_path / "out"
    refused = CliRunner().invoke(cli, ["calibrate", str(folder), "-o", str(out)])
    assert isinstance(refused.exception, RecordingError)
    assert "has no exposure" in str(refused.exception)
    out.mkdir()
    (out / "state.ospc").write_bytes(b"of an earlier run, with which the new result has nothing to do")
    result = CliRunner().invoke(cli, ["calibrate", str(folder), "-o", str(out), "--unknown-exposures"])
    assert result.exit_code == 3, (result.output, result.exception)
    assert "up to one exponent" in " ".join(result.stdout.split())
    assert "up to one exponent" in result.stderr
    assert json.loads((out / "calibration.json").read_text())["exponent_sigma"] == EXPONENT_SIGMA
    assert "up to one common exponent" in (out / "report.html").read_text()
    assert not (out / "state.ospc").exists()
    assert (out / "pcalib.txt").is_file()
    assert "up to one common exponent" in (out / CAVEAT).read_text()
    with Image.open(out / "vignette.png") as vignette:
        assert "up to one common exponent" in vignette.info["Description"]
    assert CliRunner().invoke(cli, ["export", str(out), "--to", "dso", "-o", str(tmp_path / "dso")]).exit_code == 0
    assert (tmp_path / "dso" / CAVEAT).read_text() == (out / CAVEAT).read_text()
    for command in (
        ["export", str(out), "--to", "opencv", "-o", str(tmp_path / "c.yml")],
        ["correct", str(folder), str(out), "-o", str(tmp_path / "corrected")],
    ):
        assert "up to one common exponent" in CliRunner().invoke(cli, command).stderr
    # Once exposures are known, the label is removed.
    OutputFolder.at(out).write(replace(Calibration.load(out), exponent_sigma=0.0))
    assert not (out / CAVEAT).exists()


def test_pictures_are_labelled(found: Calibration) -> None:
    figure = figure_of(ReportFindings(found))
    assert any("up to one common exponent" in text.get_text() for text in figure.texts)


def test_options_it_cannot_be_combined_with(folder: Path, tmp_path: Path) -> None:
    out = ["-o", str(tmp_path / "out")]
    for command, option, *value in (
        (["calibrate", *out], "--resume"),
        (["calibrate", *out], "--start-from", str(tmp_path)),
        (["calibrate", *out], "--checkpoint-every", "1"),
        (["calibrate", *out], "--correct-lag", "2"),
        (["check"], "--correct-lag", "never"),
    ):
        result = CliRunner().invoke(cli, [*command, str(folder), "--unknown-exposures", option, *value])
        assert result.exit_code == 2
        assert f"--unknown-exposures cannot be combined with {option}" in result.stderr


@pytest.mark.parametrize("command", ["calibrate", "check"])
def test_it_can_be_combined_with_a_mask(
    command: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(recording: Recording, *_: object) -> Recording:
        raise NotObservableError(f"{np.count_nonzero(next(iter(recording)).mask)} pixels")

    monkeypatch.setattr("ospc.unknown_exposures.recover_exposures", stop)
    mask = np.zeros((150, 200), np.uint8)
    mask[:, 80:] = 255
    Image.fromarray(mask).save(tmp_path / "mask.png")
    out = ["-o", str(tmp_path / "out")] if command == "calibrate" else []
    arguments = [command, str(folder), *out, "--unknown-exposures", "--mask", str(tmp_path / "mask.png")]
    result = CliRunner().invoke(cli, arguments)
    assert isinstance(result.exception, NotObservableError)
    assert str(result.exception) == "18000 pixels"


def test_images_alone_are_a_recording_then(folder: Path) -> None:
    options = ReadingOptions(unknown_exposures=True)
    (folder / "times.txt").rename(folder / "kept.txt")
    try:
        opened = open_recording(folder / "images", options=options)
        assert len(open_recording(folder, options=options)) == SETTINGS.frames
    finally:
        (folder / "kept.txt").rename(folder / "times.txt")
    assert opened.kind == "image_folder"
    assert len(opened) == SETTINGS.frames
    assert np.all(opened.exposures_ms == 1)
    assert any("has no usable exposures" in note for note in opened.notes)


def test_nothing_to_follow_is_an_error() -> None:
    flat = ArrayRecording(np.full((4, 60, 80), 100, np.uint8), np.ones(4))
    with pytest.raises(NotObservableError, match="exposures cannot be estimated"):
        recover_exposures(flat)
