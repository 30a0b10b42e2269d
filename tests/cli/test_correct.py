"""``ospc correct``: its output is the true irradiance, can be opened again, and never replaces other files."""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import pytest
from PIL import Image

from command_line import ospc
from ospc.correction.recording import correct_recording
from ospc.errors import ExposureError, FormatError, NotObservableError, OspcError, RecordingError, SettingError
from ospc.formats.opening import open_photometry
from ospc.formats.validation import validate
from ospc.photometry.calibration import Calibration
from ospc.photometry.response import Response
from ospc.photometry.verdict import Verdict
from ospc.photometry.vignette import LogSplineVignette, PolynomialVignette
from ospc.recording import open_recording
from ospc.recording.options import ReadingOptions
from ospc.simulation import SimulationSettings, irradiances, simulate

SETTINGS = SimulationSettings(
    size=(64, 48), frames=6, noise="none", exposure="cycle", exposures_ms=(4.0, 10.0, 20.0), vignette="decentred"
)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return simulate(tmp_path_factory.mktemp("simulated") / "recording", SETTINGS)


@pytest.fixture(scope="module")
def deep(tmp_path_factory):
    return simulate(tmp_path_factory.mktemp("deep") / "recording", replace(SETTINGS, bit_depth=12))


@pytest.fixture(scope="module")
def calibration(made, tmp_path_factory):
    known = Calibration(SETTINGS.size, made.response, made.vignette)
    return known.save(tmp_path_factory.mktemp("calibration") / "calibration.json")


run = partial(ospc, "correct")


def written(folder):
    return [cv2.imread(str(p), cv2.IMREAD_UNCHANGED) for p in sorted((folder / "images").iterdir())]


