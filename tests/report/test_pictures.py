"""Pictures show what is known, and say what is not."""

from __future__ import annotations

import numpy as np
import pytest

from calibrations import SIZE, calibration
from ospc.errors import FormatError
from ospc.formats.opening import Photometry
from ospc.formats.png import read_png
from ospc.photometry.calibration import ExposureRatios
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette
from ospc.report.charts import Findings
from ospc.report.comparison import plot_photometries
from ospc.report.pictures import PICTURES, write_picture

EXPOSURES_MS = np.geomspace(1, 3, 41)


@pytest.mark.parametrize("name", PICTURES)
@pytest.mark.parametrize("with_truth", [False, True])
@pytest.mark.parametrize("max_grey", [255, 4095])
def test_every_picture_is_drawn(tmp_path, name, with_truth, max_grey):
    truth = Photometry("truth", Response.gamma(2.1), PolynomialVignette(SIZE, (-0.2, 0.0, 0.0)))
    findings = Findings(calibration(max_grey=max_grey), EXPOSURES_MS, truth=truth if with_truth else None)
    place = write_picture(name, findings, tmp_path / name)
    image = read_png(place)
    assert image.shape[1] >= 500
    assert np.ptp(image) > 200


@pytest.mark.parametrize(
    ("name", "lacking"),
    [
        ("plot_response.png", calibration(response=False)),
        ("plot_vignette.png", calibration(vignette=False)),
        ("plot_exposures.png", calibration(exposure_ratios=ExposureRatios.none())),
    ],
)
def test_what_is_unknown_has_no_picture_of_its_own_but_the_overview_says_so(tmp_path, name, lacking):
    assert write_picture(name, Findings(lacking), tmp_path / name) is None
    assert not (tmp_path / name).exists()
    assert write_picture("figure.png", Findings(lacking), tmp_path / "figure.png").exists()


def test_the_overview_draws_even_if_nothing_is_known(tmp_path):
    nothing = calibration(response=False, vignette=False, exposure_ratios=ExposureRatios.none(), partial=True)
    assert write_picture("figure.png", Findings(nothing), tmp_path / "figure.png").exists()


def test_pictures_depend_on_the_calibration_only(tmp_path):
    first, second = (
        write_picture("figure.png", Findings(calibration()), tmp_path / name).read_bytes() for name in "ab"
    )
    assert first == second


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(FormatError, match=r"figure\.png: cannot be written"):
        write_picture("figure.png", Findings(calibration()), tmp_path / "none" / "figure.png")


def test_calibrations_are_compared_in_one_picture(tmp_path):
    known = calibration()
    several = [Photometry("_$one^", known.response, None), Photometry("two", None, known.vignette)]
    assert plot_photometries(several, tmp_path / "plot.png").read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in plot_photometries(several, tmp_path / "plot.svg").read_bytes()
    with pytest.raises(FormatError, match="cannot be written"):
        plot_photometries(several, tmp_path / "no" / "plot.png")
    with pytest.raises(FormatError, match="known kind of picture"):
        plot_photometries(several, tmp_path / "plot.docx")
