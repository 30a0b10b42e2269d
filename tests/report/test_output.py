"""The output folder: the files written to it and removed from it."""

from __future__ import annotations

import numpy as np
import pytest

from calibrations import SIZE, calibration
from ospc.engine.state import Epoch
from ospc.errors import FormatError, SettingError
from ospc.formats.dso import CAVEAT, read_pcalib, read_vignette
from ospc.photometry.calibration import Calibration
from ospc.photometry.vignette import RasterVignette
from ospc.recording import ArrayRecording
from ospc.recording.exposure_lists import read_times
from ospc.report.charts import ReportFindings
from ospc.report.output_folder import OWN_NAMES, REPORT, OutputFolder


@pytest.fixture
def recording():
    images = [np.full((SIZE[1], SIZE[0]), 20 * (i + 1), np.uint8) for i in range(3)]
    return ArrayRecording(images, [1.0, 2.5, 4.0], stamps_s=[10.0, 10.5, 11.0])


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_everything_known_is_written_in_formats_that_read_back(tmp_path, recording):
    known = calibration()
    written = OutputFolder.at(tmp_path / "out").write(known, recording)
    out = tmp_path / "out"
    assert names(out) == ["calibration.json", "pcalib.txt", "times.txt", "vignette.png"]
    assert sorted(written.files) == sorted(out.iterdir())
    assert (written.notes, written.problems) == ((), ())
    np.testing.assert_allclose(read_pcalib(out / "pcalib.txt").inverse_table, known.response.inverse_table, atol=1e-6)
    vignette = read_vignette(out / "vignette.png")
    assert vignette.size == known.size
    np.testing.assert_allclose(vignette.image(), known.vignette.image() / known.vignette.image().max(), atol=1e-4)
    table = read_times(out / "times.txt")
    np.testing.assert_allclose(table.exposures_ms, recording.exposures_ms)
    np.testing.assert_allclose(table.stamps_s, recording.stamps_s)
    assert Calibration.load(out).verdicts == known.verdicts


def test_without_a_recording_and_times_there_are_no_exposures_to_draw(tmp_path):
    assert OutputFolder.at(tmp_path).findings(calibration()).exposures_ms is None


@pytest.mark.parametrize("bits", [10, 12, 16])
def test_the_table_for_deep_images_fits_grey_values_that_are_left_aligned_in_16_bits(tmp_path, bits):
    known = calibration(max_grey=2**bits - 1)
    OutputFolder.at(tmp_path).write(known)
    assert read_pcalib(tmp_path / "pcalib.txt").inverse_table.size == 256
    table = read_pcalib(tmp_path / "pcalib_16bit.txt").inverse_table
    assert table.size == 2**16
    grey = np.arange(2**bits)
    converted = grey << (16 - bits)
    np.testing.assert_allclose(table[converted], known.response.inverse(grey / grey[-1]), atol=2.5 / 2**bits)


@pytest.mark.parametrize("part", ["response", "vignette"])
def test_what_is_unknown_is_not_written_and_does_not_remain_from_before(tmp_path, recording, part):
    OutputFolder.at(tmp_path).write(calibration(max_grey=4095), recording)
    OutputFolder.at(tmp_path).draw(ReportFindings(calibration()))
    lacking = calibration(**{part: False})
    folder = OutputFolder.at(tmp_path)
    folder.write(lacking, recording)
    assert folder.findings(lacking).exposures_ms == pytest.approx(recording.exposures_ms)
    folder.draw(folder.findings(lacking))
    gone = {"response": "pcalib.txt", "vignette": "vignette.png"}[part]
    absent = {gone, "pcalib_16bit.txt", "calibration.vignette.npz", CAVEAT}
    assert names(tmp_path) == sorted(set(OWN_NAMES) - absent - {REPORT})


def test_a_raster_vignette_is_stored_next_to_its_calibration_and_removed_with_it(tmp_path):
    raster = RasterVignette(np.linspace(0.5, 1, SIZE[0] * SIZE[1], dtype=np.float32).reshape(SIZE[1], SIZE[0]))
    folder = OutputFolder.at(tmp_path)
    folder.write(calibration(vignette=False, max_grey=255))
    folder.write(
        Calibration(size=SIZE, vignette=raster, verdicts=calibration().verdicts),
    )
    np.testing.assert_allclose(Calibration.load(tmp_path).vignette.image(), raster.values)
    folder.write(calibration())
    assert "calibration.vignette.npz" not in names(tmp_path)


def test_calibrations_before_a_change_of_the_camera_have_folders_of_their_own_until_the_next_run(tmp_path):
    folder, before = OutputFolder.at(tmp_path), calibration(max_grey=255)
    written = folder.write(calibration(), ended=[Epoch(0, 9, None, None), Epoch(10, 49, before, None)])
    inner = tmp_path / "frames_10-49"
    assert Calibration.load(inner) == before
    assert {inner / "pcalib.txt", inner / "vignette.png"} <= set(written.files)
    assert not (tmp_path / "frames_0-9").exists()
    (inner / "mine.txt").touch()
    elsewhere = OutputFolder(tmp_path / "elsewhere")
    elsewhere.write(calibration())
    (tmp_path / "frames_1-2").symlink_to(elsewhere.path)
    folder.write(calibration())
    assert names(inner) == ["mine.txt"]
    assert "calibration.json" in names(elsewhere.path)


