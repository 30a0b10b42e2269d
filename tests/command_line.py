"""Call the command as a user does."""

from __future__ import annotations

import pytest
from click.testing import CliRunner, Result

from ospc.cli import calibration_result
from ospc.cli.main import cli
from ospc.report.output_folder import OutputFolder, Written


def leave_out(patch: pytest.MonkeyPatch, *parts: str) -> None:
    """Skip the plotted parts of the output, "draw" or "report", which take most of the time."""
    for part in parts:
        patch.setattr(OutputFolder, part, lambda *_, **__: Written())
    if {"draw", "report"} <= set(parts):
        patch.setattr(calibration_result, "drawings_of", lambda _findings: None)


def ospc(*words: object) -> Result:
    """Return the result of ``ospc WORDS``."""
    return CliRunner().invoke(cli, [str(word) for word in words])
