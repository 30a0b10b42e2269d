"""Untrusted content reaches terminals, spreadsheets and pages only as text."""

from __future__ import annotations

import ast
import errno
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import click
import pytest

import ospc.cli
from command_line import leave_out
from command_line import ospc as run
from ospc.cli.terminal import console, print_json, say, styled
from ospc.formats.files import csv_text
from ospc.research.tables import Table
from ospc.simulation import SimulationSettings, simulate


@pytest.fixture(scope="module")
def short_recording(tmp_path_factory):
    place = tmp_path_factory.mktemp("short") / "recording"
    simulate(place, SimulationSettings(size=(96, 72), frames=12, exposure="sweep"))
    return place


HOSTILE = "\x1b[31m\x9b2J\x07\u202e\x7f\nfaked: line"
NOT_UTF8 = os.fsdecode(b"walk\xff")
SPEAKING = {"print", "click.echo", "click.secho", "click.style", "Console"}


def is_harmless(text):
    return all(line.isprintable() for line in text.split("\n"))


def test_escape_sequences_are_escaped(capsys):
    say(f"{HOSTILE}: 5 frames")
    say("error: ", HOSTILE, err=True)
    out, err = capsys.readouterr()
    assert out.count("\n") == err.count("\n") == 1
    assert is_harmless(out)
    assert is_harmless(err)
    assert "\\x1b[31m" in out


def test_own_styles_are_kept(monkeypatch):
    shown = []
    monkeypatch.setattr(click, "echo", lambda text, **_: shown.append(text))
    say(styled("bad\x1b[0m", fg="red"), ": \x1b[32m")
    assert shown == [click.style(r"bad\x1b[0m", fg="red") + r": \x1b[32m"]


def test_json_is_escaped_without_changing_its_content(capsys):
    print_json({"name": HOSTILE, "not UTF-8": NOT_UTF8})
    out = capsys.readouterr().out
    assert is_harmless(out)
    out.encode("ascii")
    assert json.loads(out) == {"name": HOSTILE, "not UTF-8": NOT_UTF8}


def test_tables_and_bars_are_escaped(capsys):
    from rich.table import Table as RichTable
    from rich.text import Text

    table = RichTable()
    table.add_column(HOSTILE)
    table.add_row(Text(HOSTILE))
    console(width=80).print(table)
    assert is_harmless(capsys.readouterr().out)


def test_only_one_module_writes_to_the_terminal():
    for path in Path(ospc.cli.__file__).parent.glob("*.py"):
        if path.name != "terminal.py":
            called = {
                ast.unparse(node.func) for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)
            }
            assert not called & SPEAKING, path.name


def test_arguments_quoted_in_errors_are_escaped():
    result = run("check", "a", "b\x1b[31m")
    assert result.exit_code == 2
    assert is_harmless(result.output)


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@a", "\t=1", "\r=1"])
def test_no_cell_of_any_table_is_a_formula(text):
    assert csv_text([["name"], [text, -1.5, None]]) == f'"name"\n"\'{text}",-1.5,""\n'


def test_markdown_tables_keep_their_structure():
    text = Table("t", ("a|b", "c"), (("x|y\n| z", "<img>"),)).as_markdown()
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert [row.replace("\\|", "").count("|") for row in rows] == [3, 3, 3]
    assert "<" not in text


def test_every_command_accepts_a_recording_with_any_name(short_recording, tmp_path, monkeypatch):
    name = b"\x1b[31m=1+1 $\\bad$ <b> walk\xff"
    recording, out = tmp_path / os.fsdecode(name), tmp_path / os.fsdecode(b"out " + name)
    shutil.copytree(short_recording, recording)
    results = [run("check", recording), run("calibrate", recording, "-o", out, "--preset", "fast")]
    leave_out(monkeypatch, "draw")
    results += [
        run("calibrate", recording, "-o", out, "--preset", "fast", "--resume", "--json"),
        run("merge", out, "-o", tmp_path / "merged", "--json"),
        run("report", out, "--recording", recording, "--truth", recording),
        run("compare", out, recording, "--plot", out.with_suffix(".png")),
        run("batch", tmp_path / "*", "-o", tmp_path / "batch", "-j", "1"),
    ]
    for result in results:
        assert result.exit_code in (0, 3, 4), result.exception or result.output
        assert is_harmless(result.output)
    found = json.loads((out / "calibration.json").read_text("utf-8"))
    assert found["source"]["name"].isprintable()
    assert (out / "state.ospc").exists()
    assert "\x1b" not in (out / "report.html").read_text("utf-8")
    assert "<b>" not in (out / "report.html").read_text("utf-8")
    (tmp_path / "batch" / "batch.csv").read_text("utf-8")


def test_a_name_that_the_file_system_refuses_is_an_ordinary_error():
    name = "x" * 300
    assert str(run("compare", name, name).exception) == f"{name}: {os.strerror(errno.ENAMETOOLONG)}"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs the device /dev/full")
@pytest.mark.parametrize("words", [("--help",), ("validate", "pcalib.txt", "--json")])
def test_output_that_cannot_be_written_is_one_line(tmp_path, words):
    (tmp_path / "pcalib.txt").write_text(" ".join(map(str, range(256))))
    program = "from ospc.cli.main import main; main()"
    with Path("/dev/full").open("w") as full:
        found = subprocess.run(
            [sys.executable, "-c", program, *words],
            stdout=full,
            stderr=subprocess.PIPE,
            cwd=tmp_path,
            text=True,
            check=False,
        )
    assert found.stderr == f"ospc: error: {os.strerror(errno.ENOSPC)}; free some space\n"
    assert found.returncode == 1


@pytest.mark.skipif(sys.platform == "win32", reason="no shell that closes streams")
@pytest.mark.parametrize(
    ("command", "closed", "exit_code", "last_file"),
    [
        ("convert", ">&-", 0, "times.txt"),
        ("convert", "2>&-", 0, "times.txt"),
        ("calibrate", ">&- 2>&-", 3, "report.html"),
    ],
)
def test_closed_output_streams_do_not_prevent_the_result(
    short_recording, tmp_path, command, closed, exit_code, last_file
):
    program = "from ospc.cli.main import main; main()"
    words = [command, str(short_recording), "-o", str(tmp_path / "out")]
    shell = ["sh", "-c", f'"$@" {closed}', "sh", sys.executable, "-c", program, *words]
    assert subprocess.run(shell, capture_output=True, check=False).returncode == exit_code
    assert (tmp_path / "out" / last_file).is_file()
