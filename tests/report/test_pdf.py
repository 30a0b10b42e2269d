"""The report for papers: one PDF, with whatever is known."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from recordings import before_a_wall, calibration, coverage

from ospc.errors import FormatError, MissingExtraError
from ospc.photometry.calibration import ExposureRatios
from ospc.report.examples import examples_of
from ospc.report.page import Findings
from ospc.report.pdf import write_pdf


def pages(place):
    content = place.read_bytes()
    assert content.startswith(b"%PDF")
    return content.count(b"/Type /Page ") + content.count(b"/Type /Page\n")


def test_it_has_a_page_for_every_part(tmp_path):
    pytest.importorskip("matplotlib")
    recording, known = before_a_wall(np.geomspace(2, 10, 8)), calibration()
    findings = Findings(known, recording.exposures_ms, examples_of(known, recording, 4))
    assert pages(write_pdf(findings, tmp_path / "report.pdf")) == 5


@pytest.mark.parametrize(
    "lacking",
    [
        calibration(
            response=None, vignette=None, vignette_sigma=None, exposure_ratios=ExposureRatios.none(), coverage=None
        ),
        calibration(vignette=None, vignette_sigma=None, coverage=coverage(residuals=False), max_grey=4095),
    ],
)
def test_what_is_unknown_is_left_out(tmp_path, lacking):
    pytest.importorskip("matplotlib")
    assert pages(write_pdf(Findings(lacking), tmp_path / "report.pdf")) >= 3


def test_without_matplotlib_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(MissingExtraError, match="plots"):
        write_pdf(Findings(calibration()), tmp_path / "report.pdf")


def test_a_folder_that_is_not_there_is_an_error(tmp_path):
    pytest.importorskip("matplotlib")
    lacking = calibration(response=None, vignette=None, vignette_sigma=None, coverage=None)
    with pytest.raises(FormatError, match="cannot be written"):
        write_pdf(Findings(lacking), tmp_path / "absent" / "report.pdf")
