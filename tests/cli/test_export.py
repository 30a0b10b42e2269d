from __future__ import annotations

from functools import partial

import pytest

from command_line import ospc
from log_polynomials import log_polynomial
from ospc.errors import SettingError
from ospc.formats.dso import read_vignette
from ospc.formats.validation import validate
from ospc.photometry.calibration import Calibration
from ospc.photometry.response import Response


@pytest.fixture
def calibration(tmp_path):
    return str(
        Calibration((64, 48), Response.gamma(2.0), log_polynomial((64, 48), (-0.6, -0.4))).save(tmp_path / "c.json")
    )


run = partial(ospc, "export")


def test_dso_export_is_valid_for_dso(calibration, tmp_path):
    result = run(calibration, "--to", "dso", "-o", tmp_path / "dso")
    assert result.exit_code == 0
    assert result.output.count("wrote ") == 2
    assert validate([tmp_path / "dso"], "mono", (64, 48)).findings == ()


def test_crop_and_size(calibration, tmp_path):
    result = run(calibration, "--to", "dso", "-o", tmp_path / "dso", "--crop", "8,6,48,36", "--size", "24x18")
    assert result.exit_code == 0
    assert read_vignette(tmp_path / "dso" / "vignette.png").size == (24, 18)


def test_notes_are_printed(calibration, tmp_path):
    result = run(calibration, "--to", "adobe", "-o", tmp_path / "a.lcp", "--focal-px", 50, "--lens", "4 mm")
    assert result.exit_code == 0
    assert "residual" in result.output
    assert "no response" in result.output


@pytest.mark.parametrize(
    ("program", "out", "existing"), [("dso", "mine", "mine/pcalib.txt"), ("opencv", "a.yml", "a.yml")]
)
def test_files_that_exist_are_replaced_only_by_force(calibration, tmp_path, program, out, existing):
    (tmp_path / "mine").mkdir()
    (tmp_path / existing).write_text("another camera")
    refused = run(calibration, "--to", program, "-o", tmp_path / out)
    assert "exists already" in str(refused.exception)
    assert (tmp_path / existing).read_text() == "another camera"
    assert run(calibration, "--to", program, "-o", tmp_path / out, "--force").exit_code == 0
    assert (tmp_path / existing).read_text() != "another camera"


def test_errors(calibration, tmp_path):
    missing = run(calibration, "--to", "adobe", "-o", tmp_path / "a.lcp")
    assert isinstance(missing.exception, SettingError)
    assert run(calibration, "--to", "dso", "-o", tmp_path / "x", "--crop", "everything").exit_code == 2
    assert run(calibration, "-o", tmp_path / "x").exit_code == 2
