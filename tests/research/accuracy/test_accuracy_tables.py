"""Summaries and tables agree with the results."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import replace

import pytest

from ospc.errors import SettingError
from ospc.research.accuracy.report import accuracy_report, accuracy_tables
from ospc.research.measurement import METRICS, Measurement, Metric, medians, spread
from ospc.research.tables import Table, measurements_csv

SHAPE = next(m for m in METRICS if m.figure == "response_shape_rmse")
BIAS = next(m for m in METRICS if m.figure == "ratio_bias")
SHARE = next(m for m in METRICS if m.figure == "response_within_1_sigma")


def result(name, mine, other, noise="low", **more):
    figures = {"default": {"response_shape_rmse": mine, **more}, "paper": {"response_shape_rmse": other}}
    return [
        Measurement(
            name,
            method,
            {figure: value for figure, value in known.items() if value is not None},
            group="simulated",
            factors={"noise": noise},
        )
        for method, known in figures.items()
    ]


RESULTS = [
    *result("a", 0.01, 0.03),
    *result("b", 0.02, None, ratio_bias=-0.5, response_within_1_sigma=0.5),
    *result("c", 0.06, 0.05, "high", ratio_bias=0.2, response_within_1_sigma=1.0),
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


@pytest.mark.parametrize(
    ("metric", "value", "text"),
    [(SHAPE, 0.01234, "0.0123"), (BIAS, 0.1, "+0.1000"), (SHARE, 0.683, "68%"), (SHAPE, None, "–")],
)
def test_texts(metric: Metric, value, text):
    assert metric.text(value) == text


def test_medians_count_what_is_missing_as_infinite():
    assert medians(RESULTS, "response_shape_rmse") == {"default": 0.02, "paper": 0.05}
    assert medians(RESULTS[:4], "response_shape_rmse") == {"default": 0.015, "paper": math.inf}


def test_marked_cells_are_bold():
    table = Table("x", ("method", "error"), (("a", "0.1"), ("b", "0.2")), best=frozenset({(0, 1)}))
    assert table.as_markdown().splitlines()[2:] == [
        "| method | error |",
        "| --- | ---: |",
        "| a | **0.1** |",
        "| b | 0.2 |",
    ]


def test_files_hold_whole_tables_settings_and_every_measurement(tmp_path):
    report = accuracy_report(RESULTS, ["default", "paper"], ["a note"])
    written = report.write(tmp_path / "out")
    assert [path.name for path in written] == ["results.json", "results.csv", "table.md", "errors.png"]
    text = (tmp_path / "out" / "table.md").read_text()
    assert "- a note" in text
    for block in text.split("\n\n"):
        rows = [line for line in block.splitlines() if line.startswith("|")]
        assert len({line.count("|") for line in rows}) <= 1
    assert "0.0400 (2 of 3)" in text
    assert "| noise = high | default | 0.0600 |" in text
    content = json.loads((tmp_path / "out" / "results.json").read_text())
    assert set(content["presets"]) == {"default", "paper"}
    assert content["summary"]["simulated"]["default"]["response_shape_rmse"]["worst_case"] == "c"
    assert [row["recording"] for row in content["measurements"]] == list("aabbcc")
    assert "curves" not in content["measurements"][0]
    assert {"ospc", "numpy", "opencv"} <= set(content["versions"])
    assert content == json.loads(json.dumps(report.content))


def test_every_table_is_about_one_group():
    static = [replace(row, group="static") for row in RESULTS[:2]]
    titles = [table.title for table in accuracy_tables([*RESULTS, *static])]
    assert len(titles) == len(set(titles)) == 5
    assert sum("at rest" in title for title in titles) == 2


def test_csv_has_a_line_for_every_measurement():
    lines = list(csv.DictReader(io.StringIO(measurements_csv(RESULTS))))
    assert [(line["recording"], line["method"]) for line in lines] == [
        (name, method) for name in "abc" for method in ("default", "paper")
    ]
    assert [line["response_shape_rmse"] for line in lines] == ["0.01", "0.03", "0.02", "", "0.06", "0.05"]
    assert lines[4]["noise"] == "high"


def test_a_file_in_the_way_is_an_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(SettingError, match="cannot be written"):
        accuracy_report(RESULTS, ["default"], []).write(tmp_path / "file")
