"""Calibrations from all file formats are compared by the same figures; an exponent is aligned only on request."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ospc.errors import FormatError, NotObservableError
from ospc.evaluation.comparison import aligning_exponent, compare
from ospc.evaluation.metrics import log_ratio_error, response_rmse, vignette_rmse
from ospc.formats.dso import write_pcalib, write_vignette
from ospc.formats.opening import Photometry, open_photometry
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette, RasterVignette

SIZE = (96, 72)
RESPONSE = Response.gamma(2.0)
VIGNETTE = PolynomialVignette(SIZE, (-0.3, -0.1, 0.0))
TRUTH = Photometry("truth", RESPONSE, VIGNETTE)


@pytest.fixture
def folder(tmp_path):
    write_pcalib(RESPONSE, tmp_path / "pcalib.txt")
    write_vignette(VIGNETTE, tmp_path / "vignette.png")
    return tmp_path


def test_figures_are_the_metrics():
    other = Photometry("other", Response.gamma(1.8), PolynomialVignette(SIZE, (-0.2, 0.0, 0.0)))
    result = compare(other, TRUTH)
    assert result.exponent == 1
    assert result.response_rmse == response_rmse(other.response, RESPONSE)
    assert result.log_ratio_error == log_ratio_error(other.response, RESPONSE)
    assert result.vignette_rmse == vignette_rmse(other.vignette, VIGNETTE)
    assert result.vignette_pixel_rmse is not None
    assert result.response_coverage is None


@settings(max_examples=20, deadline=None)
@given(st.floats(0.3, 3))
def test_common_exponent_is_found_and_removes_the_ambiguity(exponent):
    raised = Photometry(
        "raised",
        Response(RESPONSE.inverse_table ** (1 / exponent)),
        RasterVignette(VIGNETTE.image() ** np.float32(1 / exponent)),
    )
    found = aligning_exponent(raised, TRUTH)
    assert found == pytest.approx(exponent, rel=1e-3)
    aligned = compare(raised, TRUTH, found)
    assert aligned.exponent == found
    assert aligned.response_rmse < 1e-3
    assert aligned.vignette_rmse < 1e-3
    if abs(exponent - 1) > 0.1:
        assert compare(raised, TRUTH).response_rmse > 5 * aligned.response_rmse


def test_exponent_that_leads_nowhere_is_not_given():
    flat = Photometry("flat", None, PolynomialVignette(SIZE, (0.0,)))
    with pytest.raises(NotObservableError, match="steep with truth"):
        aligning_exponent(Photometry("steep", None, PolynomialVignette(SIZE, (-1e-9,))), TRUTH)
    with pytest.raises(FormatError, match="in common"):
        aligning_exponent(flat, Photometry("response", RESPONSE, None))


def test_steep_curves_survive_large_exponents():
    steep = Photometry("steep", Response(np.maximum(np.linspace(0, 1, 256) ** 60, np.arange(256) * 1e-300)), None)
    assert compare(steep, Photometry("truth", RESPONSE, None), 8.0).response_rmse > 0


def test_stated_uncertainty_is_compared():
    estimate = Response.from_values(RESPONSE.inverse_table, log_sigma=np.full(256, 0.01))
    result = compare(Photometry("a", estimate, None), Photometry("b", RESPONSE, None))
    assert result.response_coverage == (1.0, 1.0)
    assert compare(Photometry("a", estimate, None), Photometry("b", RESPONSE, None), 1.1).response_coverage is None


@pytest.mark.parametrize(("sigmas", "shares"), [(0.99, (1.0, 1.0)), (1.5, (0.0, 1.0)), (2.5, (0.0, 0.0))])
def test_stated_uncertainty_of_the_vignette_is_compared(sigmas, shares):
    vignette = PolynomialVignette(SIZE, (-0.2, -0.1, 0.0))
    sigma = np.abs(vignette.profile(PROFILE_RADII) - VIGNETTE.profile(PROFILE_RADII)) / sigmas
    estimate = Photometry("a", None, vignette, Calibration(SIZE, None, vignette, vignette_sigma=sigma))
    assert compare(estimate, TRUTH).vignette_coverage == shares
    assert compare(estimate, TRUTH, 1.1).vignette_coverage is None
    assert compare(Photometry("a", None, vignette), TRUTH).vignette_coverage is None


def test_every_kind_of_source_is_opened(folder, tmp_path):
    saved = Calibration(SIZE, RESPONSE, VIGNETTE).save(tmp_path / "calibration.json")
    pair = f"{folder / 'pcalib.txt'},{folder / 'vignette.png'}"
    for source in (saved, pair, tmp_path):
        opened = open_photometry(source)
        result = compare(opened, TRUTH)
        assert result.response_rmse < 1e-6
        assert result.vignette_pixel_rmse < 1e-4
    saved.unlink()
    opened = open_photometry(folder)
    assert (opened.response is not None, opened.vignette is not None) == (True, True)
    assert open_photometry(folder / "pcalib.txt").vignette is None
    assert open_photometry(folder / "vignette.png").response is None


def test_empty_sources_are_refused(folder, tmp_path):
    (tmp_path / "empty").mkdir()
    for source, reason in (
        (tmp_path / "empty", "has no"),
        (tmp_path / "nowhere.txt", "No such file"),
        (f"{folder / 'pcalib.txt'},{folder / 'pcalib.txt'}", "must have only a response"),
    ):
        with pytest.raises(FormatError, match=reason):
            open_photometry(source)
    with pytest.raises(FormatError, match="in common"):
        compare(open_photometry(folder / "pcalib.txt"), open_photometry(folder / "vignette.png"))


def test_vignettes_of_different_sizes_are_compared_by_profile_only():
    other = Photometry("other", None, PolynomialVignette((192, 144), (-0.3, -0.1, 0.0)))
    result = compare(other, TRUTH)
    assert result.vignette_rmse < 0.01
    assert result.vignette_pixel_rmse is None
