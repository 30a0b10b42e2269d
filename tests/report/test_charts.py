"""Charts show values at the right positions, and unknown parts as unknown."""

from __future__ import annotations

import re

import numpy as np
import pytest
from matplotlib.figure import Figure

from calibrations import calibration
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.coverage import ExposureRatios
from ospc.photometry.response import Response
from ospc.report.charts import ReportFindings
from ospc.report.curves import draw_response, draw_vignette, logarithmic
from ospc.report.evidence import draw_ratios, exposures_from_images
from ospc.report.style import as_svg, rules
from ospc.report.words import facts


def panels(draw, *arguments):
    """Return the axes drawn by a function, from top to bottom."""
    figure = Figure()
    draw(figure.add_gridspec(1, 1)[0], *arguments)
    return figure.axes


def labels(axes):
    return [text.get_text() for text in axes.get_legend().get_texts()]


def test_response_chart_shows_estimate_reference_bands_and_extrapolation():
    known = calibration()
    axes, error = panels(draw_response, known, Response.gamma(1.8))
    assert labels(axes) == ["estimate", "±1σ", "±2σ", "reference", "extrapolated"]
    estimate, reference = axes.lines
    np.testing.assert_allclose(estimate.get_ydata(), known.response.inverse_table)
    np.testing.assert_allclose(reference.get_xdata()[[0, -1]], [0, 255])
    assert axes.get_xlim() == error.get_xlim() == (0, 255)
    shaded = [patch.get_x() + patch.get_width() for patch in axes.patches]
    np.testing.assert_allclose(shaded, [0.03 * 255, 255])


def test_unknown_uncertainty_draws_no_band():
    (axes,) = panels(draw_response, Calibration(size=(64, 48), response=Response.gamma(2.2)))
    assert labels(axes) == ["estimate"]


def test_the_error_panel_contains_the_error_and_two_sigma():
    known, reference = calibration(), Response.gamma(1.7)
    _curve, axes = panels(draw_response, known, reference)
    response, (darkest, brightest) = known.response, known.response.support
    measured = (response.levels >= darkest) & (response.levels <= brightest)
    error = (response.inverse_table - response.matched(reference))[measured]
    low, high = axes.get_ylim()
    assert low < error.min()
    assert high > max(error.max(), 2 * response.inverse_sigma[measured].max())
    assert high < 2 * max(np.abs(error).max(), 2 * response.inverse_sigma[measured].max())
    assert axes.get_ylabel() == "error of g"
    assert panels(draw_response, known)[1].get_ylabel() == "±σ of g"


def test_the_vignette_is_drawn_from_the_centre_to_the_corner():
    known = calibration()
    radius, profile = panels(draw_vignette, known)[0].lines[0].get_data()
    np.testing.assert_allclose(radius, PROFILE_RADII)
    np.testing.assert_allclose(profile, known.vignette.profile(radius))


def test_outliers_with_few_samples_do_not_affect_the_axis_limits():
    n = 20
    metadata = np.geomspace(0.5, 2, n)
    estimated, samples = metadata.copy(), np.full(n, 200)
    estimated[3], samples[3] = 500.0, 4
    frames = np.stack([np.arange(n), np.arange(n) + 1], axis=1)
    (axes,) = panels(draw_ratios, ExposureRatios(frames, metadata, estimated, samples))
    assert axes.get_xlim()[1] < 3
    assert labels(axes)[-1].startswith("pair with fewer")


def test_the_median_ratio_in_the_chart_matches_that_in_the_text():
    """Both include pairs with few samples."""
    n = 21
    metadata = np.geomspace(0.5, 2, n)
    samples = np.where(np.arange(n) < 5, 4, 200)
    ratios = ExposureRatios(
        np.arange(2 * n).reshape(n, 2), metadata, metadata * np.exp(0.02 * np.linspace(-1, 1, n)), samples
    )
    (axes,) = panels(draw_ratios, ratios)
    title = axes.get_legend().get_title().get_text()
    assert title == f"median |Δ ln k| of all {n} pairs: {ratios.misfit:.2g}"
    fact = next(fact for fact in facts(calibration(exposure_ratios=ratios)) if "Exposure ratios" in fact)
    assert f"to {100 * ratios.misfit:.2f} % (median over {n} pairs" in fact


def test_estimated_exposures_are_not_labelled_as_metadata():
    exposures_ms = np.ones(41)
    for unknown in (False, True):
        found = ReportFindings(calibration(exponent_sigma=0.1 if unknown else 0.0), exposures_ms)
        words = []
        for name in ("exposures", "ratios"):
            chart = found.charts[name]
            (axes,) = panels(chart.draw)
            words += [chart.caption, axes.get_xlabel(), axes.get_ylabel(), *labels(axes)]
        text = " ".join(words)
        assert ("metadata" in text) is not unknown
        assert ("exposure in ms" in text) is not unknown
        assert ("estimated from the images, so agreement does not confirm" in text) is unknown


def test_exposures_from_images_follow_the_true_exposures():
    true_ms = np.geomspace(1, 4, 30)
    stated_ms = true_ms.copy()
    stated_ms[20] = 9.0  # contradicts the images
    frames = np.array([[i, i + d] for d in (1, 2, 3) for i in range(30 - d) if i != 20])
    k = stated_ms[frames[:, 0]] / stated_ms[frames[:, 1]]
    ratios = ExposureRatios(frames, k, true_ms[frames[:, 0]] / true_ms[frames[:, 1]], np.full(len(frames), 100))
    shown, shown_ms = exposures_from_images(stated_ms, ratios)
    np.testing.assert_allclose(shown_ms, true_ms[shown])
    assert 20 in shown


@pytest.mark.parametrize(("low", "high"), [(1, 1.1), (0.9, 3), (0.02, 50), (1e-3, 1e5), (3.2, 25.2)])
def test_logarithmic_axes_have_few_ticks_within_the_limits(low, high):
    axes = Figure().subplots()
    logarithmic(axes, "y", low, high)
    ticks = axes.get_yticks()
    assert 1 <= len(ticks) <= 7
    assert low <= min(ticks) <= max(ticks) <= high


def test_drawings_are_reproducible_and_contain_only_used_identifiers():
    chart = ReportFindings(calibration()).charts["response"]

    def drawn():
        with rules():
            figure = Figure()
            chart.draw_into(figure.add_gridspec(1, 1)[0])
            return as_svg(figure, 'a "title"')

    assert drawn() == drawn()
    assert 'aria-label="a &quot;title&quot;"' in drawn()
    named, used = (set(re.findall(pattern, drawn())) for pattern in (r' id="([^"]+)"', r"#([mp][0-9a-f]{10})"))
    assert named == used
