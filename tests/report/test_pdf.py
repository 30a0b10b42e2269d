"""The report as a PDF with all known parts."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from recordings import before_a_wall, calibration, coverage

from ospc.errors import FormatError
from ospc.photometry.coverage import ExposureRatios
from ospc.photometry.verdict import Verdict
from ospc.report.charts import ReportFindings
from ospc.report.examples import examples_of
from ospc.report.pdf import pages, write_pdf


def count_of_pages(place):
    content = place.read_bytes()
    assert content.startswith(b"%PDF")
    return content.count(b"/Type /Page ") + content.count(b"/Type /Page\n")


def test_the_pdf_has_a_page_for_every_part(tmp_path):
    recording, known = before_a_wall(np.geomspace(2, 10, 8)), calibration()
    findings, examples = ReportFindings(known, recording.exposures_ms), examples_of(known, recording)
    assert count_of_pages(write_pdf(findings, tmp_path / "report.pdf", examples)) == 4


@pytest.mark.parametrize(
    "lacking",
    [
        calibration(
            response=None, vignette=None, vignette_sigma=None, exposure_ratios=ExposureRatios.none(), coverage=None
        ),
        calibration(vignette=None, vignette_sigma=None, coverage=coverage(residuals=False), max_grey=4095),
    ],
)
def test_unknown_parts_are_left_out_and_output_is_reproducible(tmp_path, lacking):
    first, again = (write_pdf(ReportFindings(lacking), tmp_path / name) for name in ("report.pdf", "again.pdf"))
    assert count_of_pages(first) >= 2
    assert first.read_bytes() == again.read_bytes()


def test_no_text_is_cut_off():
    lacking = Verdict("not identifiable", "W" * 300, "move " * 100)
    known = calibration(
        verdicts={"response": lacking, "vignette": Verdict("marginal", "why")},
        exponent_sigma=0.2,
        partial=True,
        source={"name": "a very long name of a recording " * 5},
        settings={"path": "/w" * 200},
    )
    for figure in pages(ReportFindings(known)):
        renderer = FigureCanvasAgg(figure).get_renderer()
        for text in figure.texts:
            box = text.get_window_extent(renderer)
            assert figure.bbox.x0 <= box.x0
            assert box.x1 <= figure.bbox.x1


def test_a_missing_folder_is_an_error(tmp_path):
    lacking = calibration(response=None, vignette=None, vignette_sigma=None, coverage=None)
    with pytest.raises(FormatError, match="cannot be written"):
        write_pdf(ReportFindings(lacking), tmp_path / "absent" / "report.pdf")