def test_pictures_of_an_earlier_run_go_before_new_ones_are_drawn(tmp_path):
    (tmp_path / "calibration.json").write_text('{"schema": "ospc-calibration/1"}')
    (tmp_path / "figure.png").write_bytes(b"old")
    OutputFolder.at(tmp_path).write(calibration())
    assert not (tmp_path / "figure.png").exists()


def test_drawing_stops_when_asked(tmp_path):
    written = OutputFolder(tmp_path).draw(ReportFindings(calibration()), stop=lambda: True)
    assert written.files == ()
    assert "interrupted" in written.notes[0]


def test_exposures_dso_cannot_read_are_noted(tmp_path):
    class WithoutExposure:
        stamps_s = np.array([1.0, 2.0])
        exposures_ms = np.array([np.nan, np.nan])

    written = OutputFolder.at(tmp_path).write(calibration(), WithoutExposure())
    assert "times.txt" in written.notes[0]
    assert not (tmp_path / "times.txt").exists()


def test_single_unknown_exposures_are_interpolated_in_times_txt(tmp_path):
    class WithGaps:
        stamps_s = np.arange(4.0)
        exposures_ms = np.array([np.nan, 4.0, np.nan, 16.0])

    written = OutputFolder.at(tmp_path).write(calibration(), WithGaps())
    np.testing.assert_allclose(read_times(tmp_path / "times.txt").exposures_ms, [4.0, 4.0, 8.0, 16.0], rtol=1e-5)
    assert "without gaps" in written.notes[0]


class TestRefusals:
    def test_a_folder_with_something_else_needs_force(self, tmp_path):
        (tmp_path / "thesis.txt").write_text("mine")
        with pytest.raises(SettingError, match="force writing to it"):
            OutputFolder.at(tmp_path)
        OutputFolder.at(tmp_path, force=True).write(calibration())
        assert (tmp_path / "thesis.txt").read_text() == "mine"

    @pytest.mark.parametrize("content", ["", "{}", "[]", '{"schema": 3}', "\0", "[" * 100_000])
    def test_a_foreign_calibration_json_is_something_else(self, tmp_path, content):
        (tmp_path / "calibration.json").write_text(content)
        with pytest.raises(SettingError):
            OutputFolder.at(tmp_path)

    def test_an_earlier_output_is_replaced_but_other_files_stay(self, tmp_path):
        OutputFolder.at(tmp_path).write(calibration())
        (tmp_path / "notes.txt").write_text("mine")
        OutputFolder.at(tmp_path).write(calibration(response=False))
        assert names(tmp_path) == ["calibration.json", "notes.txt", "vignette.png"]

    def test_a_foreign_folder_with_the_name_of_that_for_partial_results_is_refused(self, tmp_path):
        OutputFolder.at(tmp_path).write(calibration())
        (tmp_path / "partial").mkdir()
        (tmp_path / "partial" / "thesis.txt").write_text("mine")
        with pytest.raises(SettingError, match="partial in it is not from an earlier calibration"):
            OutputFolder.at(tmp_path, force=True)

    @pytest.mark.parametrize("inside", [".", "images"])
    def test_a_recording_is_never_written_into(self, tmp_path, inside):
        (tmp_path / "images").mkdir()
        with pytest.raises(SettingError, match="recording"):
            OutputFolder.at(tmp_path / inside, recording=tmp_path, force=True)

    @pytest.mark.parametrize("inside", ["mav0", "mav0/cam0", "mav0/cam0/data", "dso/cam0"])
    def test_folders_with_files_inside_a_recording_are_never_written_into(self, tmp_path, inside):
        for file in ("mav0/cam0/data.csv", "mav0/cam0/data/0.png", "dso/cam0/times.txt"):
            (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / file).write_text("")
        with pytest.raises(SettingError, match="recording"):
            OutputFolder.at(tmp_path / inside, recording=tmp_path, force=True)

    def test_new_and_empty_folders_and_earlier_output_inside_a_recording_are_usable(self, tmp_path):
        (tmp_path / "empty").mkdir()
        for name in ("empty", "new", "new"):
            OutputFolder.at(tmp_path / name, recording=tmp_path).write(calibration())

    def test_a_file_is_no_folder(self, tmp_path):
        (tmp_path / "a").write_text("")
        for place in (tmp_path / "a", tmp_path / "a" / "b"):
            with pytest.raises(SettingError):
                OutputFolder.at(place)


class TestFailures:
    def test_a_report_that_cannot_be_written_is_a_problem(self, tmp_path):
        written = OutputFolder(tmp_path / "absent").report(
            ReportFindings(calibration(response=False, vignette=False))
        )
        assert "cannot be written" in written.problems[0]

    def test_without_room_for_calibration_json_the_earlier_output_stays(self, tmp_path, monkeypatch):
        OutputFolder.at(tmp_path).write(calibration())
        before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

        def fail(_path, _content):
            raise OSError(28, "No space left on device")

        monkeypatch.setattr("ospc.photometry.calibration.write_atomically", fail)
        with pytest.raises(FormatError, match="No space left"):
            OutputFolder.at(tmp_path).write(calibration(response=False))
        assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before

    def test_a_later_file_that_fails_costs_no_other(self, tmp_path, monkeypatch, recording):
        def fail(_response, path, _values):
            raise FormatError(f"{path}: cannot be written (No space left on device)")

        monkeypatch.setattr("ospc.formats.dso.write_pcalib", fail)
        written = OutputFolder.at(tmp_path).write(calibration(), recording)
        assert "pcalib.txt" in written.problems[0]
        assert names(tmp_path) == ["calibration.json", "times.txt", "vignette.png"]