def content_of(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def true_irradiances(made):
    """Yield for each image e·L without vignette, the step of one grey level in it, and the unsaturated pixels."""
    attenuation = made.vignette.image().astype(float)
    for irradiance in irradiances(made.settings):
        grey = np.rint(made.response(irradiance) * made.settings.max_grey)
        half = 0.51 / made.settings.max_grey
        edges = [made.response.inverse(grey / made.settings.max_grey + side) for side in (-half, half)]
        yield irradiance / attenuation, (edges[1] - edges[0]) / attenuation, irradiance < 0.99


def test_float_output_is_the_true_irradiance(made, calibration, tmp_path):
    result = run(made.path, calibration, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    images = written(tmp_path / "out")
    assert len(images) == 6
    for image, (true, step, exposed) in zip(images, true_irradiances(made), strict=True):
        assert image.dtype == np.float32
        assert np.isfinite(image).all()
        assert np.all((np.abs(image - true) <= step + 1e-5)[exposed])
    assert not (tmp_path / "out" / "pcalib.txt").exists()
    for expected in ("6 images", "irradiance e·L = g(M)/V", "saturated"):
        assert expected in result.output


def test_normalised_irradiance_is_radiance_with_saturated_pixels_masked(made, calibration, tmp_path):
    result = run(made.path, calibration, "-o", tmp_path / "out", "--normalise-exposure", "--mask-saturated")
    assert "radiance L per ms" in result.output
    original = [frame.image for frame in open_recording(made.path)]
    truths = zip(true_irradiances(made), made.exposures_ms, original, written(tmp_path / "out"), strict=True)
    for (true, step, _), exposure_ms, recorded, image in truths:
        np.testing.assert_array_equal(np.isnan(image), recorded == 255)
        seen = np.isfinite(image)
        assert np.all((np.abs(image - true / exposure_ms) <= (step + 1e-5) / exposure_ms)[seen])
    times = np.loadtxt(tmp_path / "out" / "times.txt")
    np.testing.assert_array_equal(times[:, 2], 1.0)
    np.testing.assert_allclose(times[:, 1], made.stamps_s, atol=1e-9)
    note = json.loads((tmp_path / "out" / "correction.json").read_text())
    np.testing.assert_allclose(note["original_exposures_ms"], made.exposures_ms, rtol=1e-8)
    assert note["finished"] is True


@pytest.mark.parametrize(("output", "limit"), [("grey8", 255), ("grey16", 65535)])
@pytest.mark.parametrize("depth", ["made", "deep"])
def test_grey_output_is_a_linear_recording_without_vignette(output, limit, depth, request, tmp_path):
    recording = request.getfixturevalue(depth)
    out = tmp_path / "out"
    assert run(recording.path, recording.path, "-o", out, "--output", output).exit_code == 0
    opened = open_recording(out)
    assert (opened.kind, opened.size, len(opened), opened.max_grey) == ("tum_mono", (64, 48), 6, limit)
    np.testing.assert_allclose(opened.exposures_ms, recording.exposures_ms, rtol=1e-8)
    for frame, (true, step, exposed) in zip(opened, true_irradiances(recording), strict=True):
        expected = np.clip(true, 0, 1)
        assert np.all((np.abs(frame.image / limit - expected) <= step + 1e-5 + 0.51 / limit)[exposed])
    files = [out / name for name in ("pcalib.txt", "vignette.png", "times.txt")]
    assert validate(files, "dso", (64, 48)).valid
    assert validate(files, "mono", (64, 48)).valid
    again = tmp_path / "again"
    assert run(out, out, "-o", again, "--output", output).exit_code == 0
    for first, second in zip(written(out), written(again), strict=True):
        np.testing.assert_array_equal(first, second)
    assert (out / "camera.txt").read_bytes() == (recording.path / "camera.txt").read_bytes()


def test_a_camera_for_the_images_before_a_mosaic_was_read_is_left_out(made, tmp_path):
    half = tmp_path / "half.json"
    Calibration((32, 24), made.response, PolynomialVignette((32, 24), (-0.3, 0.0, 0.0))).save(half)
    out = tmp_path / "out"
    assert (
        run(made.path, half, "-o", out, "--output", "grey8", "--bayer", "rggb", "--channel", "green").exit_code == 0
    )
    assert cv2.imread(str(out / "images" / "00000.png"), cv2.IMREAD_UNCHANGED).shape[:2] == (24, 32)
    assert not (out / "camera.txt").exists()
    assert "camera.txt" not in json.loads((out / "correction.json").read_text())["copied"]


def test_normalised_grey_images_have_one_exposure(made, calibration, tmp_path):
    def exposures(name, *options):
        out = tmp_path / name
        assert run(made.path, calibration, "-o", out, "--normalise-exposure", *options).exit_code == 0
        return out, set(open_recording(out).exposures_ms)

    shortest, found = exposures("a", "--output", "grey16")
    assert found == {4.0}
    for image, (true, step, exposed), e in zip(
        written(shortest), true_irradiances(made), made.exposures_ms, strict=True
    ):
        wanted = true * 4.0 / e
        assert np.all((np.abs(image / 65535 - wanted) <= step + 2e-5)[exposed & (wanted < 1)])
    assert exposures("b", "--output", "grey8")[1] == {10.0}
    assert exposures("c", "--output", "grey8", "--reference-ms", 5)[1] == {5.0}


def test_white_makes_room_for_bright_corners(made, calibration, tmp_path):
    clipped = {}
    for white in ("1", "4"):
        out = tmp_path / white
        assert run(made.path, calibration, "-o", out, "--output", "grey16", "--white", white).exit_code == 0
        clipped[white] = json.loads((out / "correction.json").read_text())["clipped_share"]
    assert clipped["1"] > 0
    assert clipped["4"] == 0
    ratio = written(tmp_path / "1")[0] / np.maximum(written(tmp_path / "4")[0].astype(float), 1)
    assert np.median(ratio) == pytest.approx(4, rel=0.01)


def test_frames_with_unknown_exposures_are_corrected_too(made, calibration, tmp_path):
    recording = tmp_path / "recording"
    shutil.copytree(made.path, recording)
    lines = (recording / "times.txt").read_text().splitlines()
    gaps = [f"{' '.join(line.split()[:2])} nan" if i % 2 else line for i, line in enumerate(lines)]
    (recording / "times.txt").write_text("\n".join(gaps))
    for place, name in ((made.path, "with all"), (recording, "with gaps")):
        result = run(place, calibration, "-o", tmp_path / name, "--output", "grey16")
        assert result.exit_code == 0, result.output
    for one, other in zip(written(tmp_path / "with all"), written(tmp_path / "with gaps"), strict=True):
        np.testing.assert_array_equal(one, other)
    assert None in json.loads((tmp_path / "with gaps" / "correction.json").read_text())["original_exposures_ms"]
    result = run(recording, calibration, "-o", tmp_path / "normalised", "--normalise-exposure")
    assert len(written(tmp_path / "normalised")) == SETTINGS.frames / 2, result.output


def test_masked_grey_is_white_in_saturated_pixels(made, calibration, tmp_path):
    options = ["--output", "grey16", "--normalise-exposure", "--mask-saturated"]
    assert run(made.path, calibration, "-o", tmp_path / "out", *options).exit_code == 0
    saturated = 0
    for frame, image in zip(open_recording(made.path), written(tmp_path / "out"), strict=True):
        assert np.all(image[frame.image == 255] == 65535)
        saturated += np.count_nonzero(frame.image == 255)
    assert saturated > 0


def test_any_kind_of_calibration_works(made, calibration, tmp_path):
    for number, source in enumerate(
        [calibration, made.path, f"{made.path / 'pcalib.txt'},{made.path / 'vignette.png'}"]
    ):
        assert run(made.path, source, "-o", tmp_path / str(number)).exit_code == 0
    first, *others = (written(tmp_path / str(number)) for number in range(3))
    for images in others:
        for a, b in zip(first, images, strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-2)  # the true vignette's maximum is between two pixels


# --- incomplete or mismatched input ------------------------------------------------------------------------------


def test_frames_that_cannot_be_read_are_left_out_and_counted(made, calibration, tmp_path):
    broken = tmp_path / "broken"
    (broken / "images").mkdir(parents=True)
    for name, data in content_of(made.path).items():
        (broken / name).write_bytes(data)
    (broken / "images" / "00002.png").write_bytes(b"no image")
    result = run(broken, calibration, "-o", tmp_path / "out", "--output", "grey8")
    assert result.exit_code == 0
    assert "1 frame skipped" in result.output
    opened = open_recording(tmp_path / "out")
    assert [frame.name for frame in opened] == [f"{i:05d}.png" for i in (0, 1, 3, 4, 5)]
    np.testing.assert_allclose(opened.exposures_ms, made.exposures_ms[[0, 1, 3, 4, 5]], rtol=1e-8)


def test_an_unknown_part_is_refused_with_its_reason_unless_assumed(made, tmp_path):
    verdicts = {"vignette": Verdict("not identifiable", "hardly any radial motion")}
    partial = Calibration(SETTINGS.size, made.response, None, verdicts).save(tmp_path / "c.json")
    refused = run(made.path, partial, "-o", tmp_path / "out")
    assert isinstance(refused.exception, NotObservableError)
    assert "no vignette: hardly any radial motion" in str(refused.exception)
    assert not (tmp_path / "out").exists()
    result = run(made.path, partial, "-o", tmp_path / "out", "--assume-missing")
    assert result.exit_code == 0
    assert "warning: the vignette is unknown" in result.output
    assert json.loads((tmp_path / "out" / "correction.json").read_text())["assumed_identity"] == ["vignette"]


def test_another_size_is_refused_before_anything_is_written(made, calibration, tmp_path):
    other = simulate(tmp_path / "other", replace(SETTINGS, size=(32, 24), frames=1))
    refused = run(other.path, calibration, "-o", tmp_path / "out")
    assert isinstance(refused.exception, SettingError)
    for word in ("32×24", "64×48", "ospc export", "--size 32x24"):
        assert word in str(refused.exception)
    assert not (tmp_path / "out").exists()


def test_another_bit_depth_is_reported(deep, calibration, tmp_path):
    result = run(deep.path, calibration, "-o", tmp_path / "out", "--output", "grey16")
    assert result.exit_code == 0
    assert "up to 255; its response is stretched to the grey values of the recording, up to 4095" in result.output


def test_dark_images_of_a_deep_sensor_are_corrected_like_bright_ones(tmp_path):
    """They do not show how many bits the sensor has; the calibration knows it."""
    settings = replace(SETTINGS, bit_depth=12, exposures_ms=(0.1, 0.2))
    dark = simulate(tmp_path / "dark", settings)
    assert open_recording(dark.path).max_grey == 1023
    known = Calibration(settings.size, dark.response, dark.vignette, max_grey=4095)
    known.save(tmp_path / "calibration.json")
    result = run(dark.path, tmp_path / "calibration.json", "-o", tmp_path / "out")
    assert "that of the calibration, 4095" in result.output
    for image, frame in zip(written(tmp_path / "out"), open_recording(dark.path), strict=True):
        np.testing.assert_allclose(image, known.correct(frame.image), rtol=1e-6)


@pytest.fixture(scope="module")
def twelve_bit(deep, tmp_path_factory):
    known = Calibration(SETTINGS.size, deep.response, deep.vignette, max_grey=4095)
    return known.save(tmp_path_factory.mktemp("twelve") / "calibration.json")


@pytest.mark.parametrize("top", [125, 600, 2000, 4095])
@pytest.mark.parametrize("shift", [0, 4])
def test_images_of_a_deep_sensor_are_corrected_right_however_dark_and_aligned(twelve_bit, tmp_path, top, shift):
    image = (np.arange(48 * 64) % (top + 1)).reshape(48, 64).astype(np.uint16)
    image[:2] = top
    cv2.imwrite(str(tmp_path / "a.png"), image << shift)
    result = run(tmp_path / "a.png", twelve_bit, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "stretched" not in result.output
    assert ("left-aligned, shifted right by 4" in result.output) == bool(shift)
    expected = Calibration.load(twelve_bit).correct(image, mark_saturated=False)
    np.testing.assert_allclose(written(tmp_path / "out")[0], expected, rtol=1e-6)


def test_a_sixteen_bit_calibration_takes_images_as_they_are(deep, tmp_path):
    """Its images were left-aligned, so nothing may be shifted out."""
    known = Calibration(SETTINGS.size, deep.response, deep.vignette, max_grey=65520)
    known.save(tmp_path / "calibration.json")
    image = (np.arange(48 * 64) % 4095).reshape(48, 64).astype(np.uint16) << 4
    cv2.imwrite(str(tmp_path / "a.png"), image)
    assert run(tmp_path / "a.png", tmp_path / "calibration.json", "-o", tmp_path / "out").exit_code == 0
    np.testing.assert_allclose(written(tmp_path / "out")[0], known.correct(image), rtol=1e-6)


# --- existing output ---------------------------------------------------------------------------------------------


def test_only_an_earlier_output_is_replaced_and_only_with_force(made, calibration, tmp_path):
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "diary.txt").write_text("mine")
    recorded = content_of(made.path)
    for out, options in [
        (mine, []),
        (mine, ["--force"]),
        (made.path, ["--force"]),
        (made.path / "images", ["--force"]),
    ]:
        assert isinstance(run(made.path, calibration, "-o", out, *options).exception, SettingError)
    assert isinstance(run(made.path, calibration, "-o", mine / "diary.txt").exception, SettingError)
    assert content_of(mine) == {"diary.txt": b"mine"}
    assert content_of(made.path) == recorded
    out = tmp_path / "out"
    assert run(made.path, calibration, "-o", out, "--output", "grey8").exit_code == 0
    (out / "diary.txt").write_text("mine")
    before = content_of(out)
    assert isinstance(run(made.path, calibration, "-o", out).exception, SettingError)
    assert content_of(out) == before
    assert run(made.path, calibration, "-o", out, "--force").exit_code == 0
    assert {p.name for p in out.iterdir()} == {
        "images",
        "times.txt",
        "camera.txt",
        "groundtruthSync.txt",
        "correction.json",
        "diary.txt",
    }
    assert {p.suffix for p in (out / "images").iterdir()} == {".tiff"}


def interrupt(monkeypatch):
    """Interrupt corrections after two images."""

    def interrupted(source, photometry, folder, settings, _progress):
        def stop(done, _total):
            if done == 2:
                raise KeyboardInterrupt

        return correct_recording(source, photometry, folder, settings, stop)

    monkeypatch.setattr("ospc.correction.recording.correct_recording", interrupted)


def test_earlier_output_inside_the_recording_is_replaced_with_force(made, calibration, tmp_path):
    inside = shutil.copytree(made.path, tmp_path / "recording") / "corrected"
    assert run(inside.parent, calibration, "-o", inside).exit_code == 0
    assert isinstance(run(inside.parent, calibration, "-o", inside).exception, SettingError)
    assert run(inside.parent, calibration, "-o", inside, "--force").exit_code == 0


def test_an_interrupted_run_leaves_no_recording_and_is_completed_by_the_same_command(
    made, calibration, tmp_path, monkeypatch
):
    interrupt(monkeypatch)
    result = run(made.path, calibration, "-o", tmp_path / "out", "--output", "grey8")
    assert result.exit_code == 130
    assert "unfinished; the same command completes it" in result.output
    assert json.loads((tmp_path / "out" / "correction.json").read_text())["finished"] is False
    with pytest.raises(RecordingError):
        open_recording(tmp_path / "out")
    monkeypatch.undo()
    first = tmp_path / "out" / "images" / "00000.png"
    written_at = first.stat().st_ctime_ns
    with (tmp_path / "out" / "written.txt").open("a") as torn:
        torn.write("\n2 30")
    resumed = run(made.path, calibration, "-o", tmp_path / "out", "--output", "grey8")
    assert resumed.exit_code == 0
    assert "2 images from an interrupted run kept" in resumed.output
    assert first.stat().st_ctime_ns == written_at
    assert run(made.path, calibration, "-o", tmp_path / "whole", "--output", "grey8").exit_code == 0
    assert content_of(tmp_path / "out") == content_of(tmp_path / "whole")


def test_an_interrupted_run_is_not_continued_with_other_settings_or_calibration(
    made, calibration, tmp_path, monkeypatch
):
    out = tmp_path / "out"
    interrupt(monkeypatch)
    run(made.path, calibration, "-o", out, "--output", "grey8")
    run(made.path, calibration, "-o", out, "--output", "grey16")
    monkeypatch.undo()
    mine = tmp_path / "mine.json"
    Calibration(SETTINGS.size, Response.gamma(2.0), made.vignette).save(mine)
    assert "interrupted run" not in run(made.path, mine, "-o", out).output
    assert {p.suffix for p in (out / "images").iterdir()} == {".tiff"}
    interrupt(monkeypatch)
    run(made.path, mine, "-o", tmp_path / "b")
    monkeypatch.undo()
    Calibration(SETTINGS.size, Response.gamma(1.5), made.vignette).save(mine)
    assert "interrupted run" not in run(made.path, mine, "-o", tmp_path / "b").output


# --- other sources of images -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def photographs(made, tmp_path_factory):
    """A folder of colour JPEGs with EXIF and given modification times, but without exposures."""
    folder = tmp_path_factory.mktemp("photographs")
    exif = Image.Exif()
    exif[0x010F] = "Acme"
    for number, frame in enumerate(open_recording(made.path)):
        grey = frame.image
        colour = np.dstack([grey, (grey * 0.8).astype(np.uint8), (grey * 0.6).astype(np.uint8)])
        place = folder / f"IMG_{number + 8}.JPG"
        Image.fromarray(colour).save(place, quality=97, exif=exif, icc_profile=b"profile")
        os.utime(place, (1.5e9, 1.5e9 + number))
    return folder


def test_a_folder_of_photographs_keeps_names_exif_and_times(made, photographs, calibration, tmp_path):
    out = tmp_path / "out"
    result = run(photographs, calibration, "-o", out, "--keep-response")
    assert result.exit_code == 0, result.output
    assert "exposure" not in result.output
    assert not (out / "times.txt").exists()
    assert sorted(p.name for p in (out / "images").iterdir()) == sorted(p.name for p in photographs.iterdir())
    attenuation = made.vignette.image()
    clear = attenuation > 0.999
    for before in photographs.iterdir():
        after = out / "images" / before.name
        assert after.stat().st_mtime_ns == before.stat().st_mtime_ns
        with Image.open(before) as old, Image.open(after) as new:
            assert (new.format, new.mode, new.getexif()[0x010F]) == ("JPEG", "RGB", "Acme")
            assert new.info["icc_profile"] == b"profile"
            grown = np.asarray(new, float) - np.asarray(old, float)
        assert abs(grown[clear].mean()) < 1
        assert grown[attenuation < 0.8].mean() > 3
    assert "colour" in json.loads((out / "correction.json").read_text())["notes"][-1]


@pytest.mark.parametrize(("output", "suffix"), [("grey8", ".png"), ("grey16", ".png"), ("irradiance", ".tiff")])
def test_linear_output_of_photographs_is_in_colour(made, photographs, calibration, tmp_path, output, suffix):
    assert run(photographs, calibration, "-o", tmp_path / "out", "--output", output).exit_code == 0
    for before in photographs.iterdir():
        after = tmp_path / "out" / "images" / f"{before.stem}{suffix}"
        image = cv2.imread(str(after), cv2.IMREAD_UNCHANGED)
        assert image.shape == (48, 64, 3)
        assert after.stat().st_mtime_ns == before.stat().st_mtime_ns
        if suffix == ".png":
            with Image.open(after) as opened:
                assert opened.getexif()[0x010F] == "Acme"


def test_a_single_channel_gives_grey_images(photographs, calibration, tmp_path):
    assert run(photographs, calibration, "-o", tmp_path / "out", "--channel", "green").exit_code == 0
    assert {image.shape for image in written(tmp_path / "out")} == {(48, 64)}


def test_single_images_patterns_and_lists_of_files(photographs, calibration, tmp_path):
    def names(name, *sources):
        result = run(*sources, calibration, "-o", tmp_path / name, "--output", "grey8")
        assert result.exit_code == 0, result.output
        return sorted(p.name for p in (tmp_path / name / "images").iterdir())

    assert names("one", photographs / "IMG_9.JPG") == ["IMG_9.png"]
    assert names("two", photographs / "IMG_9.JPG", photographs / "IMG_8.JPG") == ["IMG_8.png", "IMG_9.png"]
    assert names("pattern", photographs / "IMG_1*.JPG") == [f"IMG_{i}.png" for i in (10, 11, 12, 13)]
    other = tmp_path / "other"
    shutil.copytree(photographs, other / "a")
    shutil.copytree(photographs, other / "b")
    result = run(other / "*" / "IMG_9.JPG", calibration, "-o", tmp_path / "nested")
    assert result.exit_code == 0
    assert sorted(str(p.relative_to(tmp_path)) for p in (tmp_path / "nested").rglob("*.tiff")) == [
        "nested/images/a/IMG_9.tiff",
        "nested/images/b/IMG_9.tiff",
    ]


def test_a_photograph_and_its_copy_in_another_format_stay_two(photographs, calibration, tmp_path):
    folder = tmp_path / "folder"
    folder.mkdir()
    cv2.imwrite(str(folder / "a.png"), cv2.imread(str(photographs / "IMG_9.JPG")))
    shutil.copy(photographs / "IMG_9.JPG", folder / "a.jpg")
    assert run(folder, calibration, "-o", tmp_path / "out", "--output", "grey8").exit_code == 0
    assert sorted(p.name for p in (tmp_path / "out" / "images").iterdir()) == ["a.jpg.png", "a.png"]


def test_a_video_without_exposures_keeps_its_time_stamps(made, calibration, tmp_path):
    writer = cv2.VideoWriter(str(tmp_path / "phone.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, SETTINGS.size)
    for frame in open_recording(made.path):
        writer.write(cv2.cvtColor(frame.image, cv2.COLOR_GRAY2BGR))
    writer.release()
    result = run(tmp_path / "phone.avi", calibration, "-o", tmp_path / "out", "--keep-response")
    assert result.exit_code == 0, result.output
    opened = open_recording(tmp_path / "out", options=ReadingOptions(unknown_exposures=True))
    np.testing.assert_allclose(opened.stamps_s, np.arange(6) / 25)
    assert (tmp_path / "out" / "times.txt").read_text().splitlines()[1] == "1 0.040000000"


def test_exposures_are_required_only_if_needed(photographs, calibration, tmp_path):
    refused = run(photographs, calibration, "-o", tmp_path / "out", "--normalise-exposure")
    assert isinstance(refused.exception, ExposureError)
    assert "--normalise-exposure" in str(refused.exception)
    assert not (tmp_path / "out").exists()


def test_a_list_that_does_not_match_the_images_names_the_way_without_it(made, calibration, tmp_path):
    shutil.copytree(made.path, tmp_path / "r")
    with (tmp_path / "r" / "times.txt").open("a") as file:
        file.write("99 99 1\n")
    images = tmp_path / "r" / "images"
    refused = run(tmp_path / "r", calibration, "-o", tmp_path / "out")
    assert str(refused.exception).endswith(f"to correct the images without exposures, give {images}")
    assert run(images, calibration, "-o", tmp_path / "out").exit_code == 0


def test_a_lost_alpha_channel_is_reported(made, calibration, tmp_path):
    (tmp_path / "photos").mkdir()
    image = np.full((*SETTINGS.size[::-1], 4), 90, np.uint8)
    cv2.imwrite(str(tmp_path / "photos" / "a.png"), image)
    result = run(tmp_path / "photos" / "a.png", calibration, "-o", tmp_path / "out", "--keep-response")
    assert "note: images have an alpha channel, which is not written" in result.stderr


def test_where_the_vignette_is_unknown_is_stated(made, tmp_path):
    vignette = LogSplineVignette(SETTINGS.size, (-0.3, -0.3), limit=0.66)
    masked = Calibration(SETTINGS.size, made.response, vignette).save(tmp_path / "calibration.json")
    said = run(made.path, masked, "-o", tmp_path / "out").stderr.replace("\n", " ")
    assert "beyond 0.66 half diagonals from its centre, the vignette is unknown and taken as constant" in said


def test_sources_without_images_are_an_error(made, calibration, tmp_path):
    (tmp_path / "notes.txt").write_text("no image")
    for sources in (
        [made.path / "*.nothing"],
        [made.path, made.path],
        [tmp_path / "notes.txt", tmp_path / "notes.txt"],
        [made.path / "images" / "00000.png", tmp_path / "none.png"],
    ):
        assert isinstance(run(*sources, calibration, "-o", tmp_path / "out").exception, RecordingError)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("depth", ["made", "deep"])
def test_keep_response_removes_only_the_vignette(depth, request, tmp_path):
    recording = request.getfixturevalue(depth)
    out = tmp_path / "out"
    assert run(recording.path, recording.path, "-o", out, "--keep-response").exit_code == 0
    limit = 255 if recording.settings.max_grey == 255 else 65535
    assert f"scaled to at most {limit}" in json.loads((out / "correction.json").read_text())["formula"]
    tolerance = 0.52 * limit / recording.settings.max_grey  # half a grey level of the camera
    attenuation = recording.vignette.image() / recording.vignette.image().max()
    for frame, image in zip(open_recording(recording.path), written(out), strict=True):
        light = recording.response.inverse(frame.image / recording.settings.max_grey) / attenuation
        expected = recording.response(np.minimum(light, 1)) * limit
        assert np.abs(image - expected).max() <= tolerance
    again = open_recording(out)
    assert again.max_grey == limit
    np.testing.assert_allclose(again.exposures_ms, recording.exposures_ms, rtol=1e-8)
    now = open_photometry(out)
    np.testing.assert_allclose(now.response.inverse_table, recording.response.resampled(256), atol=1e-4)
    np.testing.assert_array_equal(now.vignette.image(), 1)


# --- wrong usage -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "error"),
    [
        (["--reference-ms", "5"], SettingError),
        (["--normalise-exposure", "--reference-ms", "-5"], ExposureError),
        (["--white", "0"], SettingError),
        (["--keep-response", "--output", "irradiance"], SettingError),
        (["--white", "nan"], SettingError),
        (["--white", "2"], SettingError),  # only integers have a white
    ],
)
def test_impossible_options_are_one_error_and_write_nothing(made, calibration, tmp_path, options, error):
    result = run(made.path, calibration, "-o", tmp_path / "out", *options)
    assert isinstance(result.exception, error)
    assert not (tmp_path / "out").exists()


def test_missing_and_damaged_input_is_one_error(made, calibration, tmp_path):
    assert isinstance(run(tmp_path / "no", calibration, "-o", tmp_path / "out").exception, RecordingError)
    assert isinstance(run(made.path, tmp_path / "no.json", "-o", tmp_path / "out").exception, FormatError)
    (tmp_path / "bad.json").write_text("{")
    assert isinstance(run(made.path, tmp_path / "bad.json", "-o", tmp_path / "out").exception, OspcError)
    assert run(made.path, calibration).exit_code == 2
    assert run(made.path, calibration, "-o", tmp_path / "out", "--output", "exr").exit_code == 2
    assert run(made.path, calibration, "-o", tmp_path / "out", "--kind", "polaroid").exit_code == 2
    assert not (tmp_path / "out").exists()


def test_quiet_prints_nothing(made, calibration, tmp_path):
    assert run(made.path, calibration, "-o", tmp_path / "out", "-q").output == ""


def test_the_written_pair_opens_as_a_calibration(made, calibration, tmp_path):
    run(made.path, calibration, "-o", tmp_path / "out", "--output", "grey16")
    now = open_photometry(tmp_path / "out")
    np.testing.assert_allclose(now.response.inverse_table, np.linspace(0, 1, 256), atol=1e-7)
    np.testing.assert_array_equal(now.vignette.image(), 1)


@pytest.mark.parametrize("source", ["images", "images/*.png"])
def test_corrected_images_are_never_replaced_by_images_made_from_them(source, made, calibration, tmp_path):
    place = tmp_path / "linear"
    assert run(made.path, calibration, "-o", place, "--output", "grey8").exit_code == 0
    before = content_of(place)
    refused = run(str(place / source), calibration, "-o", place, "--output", "grey8", "--force")
    assert "contains the recording itself" in str(refused.exception)
    assert content_of(place) == before


def test_outputs_inside_a_recording_are_no_part_of_it(made, calibration, tmp_path):
    place = tmp_path / "recording"
    shutil.copytree(made.path / "images", place / "left")
    shutil.copy(made.path / "times.txt", place / "exposures.txt")
    settings = ("--set", "min_points=20", "--quiet")
    for _ in range(2):  # an earlier output does not change what the recording is
        assert ospc("calibrate", place, "-o", place / "result", *settings).exit_code in (0, 3)
        assert run(place, calibration, "-o", place / "linear", "--output", "grey16", "--force").exit_code == 0
    assert len(open_recording(place)) == SETTINGS.frames
    assert open_recording(place).path == place / "left"
    assert len(open_recording(place / "linear")) == SETTINGS.frames
