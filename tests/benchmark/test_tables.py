"""Summaries and tables say what the results say."""

from __future__ import annotations

import csv
import io
import json

import pytest
from fake_cases import FakeCase

from ospc.benchmark.case import Figures, Row
from ospc.benchmark.files import as_json, write_results
from ospc.benchmark.summary import METRICS, CaseResult, Metric, contest, spread
from ospc.benchmark.tables import all_tables, as_csv, as_markdown
from ospc.errors import SettingError

SHAPE = next(m for m in METRICS if m.figure == "response_shape_rmse")
BIAS = next(m for m in METRICS if m.figure == "ratio_bias")
SHARE = next(m for m in METRICS if m.figure == "response_within_1_sigma")


def result(name, mine, other, noise="low", **more):
    rows = (
        Row("default", Figures(response_shape_rmse=mine, **more)),
        Row("paper", Figures(response_shape_rmse=other)),
    )
    return CaseResult(FakeCase(name, factors={"noise": noise}), rows)


RESULTS = [
    result("a", 0.01, 0.03),
    result("b", 0.02, None, ratio_bias=-0.5, response_within_1_sigma=0.5),
    result("c", 0.06, 0.05, "high", ratio_bias=0.2, response_within_1_sigma=1.0),
]


def test_spread_is_median_and_worst_with_its_case():
    found = spread(RESULTS, "default", SHAPE)
    assert (found.typical, found.worst, found.worst_case, found.known, found.cases) == (0.02, 0.06, "c", 3, 3)
    found = spread(RESULTS, "paper", SHAPE)
    assert (found.typical, found.known, found.cases) == (0.04, 2, 3)
    assert spread(RESULTS, "nobody", SHAPE) is None


def test_worst_bias_is_the_farthest_from_zero_and_worst_share_the_smallest():
    assert spread(RESULTS, "default", BIAS).worst == -0.5
    shares = spread(RESULTS, "default", SHARE)
    assert (shares.typical, shares.worst) == (0.75, 0.5)


def test_contest_counts_only_where_both_have_a_figure():
    found = contest(RESULTS, "default", "paper", "response_shape_rmse")
    assert (found.nearer, found.both, found.only_first, found.only_second) == (1, 2, 1, 0)


@pytest.mark.parametrize(
    ("metric", "value", "text"),
    [(SHAPE, 0.01234, "0.0123"), (BIAS, 0.1, "+0.1000"), (SHARE, 0.683, "68%"), (SHAPE, None, "–")],
)
def test_texts(metric: Metric, value, text):
    assert metric.text(value) == text


def test_markdown_tables_are_whole():
    text = as_markdown(all_tables(RESULTS), ["a note"])
    assert "- a note" in text
    assert "nothing is aligned by an exponent" in text
    for block in text.split("\n\n"):
        rows = [line for line in block.splitlines() if line.startswith("|")]
        assert len({line.count("|") for line in rows}) <= 1
    assert "0.0400 (2 of 3)" in text
    assert "1 of 2" in text
    assert "| noise = high | default | 0.0600 |" in text


def test_csv_has_a_line_for_every_case_and_method():
    lines = list(csv.DictReader(io.StringIO(as_csv(RESULTS))))
    assert [(line["case"], line["method"]) for line in lines] == [
        (name, method) for name in "abc" for method in ("default", "paper")
    ]
    assert [line["response_shape_rmse"] for line in lines] == ["0.01", "0.03", "0.02", "", "0.06", "0.05"]
    assert lines[4]["noise"] == "high"


def test_json_holds_settings_versions_and_every_row():
    content = json.loads(json.dumps(as_json(RESULTS, ["default", "paper"], []), allow_nan=False))
    assert set(content["presets"]) == {"default", "paper"}
    assert content["summary"]["simulated"]["default"]["response_shape_rmse"]["worst_case"] == "c"
    assert [case["name"] for case in content["cases"]] == ["a", "b", "c"]
    assert "curves" not in content["cases"][0]["rows"][0]
    assert {"ospc", "numpy", "opencv"} <= set(content["versions"])


def test_files_are_written(tmp_path):
    files, problems = write_results(tmp_path / "out", RESULTS, ["default"], [])
    assert [path.name for path in files] == ["results.json", "results.csv", "table.md", "errors.png"]
    assert all(path.stat().st_size > 100 for path in files)
    assert problems == []


def test_a_file_in_the_way_is_an_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(SettingError, match="cannot be written"):
        write_results(tmp_path / "file", RESULTS, ["default"], [])
