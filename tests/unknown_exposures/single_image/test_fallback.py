"""The fallback for single images: the function and the command."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from command_line import leave_out, ospc
from ospc.errors import FrameError, RecordingError
from ospc.evaluation.metrics import coverage
from ospc.photometry.calibration import Calibration
from ospc.photometry.vignette import PolynomialVignette
from ospc.recording import ArrayRecording
from ospc.simulation.responses import filmic, logarithmic, srgb
from ospc.unknown_exposures.single_image.fallback import calibrate_single_images
from polygon_pictures import picture

VIGNETTE = PolynomialVignette((320, 240), (-0.3, -0.05, 0.0))


def guess(*images):
    """Return the calibration guessed from the green of images in memory."""
    greens = [np.ascontiguousarray(image[..., 1]) for image in images]
    return calibrate_single_images(ArrayRecording(greens, np.ones(len(images))))


@pytest.fixture(scope="module")
def photographs():
    return {r.model["name"]: (r, picture(r, vignette=VIGNETTE)) for r in (srgb(), filmic(), logarithmic())}


@pytest.fixture(scope="module")
def calibrations(photographs):
    return {name: guess(image) for name, (_, image) in photographs.items()}


def test_bands_cover_the_truth(photographs, calibrations):
    shares = []
    for name, (response, _) in photographs.items():
        found = calibrations[name]
        estimate = found.response
        shares.append(coverage(estimate.inverse_table, estimate.inverse_sigma, estimate.matched(response))[1])
        radii = np.linspace(0, 1, 51)
        error = np.abs(found.vignette.profile(radii) - VIGNETTE.profile(radii))
        assert np.all(error[5:] < 2 * found.vignette_sigma[5:])
    assert np.mean(shares) > 0.9


def test_nothing_is_identifiable(calibrations):
    found = calibrations["srgb"]
    assert found.verdicts["response"].state == found.verdicts["vignette"].state == "marginal"
    assert found.verdicts["exposures"].state == "not identifiable"
    assert not found.complete
    assert np.all(found.response.log_sigma > 0.05)


def test_the_fallback_needs_its_option_and_states_its_basis(photographs, tmp_path, monkeypatch):
    leave_out(monkeypatch, "draw")
    photo, out = tmp_path / "photo.png", tmp_path / "out"
    cv2.imwrite(str(photo), photographs["srgb"][1])
    refused = ospc("calibrate", photo, "-o", out)
    assert isinstance(refused.exception, RecordingError)
    assert "--fallback single-image" in str(refused.exception)
    result = ospc("calibrate", photo, "-o", out, "--fallback", "single-image", "--json")
    assert result.exit_code == 3, result.output
    said = json.loads(result.stdout)["rests_on"]
    assert "typical curve" in said
    assert said in (out / "EXPOSURES_UNKNOWN.txt").read_text()
    assert said.encode("latin-1", "ignore") in (out / "vignette.png").read_bytes()
    assert Calibration.load(out).rests_on == said
    assert "Guessed from 1 image" in (out / "report.html").read_text()
    for options, names in (
        (("--unknown-exposures", "--resume"), "--unknown-exposures or --resume"),
        (("--channel", "each"), "--channel each"),
        (("--all-cameras",), "--all-cameras"),
    ):
        wrong = ospc("calibrate", photo, "-o", out, "--fallback", "single-image", *options)
        assert wrong.exit_code == 2
        assert f"--fallback cannot be combined with {names}" in wrong.stderr


def test_a_calibration_is_for_the_grey_values_of_its_photograph_or_recording(photographs, tmp_path, monkeypatch):
    leave_out(monkeypatch, "draw", "report")
    words = photographs["srgb"][1][:160, :200, 1].astype(np.uint16) << 4
    (tmp_path / "folder").mkdir()
    for place in ("photo.png", "folder/0.png", "folder/1.png"):
        cv2.imwrite(str(tmp_path / place), words)
    for place in ("photo.png", "folder"):
        out = tmp_path / f"of_{place}"
        result = ospc("calibrate", tmp_path / place, "-o", out, "--fallback", "single-image", "-q")
        assert result.exit_code == 3, result.output
        assert Calibration.load(out).max_grey == 4095
        assert (out / "pcalib_16bit.txt").is_file()


def test_black_images_give_usual_curves_and_tiny_ones_none():
    assert "for lack of exposed pixels" in guess(np.zeros((200, 300, 3), np.uint8)).rests_on
    with pytest.raises(FrameError, match="7×5"):
        guess(np.full((5, 7, 3), 90, np.uint8))


def test_a_folder_and_a_video_give_several_images(photographs, tmp_path, monkeypatch):
    leave_out(monkeypatch, "draw", "report")
    image = photographs["srgb"][1][:120, :160]
    (tmp_path / "folder").mkdir()
    for number in range(3):
        cv2.imwrite(str(tmp_path / "folder" / f"{number}.png"), image)
    video = cv2.VideoWriter(str(tmp_path / "film.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 20, image.shape[1::-1])
    for _ in range(20):
        video.write(image)
    video.release()
    for name, count in (("folder", "3 images"), ("film.avi", "8 images")):
        result = ospc("calibrate", tmp_path / name, "-o", tmp_path / "out", "--fallback", "single-image", "--json")
        assert result.exit_code == 3, result.output
        assert f"Guessed from {count}" in json.loads(result.stdout)["rests_on"]
