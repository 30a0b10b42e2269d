"""Pictures show the known parts, and mark the unknown ones."""

from __future__ import annotations

import numpy as np
import pytest

from calibrations import SIZE, calibration
from ospc.errors import FormatError
from ospc.formats.opening import Photometry
from ospc.output import OutputFolder
from ospc.photometry.coverage import ExposureRatios
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette
from ospc.report.charts import ReportFindings
from ospc.report.pictures import PICTURES, pictures_of, plot_photometries

EXPOSURES_MS = np.geomspace(1, 3, 41)


@pytest.fixture(scope="module")
def pictures():
    return pictures_of(ReportFindings(calibration(), EXPOSURES_MS))


def test_every_picture_is_drawn(pictures):
    truth = Photometry("truth", Response.gamma(2.1), PolynomialVignette(SIZE, (-0.2, 0.0, 0.0)))
    deep_with_truth = pictures_of(ReportFindings(calibration(max_grey=4095), EXPOSURES_MS, truth=truth))
    for drawn in (pictures, deep_with_truth):
        assert tuple(drawn) == PICTURES
        for image in drawn.values():
            assert image.shape[1] >= 500
            assert np.ptp(image) > 200


def test_a_picture_of_several_charts_joins_the_single_charts(pictures):
    response, whole = pictures["plot_response.png"], pictures["figure.png"]
    assert whole.shape == (response.shape[0], 3 * response.shape[1], 3)
    np.testing.assert_array_equal(whole[:, : response.shape[1]], response)


@pytest.mark.parametrize(
    ("name", "lacking"),
    [
        ("plot_response.png", calibration(response=False)),
        ("plot_vignette.png", calibration(vignette=False)),
        ("plot_exposures.png", calibration(exposure_ratios=ExposureRatios.none())),
    ],
)
def test_unknown_parts_have_no_picture_but_appear_in_the_overview(name, lacking):
    assert set(pictures_of(ReportFindings(lacking))) == {*PICTURES} - {name}


def test_the_overview_is_drawn_even_if_nothing_is_known():
    nothing = calibration(response=False, vignette=False, exposure_ratios=ExposureRatios.none(), partial=True)
    assert set(pictures_of(ReportFindings(nothing))) == {"figure.png"}


def test_pictures_depend_only_on_the_calibration(pictures):
    again = pictures_of(ReportFindings(calibration(), EXPOSURES_MS))
    for name in pictures:
        np.testing.assert_array_equal(again[name], pictures[name])


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
