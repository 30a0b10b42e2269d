"""Pictures show what is known, and say what is not."""

from __future__ import annotations

import numpy as np
import pytest

from calibrations import SIZE, calibration
from ospc.errors import FormatError, MissingExtraError
from ospc.formats.opening import Photometry
from ospc.formats.png import read_png
from ospc.photometry.calibration import ExposureRatios
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette
from ospc.report.panels import draw_exposures, draw_response, draw_response_error, draw_vignette
from ospc.report.pictures import PICTURES, write_picture

pytest.importorskip("matplotlib")

from matplotlib.figure import Figure


@pytest.fixture
def axes():
    return Figure().subplots()


def labels(axes):
    return [text.get_text() for text in axes.get_legend().get_texts()]


@pytest.mark.parametrize("name", PICTURES)
@pytest.mark.parametrize("with_truth", [False, True])
@pytest.mark.parametrize("max_grey", [255, 4095])
def test_every_picture_is_drawn(tmp_path, name, with_truth, max_grey):
    truth = Photometry("truth", Response.gamma(2.1), PolynomialVignette(SIZE, (-0.2, 0.0, 0.0)))
    place = write_picture(name, calibration(max_grey=max_grey), tmp_path / name, truth if with_truth else None)
    image = read_png(place)
    assert image.shape[1] >= 640
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
    assert write_picture(name, lacking, tmp_path / name) is None
    assert not (tmp_path / name).exists()
    assert write_picture("figure.png", lacking, tmp_path / "figure.png").exists()


def test_the_overview_draws_even_if_nothing_is_known(tmp_path):
    nothing = calibration(response=False, vignette=False, exposure_ratios=ExposureRatios.none(), partial=True)
    assert write_picture("figure.png", nothing, tmp_path / "figure.png").exists()


def test_response_shows_estimate_truth_both_bands_and_the_unmeasured_ends(axes):
    known = calibration()
    draw_response(axes, known, Response.gamma(1.8))
    assert labels(axes) == ["extrapolated", "±2σ", "±1σ", "estimate", "truth"]
    estimate, truth = axes.lines
    np.testing.assert_allclose(estimate.get_ydata(), known.response.inverse_table)
    np.testing.assert_allclose(truth.get_xdata()[[0, -1]], [0, 255])
    assert axes.get_xlim() == (0, 255)
    shaded = [patch.get_x() + patch.get_width() for patch in axes.patches]
    np.testing.assert_allclose(shaded, [0.03 * 255, 255])


def test_unknown_uncertainty_is_no_band(axes):
    draw_response(axes, calibration(response=True).__class__(size=SIZE, response=Response.gamma(2.2)))
    assert labels(axes) == ["estimate"]


def test_error_strip_contains_the_error_and_two_sigma(axes):
    known = calibration()
    truth = Response.gamma(1.7)
    draw_response_error(axes, known, truth)
    error = known.response.inverse_table - truth.inverse(known.response.levels)
    low, high = axes.get_ylim()
    assert low < error.min()
    assert high > max(error.max(), 2 * known.response.inverse_sigma.max())


def test_vignette_profile_begins_at_one(axes):
    known = calibration()
    draw_vignette(axes, known)
    radius, profile = axes.lines[0].get_data()
    assert radius[0] == 0
    assert profile[0] == pytest.approx(1, abs=2e-3)
    np.testing.assert_allclose(profile[5:-2], known.vignette.profile(radius[5:-2]), atol=0.02)


def test_an_outlier_of_few_samples_does_not_squeeze_the_others(axes):
    n = 20
    metadata = np.geomspace(0.5, 2, n)
    estimated = metadata.copy()
    estimated[3] = 500.0
    samples = np.full(n, 200)
    samples[3] = 4
    frames = np.stack([np.arange(n), np.arange(n) + 1], axis=1)
    draw_exposures(axes, calibration(exposure_ratios=ExposureRatios(frames, metadata, estimated, samples)))
    assert axes.get_xlim()[1] < 3
    assert "1 pairs with fewer than" in labels(axes)[-1]


def test_without_matplotlib_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.figure", None)
    with pytest.raises(MissingExtraError, match="plots"):
        write_picture("figure.png", calibration(), tmp_path / "figure.png")


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(FormatError, match="picture cannot be written"):
        write_picture("figure.png", calibration(), tmp_path / "none" / "figure.png")
