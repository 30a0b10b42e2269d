"""The ``ospc`` command: loads a subcommand only when it is called, and turns errors into one line."""

from __future__ import annotations

import sys
from importlib import import_module

import click

from ospc import __version__
from ospc.errors import OspcError

_COMMANDS = {
    "batch": "Calibrate many recordings, here or on a cluster, and merge those of one camera.",
    "bench": "Measure the methods on recordings whose truth is known.",
    "calibrate": "Calibrate the camera of a recording.",
    "check": "Say what a calibration of a recording could find, and what is wrong with it.",
    "compare": "Compare two calibrations.",
    "convert": "Write any recording as a folder that DSO and its descendants read.",
    "correct": "Take response and vignette out of a recording's images.",
    "demo": "Simulate a short recording, calibrate it and compare with the truth.",
    "evaluate": "Evaluate trajectories, and what a calibration does for tracking.",
    "experiments": "Make the paper's figures and tables anew.",
    "export": "Write a calibration for another program.",
    "import": "Make a calibration of somebody else's pcalib.txt and vignette.png.",
    "report": "Write the report on a calibration anew, as a page for browsers or PDF.",
    "merge": "Make one calibration of several recordings of one camera.",
    "record": "Film with a camera into a folder that can be calibrated.",
    "simulate": "Make a recording with known truth.",
    "validate": "Check parameter files against the rules of the programs that read them.",
}
"""Name of each command, which is also its module's, and its line in the overview."""

_MODULES = {"import": "import_"}
"""Modules of commands whose own name no module can have."""


class _Commands(click.Group):
    """A group that lists its commands without importing them."""

    def list_commands(self, _ctx: click.Context) -> list[str]:
        return list(_COMMANDS)

    def get_command(self, _ctx: click.Context, name: str) -> click.Command | None:
        if name not in _COMMANDS:
            return None
        command: click.Command = import_module(f"ospc.cli.{_MODULES.get(name, name.replace('-', '_'))}").command
        return command

    def format_commands(self, _ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(_COMMANDS.items()))


@click.command(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="ospc")
def cli() -> None:
    """Photometric calibration of cameras from ordinary recordings."""


def main() -> None:
    """Run the command; an expected error becomes one line on standard error and exit code 1."""
    try:
        cli(prog_name="ospc")
    except OspcError as error:
        click.echo(f"ospc: error: {error}", err=True)
        sys.exit(1)
