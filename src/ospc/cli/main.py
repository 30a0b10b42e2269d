"""The ``ospc`` command: imports a subcommand only when it is called, and prints errors as one line."""

from __future__ import annotations

import atexit
import gc
import os
import sys
from contextlib import suppress
from importlib import import_module
from io import TextIOWrapper

import click

from ospc import __version__
from ospc.cli.interruption import Interruption
from ospc.cli.terminal import INTERRUPTED, escaped_lines, say
from ospc.errors import OspcError, one_line

_COMMANDS = {
    "batch": "Calibrate many recordings, locally or on a cluster, and merge those of one camera.",
    "bench": "Benchmark the methods on recordings with known truth.",
    "calibrate": "Calibrate the camera of a recording.",
    "check": "Check whether a recording is suitable for calibration, and what is wrong with it.",
    "compare": "Compare two calibrations.",
    "convert": "Convert any recording to a folder that DSO and its descendants read.",
    "correct": "Remove response and vignette from the images of a recording.",
    "demo": "Simulate a short recording, calibrate it and compare with the truth.",
    "evaluate": "Evaluate trajectories, and the effect of a calibration on tracking.",
    "experiments": "Reproduce the figures and tables of the paper.",
    "export": "Export a calibration for another program.",
    "import": "Import a calibration from pcalib.txt and vignette.png, or from another program.",
    "report": "Write the report on a calibration again, as HTML or PDF.",
    "live": "Calibrate a camera while it films, and say what to film next.",
    "merge": "Combine several recordings of one camera into one calibration.",
    "record": "Record from a camera to a folder that can be calibrated.",
    "simulate": "Simulate a recording with known truth.",
    "validate": "Check parameter files against the rules of the programs that read them.",
}
"""Name of each command, also that of its module, and its line in the overview."""

_MODULES = {"import": "import_"}
"""Modules of commands whose name is a keyword of Python."""


_LEAST_MEMORY_MIB = 1024
"""Address space below which OpenBLAS may end the process, or never return, instead of raising an error."""

_MALLOC = {
    "MALLOC_ARENA_MAX": (-8, 1),
    "MALLOC_TRIM_THRESHOLD_": (-1, 32 * 2**20),
    "MALLOC_MMAP_THRESHOLD_": (-3, 32 * 2**20),
}
"""Environment variables that tell glibc what to do with freed memory, with the number of each parameter for
``mallopt`` and its value: one pool for all threads, and blocks of up to 32 MiB stay in it. An image takes one or
two."""

_ALLOCATIONS_PER_COLLECTION = 20_000
"""New objects after which Python looks for garbage in cycles; it would look ten to thirty times as often."""


class _Commands(click.Group):
    """A group that lists its commands without importing them, and ends every failure as one line."""

    def list_commands(self, _ctx: click.Context) -> list[str]:
        return list(_COMMANDS)

    def get_command(self, _ctx: click.Context, name: str) -> click.Command | None:
        if name not in _COMMANDS:
            return None
        command: click.Command = import_module(f"ospc.cli.{_MODULES.get(name, name)}").command
        return command

    def format_commands(self, _ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(_COMMANDS.items()))

    def invoke(self, ctx: click.Context) -> object:
        """Call a command, which returns its exit code or None; the context's object is the interruption."""
        with Interruption() as ctx.obj:
            _check_memory_limit()
            _reuse_freed_memory()
            # Before NumPy is imported: matrices are small, and further threads of OpenBLAS only wait and take memory.
            os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
            # Nearly all objects are made by imports and stay: looking through them often takes a thirtieth of a run.
            gc.set_threshold(_ALLOCATIONS_PER_COLLECTION)
            # At its end Python would look through all of them several times, for garbage that goes with the process.
            atexit.register(gc.freeze)
            try:
                code = super().invoke(ctx)
            except KeyboardInterrupt as interruption:
                say("; ".join(["ospc: interrupted", *map(str, interruption.args)]), err=True)
                code = INTERRUPTED
            except click.UsageError as error:
                # It quotes arguments, and a shell makes arguments of the names of files.
                raise click.UsageError(escaped_lines(error.format_message()), error.ctx) from None
            except (OspcError, click.ClickException, click.exceptions.Exit, click.Abort, BrokenPipeError):
                raise
            except Exception as error:
                raise OspcError(one_line(error)) from error
        return ctx.exit(code or 0)


def _check_memory_limit() -> None:
    """Refuse a memory limit that is too low."""
    if sys.platform == "win32":
        return
    import resource

    limit_bytes, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit_bytes == resource.RLIM_INFINITY:
        return
    if limit_bytes < _LEAST_MEMORY_MIB * 2**20:
        given = limit_bytes // 2**20
        raise OspcError(f"{given} MiB of memory are too few; allow {_LEAST_MEMORY_MIB} MiB at least (ulimit -v)")


def _reuse_freed_memory() -> None:
    """Have glibc reuse freed memory: by default each thread has its own pool, and large blocks are given back."""
    if sys.platform != "linux":
        return
    import ctypes

    for name, (parameter, value) in _MALLOC.items():
        if name not in os.environ:
            os.environ[name] = str(value)  # for processes started from here: this one has read it already
            with suppress(AttributeError):  # there are other C libraries
                ctypes.CDLL(None).mallopt(parameter, value)


@click.command(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"], "show_default": True})
@click.version_option(__version__, prog_name="ospc")
def cli() -> None:
    """Photometric calibration of cameras from ordinary recordings."""


def main() -> None:
    """Run the command; expected errors become one line on standard error and exit code 1."""
    # OpenCV and its decoders would print their own view of what becomes one line of ours.
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # what the terminal cannot show must not end a run
    try:
        cli(prog_name="ospc")
    except OspcError as error:
        say(f"ospc: error: {error}", err=True)
        sys.exit(1)
