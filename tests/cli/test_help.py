"""Help texts appear quickly and contain no markup."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator

import click
import pytest

from command_line import ospc
from ospc.cli.main import cli

HEAVY = ("scipy", "matplotlib", "rich", "ospc.estimation", "ospc.report")
"""Packages that help texts do not need and that take noticeable time to import."""


def commands(command: click.Command, words: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    yield words
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            inner = command.get_command(context, name)
            assert inner is not None
            yield from commands(inner, (*words, name))


EVERY = list(commands(cli))


@pytest.mark.parametrize("words", EVERY, ids=" ".join)
def test_help_texts_contain_no_formatter_marks(words: tuple[str, ...]) -> None:
    result = ospc(*words, "--help")
    assert result.exit_code == 0
    assert "\\b" not in result.output
    assert "\b" not in result.output


@pytest.mark.parametrize("name", ["batch", "calibrate", "correct", "merge"])
def test_exit_codes_are_listed_one_per_line(name: str) -> None:
    lines = ospc(name, "--help").output.partition("Exit codes:")[2].splitlines()
    assert [line.split()[0] for line in lines if line.strip()[:1].isdigit()][:3] == ["0", "1", "2"]


def test_the_package_can_be_run_as_a_module() -> None:
    done = subprocess.run([sys.executable, "-m", "ospc", "--help"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("Usage: ospc [OPTIONS] COMMAND")


def test_help_texts_import_nothing_heavy() -> None:
    program = (
        "import sys; from click.testing import CliRunner; from ospc.cli.main import cli\n"
        f"for words in {EVERY!r}: CliRunner().invoke(cli, [*words, '--help'])\n"
        f"print([name for name in {HEAVY!r} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
