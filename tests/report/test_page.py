"""The report is one self-contained page that begins with the verdict, whichever parts are known."""

from __future__ import annotations

import pickle
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from recordings import VIGNETTE, before_a_wall, calibration, coverage

from ospc.formats.opening import Photometry
from ospc.photometry.coverage import Coverage, ExposureRatios
from ospc.photometry.response import Response
from ospc.photometry.verdict import Verdict
from ospc.report.charts import ReportFindings, chart_as_svg
from ospc.report.examples import examples_of
from ospc.report.page import page
from ospc.report.pictures import picture_as_png

EXPOSURES_MS = np.geomspace(2, 10, 24)
VOID = {"meta", "img", "br"}


class Outline(HTMLParser):
    """Checks that all tags are closed in order and collects headings, links and text."""

    def __init__(self, text):
        super().__init__()
        self.open, self.headings, self.sources, self.text = [], [], [], ""
        self.tags, self.attributes = set(), set()
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.attributes |= {name for name, _value in attrs}
        self.sources += [value for name, value in attrs if name in ("src", "href", "xlink:href")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.sources += [value for name, value in attrs if name in ("src", "href", "xlink:href")]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] == "h2":
            self.headings.append(data)
        if "style" not in self.open:
            self.text += data


def whole_report(**changes):
    known, recording = calibration(**changes), before_a_wall(EXPOSURES_MS)
    return page(ReportFindings(known, recording.exposures_ms), examples_of(known, recording))


@pytest.fixture(scope="module")
def report():
    return whole_report()


def test_the_page_needs_no_other_resources(report):
    outline = Outline(report)
    assert all(source.startswith(("data:image/", "#")) for source in outline.sources)
    assert "<script" not in report
    assert set(re.findall(r"url\((.)", report)) == {"#"}  # for clip paths
    assert "http" not in report.replace("http-equiv", "")


def test_the_summary_comes_first(report):
    assert Outline(report).headings == [
        "Summary",
        "Response and vignette",
        "Exposures",
        "Before and after",
        "Effect on tracking",
        "Coverage",
        "Residuals",
        "How to improve it",
        "Settings and versions",
    ]
    assert "The response and the vignette of this camera are well determined." in report


@pytest.fixture
def undrawn(monkeypatch):
    """Leave out the charts, which take most of the time and contain no text to test."""
    monkeypatch.setattr("ospc.report.charts.chart_as_svg", lambda _chart: "")


def test_the_page_is_small(report):
    assert len(report) < 600_000


@pytest.mark.usefixtures("undrawn")
def test_the_page_contains_all_settings_and_versions():
    known = calibration(settings={"alpha": 0.125, "beta": [1, 2]}, versions={"numpy": "9.9"})
    text = Outline(page(ReportFindings(known))).text
    for part in ("alpha", "0.125", "beta", "1, 2", "numpy", "9.9"):
        assert part in text


HOSTILE = "<script>alert(1)</script>\"' onload='x' & $x^{\ud800}$ 名前\n\0"


def hostile_findings():
    """Return findings and examples with hostile content in every untrusted text."""
    verdict = Verdict(HOSTILE, HOSTILE, HOSTILE)
    recording = before_a_wall(EXPOSURES_MS)
    known = calibration(
        verdicts={"response": verdict, HOSTILE: verdict},
        source={"name": HOSTILE, HOSTILE: [HOSTILE]},
        settings={HOSTILE: HOSTILE},
        versions={HOSTILE: HOSTILE},
        counts={"frames": HOSTILE, "skipped": HOSTILE},
        advice=(HOSTILE,),
        response=None,
    )
    examples = replace(examples_of(known, recording), notes=(HOSTILE,))
    return ReportFindings(known, EXPOSURES_MS, Photometry(HOSTILE, None, VIGNETTE)), examples


