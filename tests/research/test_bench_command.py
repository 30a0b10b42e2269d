"""``ospc bench accuracy``."""

from __future__ import annotations

import json

import pytest

from command_line import ospc
from ospc.errors import SettingError


def invoke(*arguments: object):
    return ospc("bench", "accuracy", *arguments)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("bench")
    options = ("-o", out, "--frames", 20, "--only", "static-srgb", "--presets", "default")
    return options, out, invoke(*options)


def test_leaves_tables_figures_and_prints_them(finished):
    _, out, result = finished
    assert result.exit_code == 0, result.output
    assert "static-srgb" in result.output
    assert "gamma curves replace" in result.output
    assert {"results.json", "results.csv", "table.md", "cache"} <= {path.name for path in out.iterdir()}
    (row,) = json.loads((out / "results.json").read_text())["measurements"]
    assert row["method"] == "default"
    assert row["states"]["vignette"] == "not identifiable"


def test_a_second_run_computes_nothing(finished, monkeypatch):
    options, out, _ = finished
    before = (out / "results.csv").read_bytes()
    monkeypatch.setattr("ospc.research.source._run_and_judge", lambda *_: pytest.fail("computed again"))
    result = invoke(*options)
    assert result.exit_code == 0, result.output
    assert (out / "results.csv").read_bytes() == before


def test_json_is_all_that_is_printed(finished):
    options, _, _ = finished
    result = invoke(*options, "--json")
    assert json.loads(result.stdout)["measurements"][0]["recording"] == "static-srgb"


def test_an_interruption_is_reported_and_finished_results_are_shown(finished, monkeypatch):
    def interrupt(*_arguments):
        raise KeyboardInterrupt

    options, _, _ = finished
    monkeypatch.setattr("ospc.research.source._run_and_judge", interrupt)
    result = invoke(*options[:-1], "default,paper")
    assert result.exit_code == 130
    assert "the same command continues" in result.output
    assert "static-srgb" in result.output


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--presets", "nobody"), "no preset is called"),
        (("--presets", " , "), "names no preset"),
        (("--only", "nothing-like-it"), "known: linear-strong"),
        (("--data", "nowhere"), "not a folder"),
    ],
)
def test_wrong_options_are_named(tmp_path, options, message):
    result = invoke("-o", tmp_path / "out", *options)
    assert isinstance(result.exception, SettingError)
    assert message in str(result.exception)
    assert not (tmp_path / "out").exists()
