"""Whole simulated recordings: photometric consistency, file formats, repeatability."""

from __future__ import annotations

import json
import zipfile
from dataclasses import replace

import cv2
import numpy as np
import pytest

from log_polynomials import log_polynomial
from ospc.errors import SettingError
from ospc.photometry.response import Response
from ospc.recording import open_recording
from ospc.simulation import SimulationSettings, frames, irradiances, simulate, truth
from ospc.simulation.responses import RESPONSES

SMALL = SimulationSettings(size=(96, 64), frames=6)


def content_of(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return simulate(tmp_path_factory.mktemp("simulated") / "recording", SMALL)


@pytest.mark.parametrize("name", RESPONSES)
@pytest.mark.parametrize("vignette", ["polynomial", "decentred"])
def test_images_invert_to_one_radiance_but_for_quantisation(name, vignette):
    settings = SimulationSettings(
        size=(96, 64),
        frames=12,
        response=name,
        vignette=vignette,
        noise="none",
        motion="static",
        exposure="sweep",
    )
    known = truth(settings)
    attenuation = known.vignette.image().astype(float)
    lowest, highest = np.zeros((64, 96)), np.full((64, 96), np.inf)
    for frame, exposure_ms in zip(frames(settings), known.exposures_ms, strict=True):
        grey = frame.image.astype(float)
        scale = exposure_ms * attenuation
        dark = known.response.inverse((grey - 0.51) / 255) / scale
        bright = known.response.inverse((grey + 0.51) / 255) / scale
        lowest = np.maximum(lowest, dark)
        highest = np.where(frame.image < 255, np.minimum(highest, bright), highest)
    assert np.all(lowest <= highest * (1 + 1e-5)), "every pixel has a radiance that explains all its grey values"
    seen = next(iter(irradiances(settings))) / (known.exposures_ms[0] * attenuation)
    assert np.all((seen >= lowest * (1 - 1e-4)) & (seen <= highest * (1 + 1e-4)))
    assert np.median(np.log(highest / lowest)[np.isfinite(highest)]) < 0.05


def test_the_same_settings_give_the_same_files(recording, tmp_path):
    again = simulate(tmp_path / "again", SMALL)
    assert content_of(recording.path) == content_of(again.path)
    other = simulate(tmp_path / "other", replace(SMALL, seed=1))
    assert content_of(recording.path)["images/00000.png"] != content_of(other.path)["images/00000.png"]


def test_archives_are_repeatable_and_hold_the_same_images(recording, tmp_path):
    made = [simulate(tmp_path / name, replace(SMALL, archive=True)) for name in ("a", "b")]
    first, second = ((m.path / "images.zip").read_bytes() for m in made)
    assert first == second
    with zipfile.ZipFile(made[0].path / "images.zip") as archive:
        assert archive.namelist() == [f"{i:05d}.png" for i in range(6)]
        assert archive.read("00003.png") == (recording.path / "images" / "00003.png").read_bytes()


def test_it_opens_as_the_recording_that_was_simulated(recording):
    opened = open_recording(recording.path)
    assert (opened.kind, opened.size, len(opened), opened.max_grey) == ("tum_mono", (96, 64), 6, 255)
    np.testing.assert_allclose(opened.exposures_ms, recording.exposures_ms, rtol=1e-8)
    np.testing.assert_allclose(opened.stamps_s, recording.stamps_s, atol=1e-9)
    for read, made in zip(opened, frames(SMALL), strict=True):
        np.testing.assert_array_equal(read.image, made.image)


def test_the_truth_written_with_it_is_that_of_the_settings(recording):
    known = truth(SMALL)
    np.testing.assert_array_equal(recording.exposures_ms, known.exposures_ms)
    np.testing.assert_array_equal(recording.trajectory, known.trajectory)
    np.testing.assert_array_equal(recording.response.inverse_table, known.response.inverse_table)
    np.testing.assert_array_equal(recording.vignette.image(), known.vignette.image())
    written = json.loads((recording.path / "truth.json").read_text())
    assert written["exposures_ms"] == known.exposures_ms.tolist()
    assert written["settings"]["frames"] == 6


@pytest.mark.parametrize("name", RESPONSES)
def test_pcalib_keeps_the_rules_of_its_readers(tmp_path, name):
    made = simulate(tmp_path / "r", replace(SMALL, frames=1, response=name))
    lines = (made.path / "pcalib.txt").read_text().splitlines()
    assert len(lines) == 1
    values = np.array(lines[0].split(), dtype=np.float64)
    assert values.shape == (256,)
    assert (values[0], values[-1]) == (0, 255)
    assert np.all(np.diff(values.astype(np.float32)) > 0)
    # The values are written as 32-bit floats, because the readers use that type.
    np.testing.assert_allclose(values / 255, made.response.resampled(256), rtol=1e-7)


def test_the_other_files_keep_the_rules_of_their_readers(recording):
    times = [line.split() for line in (recording.path / "times.txt").read_text().splitlines()]
    assert len(times) == 6
    assert [name for name, _, _ in times] == [f"{i:05d}" for i in range(6)]
    assert all(float(exposure) > 0 for _, _, exposure in times)
    vignette = cv2.imread(str(recording.path / "vignette.png"), cv2.IMREAD_UNCHANGED)
    assert (vignette.dtype, vignette.shape) == (np.uint16, (64, 96))
    assert vignette.min() >= 1
    assert vignette.max() == 65535
    np.testing.assert_allclose(vignette / 65535, recording.vignette.image(), atol=1e-3)
    camera = (recording.path / "camera.txt").read_text().split("\n")
    assert camera[0].startswith("Pinhole ")
    assert camera[1:4] == ["96 64", "none", "96 64"]
    poses = np.loadtxt(recording.path / "groundtruthSync.txt")
    assert poses.shape == (6, 8)
    np.testing.assert_allclose(poses[:, 0], [float(stamp) for _, stamp, _ in times], atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(poses[:, 4:], axis=1), 1, atol=1e-8)


@pytest.mark.parametrize("bits", [10, 16])
def test_more_than_eight_bits(tmp_path, bits):
    settings = replace(SMALL, frames=2, bit_depth=bits)
    made = simulate(tmp_path / "r", settings)
    image = cv2.imread(str(made.path / "images" / "00000.png"), cv2.IMREAD_UNCHANGED)
    assert image.dtype == np.uint16
    assert 255 < image.max() <= 2**bits - 1
    assert {frame.max_grey for frame in frames(settings)} == {2**bits - 1}


def test_jpeg_is_nearly_the_same(recording, tmp_path):
    made = simulate(tmp_path / "r", replace(SMALL, image_format="jpg"))
    pairs = zip(open_recording(made.path), open_recording(recording.path), strict=True)
    difference = [np.mean(np.abs(a.image.astype(float) - b.image)) for a, b in pairs]
    assert 0 < np.mean(difference) < 4
    for made_frame, frame in zip(frames(made.settings), open_recording(made.path), strict=True):
        np.testing.assert_array_equal(made_frame.image, frame.image)


def test_own_responses_and_vignettes(tmp_path):
    settings = replace(
        SMALL, frames=1, response=Response.gamma(1.4, 1024), vignette=log_polynomial((96, 64), (-0.3,))
    )
    made = simulate(tmp_path / "r", settings)
    written = json.loads((made.path / "truth.json").read_text())
    assert written["response"]["model"] == {"name": "gamma", "exponent": 1.4}
    assert written["settings"]["vignette"]["name"] == "log_spline"


def test_motion_blur_is_the_mean_over_the_exposure():
    blurred = replace(SMALL, frames=2, exposure="constant", exposure_ms=40.0, fps=25.0, motion_blur_samples=8)
    instants = replace(blurred, frames=25, fps=400.0, motion_blur_samples=1)
    *_, smeared = irradiances(blurred)
    sharp = list(irradiances(instants))
    np.testing.assert_allclose(smeared, np.mean(sharp[9:24:2], axis=0), rtol=1e-4)
    assert np.abs(np.log(smeared / sharp[16])).max() > 0.05


def test_progress_counts_the_frames(tmp_path):
    calls = []
    simulate(tmp_path / "r", SMALL, progress=lambda done, total: calls.append((done, total)))
    assert calls == [(i, 6) for i in range(1, 7)]


def test_nothing_is_overwritten(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(SettingError, match="not an empty folder"):
        simulate(tmp_path, SMALL)
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]
    with pytest.raises(SettingError):
        simulate(tmp_path / "mine.txt", SMALL)


def test_only_a_simulated_recording_is_replaced(tmp_path):
    few = replace(SMALL, frames=2)
    place = simulate(tmp_path / "r", few).path
    for stranger in (place / "calibration.json", place / "images" / "notes.txt"):
        stranger.write_text("mine")
        before = content_of(place)
        with pytest.raises(SettingError, match=stranger.name):
            simulate(place, few, overwrite=True)
        assert content_of(place) == before
        stranger.unlink()
    simulate(place, replace(few, frames=1, archive=True), overwrite=True)
    assert not (place / "images").exists()
    (place / "truth.json").unlink()
    with pytest.raises(SettingError, match=r"truth\.json"):
        simulate(place, few, overwrite=True)