def test_untrusted_texts_are_escaped():
    content = page(*hostile_findings())
    content.encode("utf-8")
    outline = Outline(content)
    assert "script" not in outline.tags
    assert not [name for name in outline.attributes if name.startswith("on")]
    assert outline.text.count("<script>alert(1)</script>") >= 15


def test_untrusted_texts_do_not_break_the_picture():
    findings, _ = hostile_findings()
    assert picture_as_png(findings).startswith(b"\x89PNG")


EMPTY = Coverage(np.array([10.0, 10.01]), np.zeros((1, 32), np.int64), np.zeros((20, 20), np.int64), None, None, None)
CASES = {
    "nothing known": calibration(
        response=None, vignette=None, vignette_sigma=None, exposure_ratios=ExposureRatios.none(), coverage=None
    ),
    "no vignette": calibration(vignette=None, vignette_sigma=None),
    "no response": calibration(response=None),
    "no uncertainty": calibration(vignette_sigma=None),
    "no residuals": calibration(coverage=coverage(residuals=False)),
    "no observations": calibration(coverage=EMPTY),
    "one exposure": calibration(coverage=replace(coverage(), exposure_edges_ms=10 + np.linspace(0, 0.01, 7))),
    "all residuals unknown": calibration(
        coverage=replace(
            coverage(),
            residual_by_grey=np.full((32, 3), np.nan),
            residual_by_radius=np.full((20, 3), np.nan),
            residual_by_place=np.full((6, 8), np.nan),
        )
    ),
    "one pair of few samples": calibration(
        exposure_ratios=ExposureRatios(np.array([[0, 1]]), np.array([1.0]), np.array([3.0]), np.array([4]))
    ),
    "twelve bits": calibration(max_grey=4095),
    "no verdicts": calibration(verdicts={}),
    "interrupted": calibration(partial=True),
}

TRUTH = Photometry("truth", Response.gamma(2.1), VIGNETTE)
FINDINGS = [
    *(ReportFindings(known, EXPOSURES_MS) for known in CASES.values()),
    *(ReportFindings(CASES[name], truth=TRUTH) for name in ("nothing known", "no uncertainty", "twelve bits")),
    *(ReportFindings(calibration(), exposures_ms) for exposures_ms in (None, np.full(24, 10.0), EXPOSURES_MS[:3])),
]


@pytest.fixture(scope="module")
def draw_once():
    """Draw equal charts only once: a chart depends only on its content, and most of these findings share charts."""
    drawn, draw = {}, chart_as_svg

    def once(chart):
        content = pickle.dumps(chart)
        if content not in drawn:
            drawn[content] = draw(chart)
        return drawn[content]

    return once


@pytest.mark.parametrize("findings", FINDINGS)
def test_any_combination_of_known_parts_gives_a_page_with_finite_numbers(findings, draw_once, monkeypatch):
    monkeypatch.setattr("ospc.report.charts.chart_as_svg", draw_once)
    content = page(findings)
    Outline(content)
    for drawn in re.findall(r' (?:d|x|y|width|height|viewBox)="([^"]*)"', content):
        assert "nan" not in drawn
        assert "inf" not in drawn


@pytest.mark.usefixtures("undrawn")
def test_the_page_states_what_is_missing():
    content = page(ReportFindings(CASES["no vignette"]))
    assert "Unknown: it was seen." in content
    assert "No pairs of frames could be compared." in page(ReportFindings(CASES["nothing known"]))
    assert "stopped early, so this result is partial" in page(ReportFindings(CASES["interrupted"]))


@pytest.mark.usefixtures("undrawn")
def test_the_page_shows_the_advice_of_the_calibration():
    known = replace(calibration(), advice=("film darker things", "pan"))
    text = Outline(page(ReportFindings(known))).text
    assert "Film darker things." in text
    assert "Pan." in text
    assert "nothing to improve" in Outline(page(ReportFindings(replace(known, advice=())))).text


@pytest.mark.usefixtures("undrawn")
def test_equal_results_give_equal_files():
    """Equal charts are tested with the charts."""
    assert whole_report() == whole_report()
