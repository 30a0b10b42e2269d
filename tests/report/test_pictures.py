"""Pictures show the known parts, and mark the unknown ones."""

from __future__ import annotations

import numpy as np
import pytest

from calibrations import SIZE, calibration
from ospc.errors import FormatError
from ospc.formats.opening import Photometry
from ospc.photometry.coverage import ExposureRatios
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette
from ospc.report.charts import ReportFindings
from ospc.report.output_folder import OutputFolder
from ospc.report.pictures import figure_of, picture_as_png, plot_photometries

EXPOSURES_MS = np.geomspace(1, 3, 41)


def titles(figure):
    return [axes.get_title() for axes in figure.axes if axes.get_title()]


def test_the_picture_shows_both_curves_and_the_known_ratios():
    curves, ratios = ["Inverse response g", "Vignette V"], "Exposure ratios of pairs of frames"
    truth = Photometry("truth", Response.gamma(2.1), PolynomialVignette(SIZE, (-0.2, 0.0, 0.0)))
    deep_with_truth = ReportFindings(calibration(max_grey=4095), EXPOSURES_MS, truth=truth)
    for findings in (ReportFindings(calibration(), EXPOSURES_MS), deep_with_truth):
        assert titles(figure_of(findings)) == [*curves, ratios]
    nothing = calibration(response=False, vignette=False, exposure_ratios=ExposureRatios.none(), partial=True)
    figure = figure_of(ReportFindings(nothing))
    assert titles(figure) == curves
    assert any("partial" in text.get_text() for text in figure.texts)


@pytest.mark.parametrize("text", ["a formula $\\unknown$", "half a \ud800 character"])
def test_any_name_and_any_caveat_are_drawn_as_they_are(text):
    assert picture_as_png(ReportFindings(calibration(source={"name": text})))
    assert picture_as_png(ReportFindings(calibration(rests_on=text)))


def test_a_long_title_is_wrapped_and_stays_within_the_picture():
    figure = figure_of(
        ReportFindings(calibration(source={"name": "hall " * 30}, exposure_ratios=ExposureRatios.none()))
    )
    (title,) = [text for text in figure.texts if "hall" in text.get_text()]
    assert title.get_text().count("\n") == 1
    assert title.get_window_extent().x1 < figure.bbox.x1


def test_the_picture_depends_only_on_the_calibration():
    first, again = (picture_as_png(ReportFindings(calibration(), EXPOSURES_MS)) for _ in range(2))
    assert first == again
    assert first.startswith(b"\x89PNG")


def test_the_error_names_a_file_that_cannot_be_written(tmp_path):
    written = OutputFolder(tmp_path / "none").draw(ReportFindings(calibration()))
    assert written.files == ()
    assert "figure.png: cannot be written" in written.problems[0]


def test_calibrations_are_compared_in_one_picture(tmp_path):
    known = calibration()
    several = [Photometry("_$one^", known.response, None), Photometry("two", None, known.vignette)]
    assert plot_photometries(several, tmp_path / "plot.png").read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in plot_photometries(several, tmp_path / "plot.svg").read_bytes()
    with pytest.raises(FormatError, match="cannot be written"):
        plot_photometries(several, tmp_path / "no" / "plot.png")
    with pytest.raises(FormatError, match="unknown picture format"):
        plot_photometries(several, tmp_path / "plot.docx")
