"""The report is one page that needs nothing else, says the verdict first, and holds up whatever is known."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from recordings import VIGNETTE, before_a_wall, calibration, coverage

from ospc.errors import FormatError
from ospc.formats.opening import Photometry
from ospc.photometry.calibration import ExposureRatios
from ospc.photometry.coverage import Coverage
from ospc.photometry.response import Response
from ospc.report.examples import examples_of
from ospc.report.page import Findings, page, write_page

EXPOSURES_MS = np.geomspace(2, 10, 24)
VOID = {"meta", "img", "br"}


class Outline(HTMLParser):
    """Checks that all tags are closed in order and collects headings, links and text."""

    def __init__(self, text):
        super().__init__()
        self.open, self.headings, self.sources, self.text = [], [], [], ""
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.sources += [value for name, value in attrs if name in ("src", "href")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.sources += [value for name, value in attrs if name in ("src", "href")]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] == "h2":
            self.headings.append(data)
        if "style" not in self.open:
            self.text += data


def whole_report(**changes):
    known, recording = calibration(**changes), before_a_wall(EXPOSURES_MS)
    return page(Findings(known, recording.exposures_ms, examples_of(known, recording)))


@pytest.fixture(scope="module")
def report():
    return whole_report()


def test_it_needs_nothing_but_itself(report):
    outline = Outline(report)
    assert all(source.startswith("data:image/") for source in outline.sources)
    assert "<script" not in report
    assert "url(" not in report
    assert "http" not in report.replace("http-equiv", "")


def test_the_verdict_comes_first_and_everything_else_after_it(report):
    assert Outline(report).headings == [
        "In short",
        "Response and vignette",
        "Exposures, stated and seen",
        "Before and after",
        "Does it help to track points?",
        "What was seen",
        "What the calibration leaves unexplained",
        "What would improve it",
        "Settings and versions",
    ]
    assert "The response and the vignette of this camera are known well." in report


def test_it_is_small(report):
    assert len(report) < 600_000


def test_all_settings_and_versions_are_in_it():
    known = calibration(settings={"alpha": 0.125, "beta": [1, 2]}, versions={"numpy": "9.9"})
    text = Outline(page(Findings(known))).text
    for part in ("alpha", "0.125", "beta", "1, 2", "numpy", "9.9"):
        assert part in text


def test_texts_from_outside_are_only_texts():
    known = calibration(source={"name": "<script>alert(1)</script>"}, settings={"<b>": "</td>"})
    content = page(Findings(known))
    assert "<script" not in content
    assert "<b>" not in content
    assert "<script>alert(1)</script>" in Outline(content).text


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


@pytest.mark.parametrize("truth", [None, Photometry("truth", Response.gamma(2.1), VIGNETTE)])
@pytest.mark.parametrize("exposures_ms", [None, EXPOSURES_MS, np.full(24, 10.0), EXPOSURES_MS[:3]])
@pytest.mark.parametrize("name", CASES)
def test_whatever_is_known_makes_a_page_of_finite_figures(name, exposures_ms, truth):
    content = page(Findings(CASES[name], exposures_ms, truth=truth))
    Outline(content)
    for drawn in re.findall(r' (?:d|x|y|width|height|viewBox)="([^"]*)"', content):
        assert "nan" not in drawn
        assert "inf" not in drawn


def test_what_is_missing_is_said():
    content = page(Findings(CASES["no vignette"]))
    assert "Not known: it was seen." in content
    assert "No pairs of frames could be compared." in page(Findings(CASES["nothing known"]))
    assert "ended before the end of the recording" in page(Findings(CASES["interrupted"]))


def test_gaps_of_the_data_become_advice():
    text = Outline(page(Findings(calibration()))).text
    assert "Hardly any sample has grey levels 0–32" in text
    assert "Hardly any sample lies at radii 0.90–1.00" in text


def test_pairs_of_few_samples_do_not_count_where_there_are_many():
    count = 60
    pairs = np.stack([np.arange(count), np.arange(count) + 1], axis=1)
    few = np.arange(count) % 2 == 1
    ratios = ExposureRatios(pairs, np.full(count, 1.5), np.where(few, 9.0, 1.5), np.where(few, 80, 300))
    content = page(Findings(calibration(exposure_ratios=ratios), np.full(count + 1, 10.0)))
    assert "30 pairs of fewer than 120 samples" in content
    assert "agree with those stated to 0.000 % (median over 30 pairs" in content


def test_a_check_of_the_recording_is_shown():
    check = {"verdicts": {"lag": {"state": "identifiable", "reason": "none seen", "remedy": ""}}, "notes": ["so"]}
    text = Outline(page(Findings(calibration(), check=check))).text
    assert "Check of the recording" in text
    assert "none seen" in text


def test_the_same_gives_the_same_file(report):
    assert whole_report() == report


def test_it_is_written_whole_or_not_at_all(tmp_path):
    place = write_page(Findings(calibration()), tmp_path / "report.html")
    assert place.read_text(encoding="utf-8").endswith("</html>\n")
    with pytest.raises(FormatError, match="cannot be written"):
        write_page(Findings(calibration()), tmp_path / "absent" / "report.html")
