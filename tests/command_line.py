"""Calls the command as a user does."""

from __future__ import annotations

from click.testing import CliRunner, Result

from ospc.cli.main import cli


def ospc(*words: object) -> Result:
    """Return the outcome of ``ospc WORDS``."""
    return CliRunner().invoke(cli, [str(word) for word in words])
