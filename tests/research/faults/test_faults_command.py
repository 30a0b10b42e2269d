"""``ospc bench faults``."""

from __future__ import annotations

import json

import pytest

from command_line import ospc
from ospc.errors import SettingError


def invoke(*arguments: object):
    return ospc("bench", "faults", *arguments)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("faults")
    options = ("-o", out, "--frames", 30, "--recordings", 1, "--only", "reciprocal", "--strength", "medium")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ospc.research.faults.footage.SIZE", (160, 120))
        yield options, out, invoke(*options)


def test_leaves_tables_and_figures(finished):
    _, out, result = finished
    assert result.exit_code == 0, result.output
    assert "1000 over the exposure" in result.output
    assert {"results.json", "results.csv", "table.md", "cache"} == {path.name for path in out.iterdir()}
    clean, faulty = json.loads((out / "results.json").read_text())["runs"]
    assert clean["fault"] == "none"
    assert (faulty["fault"], faulty["strength"], faulty["outcome"]) == ("reciprocal", "medium", "detected")
    assert len((out / "results.csv").read_text().splitlines()) == 3


def test_a_second_run_computes_nothing(finished, monkeypatch):
    options, out, _ = finished
    before = (out / "table.md").read_bytes()
    monkeypatch.setattr("ospc.research.faults.judging._run", lambda *_: pytest.fail("computed again"))
    result = invoke(*options)
    assert result.exit_code == 0, result.output
    assert (out / "table.md").read_bytes() == before


def test_faults_are_listed_without_running_them(tmp_path):
    result = invoke("-o", tmp_path / "out", "--list", "--only", "*flicker")
    assert [line.split()[0] for line in result.output.splitlines()] == [
        "locked-flicker",
        "beating-flicker",
        "row-flicker",
    ]
    assert not (tmp_path / "out").exists()


def test_an_unknown_fault_is_named(tmp_path):
    result = invoke("-o", tmp_path / "out", "--only", "nothing-like-it")
    assert isinstance(result.exception, SettingError)
    assert "no fault of the benchmark matches" in str(result.exception)
