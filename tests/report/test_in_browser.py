"""The report in a real browser: no requests, errors or cut-off content, in light and dark mode and printed."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import before_a_wall, calibration

from browser import CUT_OFF
from ospc.formats.files import write_text
from ospc.photometry.coverage import ExposureRatios
from ospc.report.charts import ReportFindings
from ospc.report.examples import NOTHING_TRIED, examples_of
from ospc.report.page import page

REPORTS = ("everything", "nothing")
WIDTHS_PX = (1400, 700, 400, 320)

CONTRASTS = """
(() => {
  const light = colour => {
    const parts = colour.match(/[\\d.]+/g).slice(0, 3).map(v => v / 255);
    const linear = parts.map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
  };
  const ground = e => {
    const colour = getComputedStyle(e).backgroundColor;
    return colour === 'rgba(0, 0, 0, 0)' && e.parentElement ? ground(e.parentElement) : colour;
  };
  return [...document.querySelectorAll('h1, h2, h3, p, li, td, code, figcaption, .state, svg text')].map(e => {
    const style = getComputedStyle(e);
    const both = [light(e.closest('svg') ? style.fill : style.color), light(ground(e.closest('svg') || e))];
    return (Math.max(...both) + 0.05) / (Math.min(...both) + 0.05);
  });
})()
"""


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    place = tmp_path_factory.mktemp("reports")
    recording = before_a_wall(np.geomspace(2, 10, 24))
    known = calibration(source={"name": "a_name_that_is_" + "very_" * 20 + "long"})
    nothing = calibration(
        response=None, vignette=None, vignette_sigma=None, coverage=None, exposure_ratios=ExposureRatios.none()
    )
    found = {
        "everything": (ReportFindings(known, recording.exposures_ms), examples_of(known, recording)),
        "nothing": (ReportFindings(nothing), NOTHING_TRIED),
    }
    return {
        name: write_text(place / f"{name}.html", page(findings, examples)).as_uri()
        for name, (findings, examples) in found.items()
    }


@pytest.mark.parametrize("name", REPORTS)
@pytest.mark.parametrize("width_px", WIDTHS_PX)
def test_the_page_fits_the_window_without_errors_or_requests(chromium, pages, name, width_px):
    chromium.show(pages[name], width_px)
    assert chromium.complaints() == []
    assert [url for url in chromium.requests() if not url.startswith(("file:", "data:"))] == []
    assert chromium.value("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    assert chromium.value(CUT_OFF) == []
    assert chromium.value("[...document.images].every(image => image.naturalWidth > 0)")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_texts_have_enough_contrast(chromium, pages, scheme):
    chromium.show(pages["everything"], 1400, scheme)
    ground = chromium.value("getComputedStyle(document.body).backgroundColor.match(/\\d+/)[0] > 128")
    assert ground == (scheme == "light")
    contrasts = chromium.value(CONTRASTS)
    assert len(contrasts) > 100
    assert min(contrasts) >= 4.5


@pytest.mark.parametrize("width_px", [1400, 400])
def test_chart_labels_are_readable_and_do_not_overlap(chromium, pages, width_px):
    chromium.show(pages["everything"], width_px)
    boxes = chromium.value(
        "[...document.querySelectorAll('svg.chart')].map(chart => [...chart.querySelectorAll('text')].map(t => {"
        " const b = t.getBoundingClientRect(); return [b.left, b.top, b.right, b.bottom, t.textContent]; }))"
    )
    assert len(boxes) >= 10
    for texts in boxes:
        for i, (left, top, right, bottom, text) in enumerate(texts):
            assert min(bottom - top, right - left if len(text) > 1 else bottom - top) > 8, text
            for other in texts[:i]:
                apart = other[0] >= right - 2 or other[2] <= left + 2 or other[1] >= bottom - 2 or other[3] <= top + 2
                assert apart, (text, other)


def test_it_prints_on_a_few_light_pages(chromium, pages):
    chromium.show(pages["everything"], 1400, "dark")
    printed = chromium.pdf()
    assert printed.startswith(b"%PDF")
    assert 3 <= printed.count(b"/Type /Page\n") <= 8
    chromium.do("Emulation.setEmulatedMedia", media="print")
    assert chromium.value("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    chromium.do("Emulation.setEmulatedMedia", media="")
