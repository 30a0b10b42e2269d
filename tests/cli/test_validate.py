"""``ospc validate``: its output, exit codes and repaired files."""

from __future__ import annotations

import json
from functools import partial

import pytest

from command_line import ospc
from ospc.errors import FormatError
from ospc.formats.dso import write_pcalib, write_vignette
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette

run = partial(ospc, "validate")


@pytest.fixture
def falling(tmp_path):
    place = tmp_path / "pcalib.txt"
    place.write_text(" ".join(str(i if i != 100 else 98) for i in range(256)))
    return place


def test_valid_files_exit_with_0(tmp_path):
    write_pcalib(Response.gamma(2.0), tmp_path / "pcalib.txt")
    write_vignette(PolynomialVignette((64, 48), (-0.3, 0.0, 0.0)), tmp_path / "vignette.png")
    result = run(tmp_path, "--size", "64x48")
    assert result.exit_code == 0
    assert result.output.count(": valid") == 2


def test_an_invalid_file_exits_with_1_and_states_rule_effect_and_remedy(falling):
    result = run(falling, "--for", "mono")
    assert result.exit_code == 1
    assert "strictly increasing" in result.output
    assert "corrects neither" in result.output
    assert "remedy: " in result.output


def test_repair_writes_a_copy_that_is_valid(falling):
    result = run(falling, "--repair")
    assert result.exit_code == 1
    assert "isotonic" in result.output
    assert run(falling.with_name("pcalib.repaired.txt")).exit_code == 0


def test_a_repair_that_would_invent_content_is_reported(tmp_path):
    (tmp_path / "pcalib.txt").write_text("1 2 3")
    result = run(tmp_path / "pcalib.txt", "--repair")
    assert result.exit_code == 1
    assert "not repaired: " in result.output


def test_json_contains_everything(falling):
    content = json.loads(run(falling, "--json", "--repair").output)
    assert content["valid"] is False
    assert content["findings"][0]["severity"] == "error"
    assert set(content["findings"][0]) == {"severity", "file", "rule", "effect", "remedy"}
    assert content["repairs"][0]["path"] == str(falling.with_name("pcalib.repaired.txt"))


def test_misuse_exits_with_2(falling):
    assert run(falling, "--size", "wide").exit_code == 2
    assert run().exit_code == 2


def test_missing_file_is_an_expected_error(tmp_path):
    result = run(tmp_path / "nowhere.txt")
    assert isinstance(result.exception, FormatError)


def test_help_documents_the_exit_codes():
    assert "exit code is 0" in " ".join(run("--help").output.split())
