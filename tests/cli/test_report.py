"""``ospc report``, and the report that ``ospc calibrate`` writes."""

from __future__ import annotations

import numpy as np
import pytest

from calibrations import SIZE, calibration
from command_line import leave_out, ospc
from ospc.errors import FormatError, OspcError
from ospc.simulation import SimulationSettings, simulate


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    place = tmp_path_factory.mktemp("simulated") / "r"
    simulate(place, SimulationSettings(size=SIZE, frames=6))
    return place


@pytest.fixture
def folder(tmp_path):
    calibration().save(tmp_path / "calibration.json")
    return tmp_path


def test_calibrate_writes_a_report_even_if_nothing_was_determined(recording, tmp_path, monkeypatch):
    leave_out(monkeypatch, "draw")
    done = ospc("calibrate", recording, "-o", tmp_path / "out")
    assert done.exit_code == 3
    assert "report.html" in done.output
    content = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "This recording does not determine the response and the vignette" in content


def test_calibrate_writes_a_pdf_on_request(recording, tmp_path, monkeypatch):
    leave_out(monkeypatch, "draw")
    ospc("calibrate", recording, "-o", tmp_path / "out", "--pdf")
    assert (tmp_path / "out" / "report.pdf").read_bytes().startswith(b"%PDF")
    ospc("calibrate", recording, "-o", tmp_path / "out")
    assert not (tmp_path / "out" / "report.pdf").exists()  # of an earlier run


def test_the_report_can_be_written_again(folder):
    done = ospc("report", folder)
    assert done.exit_code == 0
    assert done.output.splitlines() == [str(folder / "report.html")]
    assert "Before and after" not in (folder / "report.html").read_text(encoding="utf-8")


def test_pictures_come_from_the_given_recording(folder, recording):
    assert ospc("report", folder, "--recording", recording, "--truth", recording).exit_code == 0
    content = (folder / "report.html").read_text(encoding="utf-8")
    assert "Before and after" in content
    assert "data:image/jpeg" in content
    assert "The reference is" in content


def test_exposures_come_from_times_txt_in_the_folder(folder):
    lines = [f"{n} {n} {e}" for n, e in enumerate(np.geomspace(1, 3, 41))]
    (folder / "times.txt").write_text("\n".join(lines))
    ospc("report", folder)
    assert "exposure in ms" in (folder / "report.html").read_text(encoding="utf-8")


def test_the_error_names_a_folder_without_calibration(tmp_path, recording):
    with pytest.raises(OspcError, match="not a folder"):
        raise ospc("report", tmp_path / "absent").exception
    with pytest.raises(FormatError, match=r"calibration\.json"):
        raise ospc("report", recording).exception
    assert not (recording / "report.html").exists()
