"""The ``ospc`` command: imports a subcommand only when it is called, and prints errors as one line."""

from __future__ import annotations

import atexit
import gc
import os
import sys
from contextlib import suppress
from importlib import import_module
from io import TextIOWrapper
from keyword import iskeyword
from pathlib import Path

import click

from ospc import __version__
from ospc.cli.interruption import Interruption
from ospc.cli.terminal import INTERRUPTED, escaped_lines, say
from ospc.errors import OspcError, one_line

_COMMANDS = {
    "batch": "Calibrate many recordings, locally or on a cluster, and merge those of one camera.",
    "bench": "Measure accuracy, speed and robustness on recordings with known truth.",
    "calibrate": "Calibrate a camera from a recording.",
    "check": "Check whether a recording is suitable for calibration, and report problems.",
    "compare": "Compare two calibrations.",
    "convert": "Convert any recording to a folder that DSO and its descendants read.",
    "correct": "Remove response and vignette from the images of a recording.",
    "demo": "Simulate a short recording, calibrate it and compare with the truth.",
    "evaluate": "Evaluate trajectories, and the effect of a calibration on tracking.",
    "experiments": "Reproduce the paper's figures and tables.",
    "export": "Export a calibration for another program.",
    "import": "Import a calibration from pcalib.txt and vignette.png, or from another program.",
    "report": "Write the report on a calibration again.",
    "live": "Calibrate a camera while it films, with advice on what to film next.",
    "merge": "Combine several recordings of one camera into one calibration.",
    "record": "Record from a camera to a folder that can be calibrated.",
    "simulate": "Simulate a recording with known truth.",
    "validate": "Check parameter files against the rules of the programs that read them.",
}
"""Commands and their lines in the overview; each module has the name of its command, keywords with a ``_``."""

_LEAST_MEMORY_MIB = 1024
"""Address space below which OpenBLAS may end the process or hang, instead of raising an error."""
_MALLOC = {
    "MALLOC_ARENA_MAX": (-8, 1),
    "MALLOC_TRIM_THRESHOLD_": (-1, 32 * 2**20),
    "MALLOC_MMAP_THRESHOLD_": (-3, 32 * 2**20),
}
"""Environment variables that control how glibc reuses freed memory, each with its ``mallopt`` parameter number and
value: one pool for all threads, which keeps blocks of up to 32 MiB. An image takes one or two MiB."""
_ALLOCATIONS_PER_COLLECTION = 500_000
"""New objects between two garbage collections: more than the drawings of a report leave. With 20 000, collections
took a hundredth of a run, and memory 7 MB less."""


class _Commands(click.Group):
    """A group that lists its commands without importing them, and reports every failure as one line."""

    def list_commands(self, _ctx: click.Context) -> list[str]:
        return list(_COMMANDS)

    def get_command(self, _ctx: click.Context, name: str) -> click.Command | None:
        if name not in _COMMANDS:
            return None
        module = f"{name}_" if iskeyword(name) else name
        command: click.Command = import_module(f"ospc.cli.{module}").command
        return command

    def format_commands(self, _ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(_COMMANDS.items()))

    def invoke(self, ctx: click.Context) -> object:
        """Run a command, which returns its exit code or None; the context's object is the interruption."""
        with Interruption() as ctx.obj:
            _check_memory_limit()
            _reuse_freed_memory()
            # Must precede the import of NumPy. Matrices are small: more threads would only wait and use memory.
            os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
            # Nearly all objects are created by imports and stay; scanning them often takes a thirtieth of a run.
            gc.set_threshold(_ALLOCATIONS_PER_COLLECTION)
            # Otherwise Python scans all objects several times at exit, although the process ends anyway.
            atexit.register(gc.freeze)
            try:
                code = super().invoke(ctx)
            except KeyboardInterrupt as interruption:
                say("; ".join(["ospc: interrupted", *map(str, interruption.args)]), err=True)
                code = INTERRUPTED
            except click.UsageError as error:
                # The message quotes arguments, which may be file names expanded by the shell.
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
    if limit_bytes != resource.RLIM_INFINITY and limit_bytes < _LEAST_MEMORY_MIB * 2**20:
        given = limit_bytes // 2**20
        raise OspcError(f"{given} MiB of memory is too little; allow at least {_LEAST_MEMORY_MIB} MiB (ulimit -v)")


def _reuse_freed_memory() -> None:
    """Make glibc reuse freed memory: by default, each thread has its own pool, and large blocks are returned."""
    if sys.platform != "linux":
        return
    import ctypes

    for name, (parameter, value) in _MALLOC.items():
        if name not in os.environ:
            os.environ[name] = str(value)  # for child processes: this one has read it already
            with suppress(AttributeError):  # other C libraries have no mallopt
                ctypes.CDLL(None).mallopt(parameter, value)


@click.command(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"], "show_default": True})
@click.version_option(__version__, prog_name="ospc")
def cli() -> None:
    """Photometric calibration of cameras from ordinary recordings."""


def main() -> None:
    """Run the command; expected errors become one line on standard error and exit code 1."""
    # OpenCV and its decoders would print their own messages in addition to our one-line error.
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # a service may have closed it
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115 (open until the end)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # characters the terminal cannot show must not end a run
    try:
        cli(prog_name="ospc")
    except (OspcError, OSError) as error:  # click prints help before any command is invoked
        say(f"ospc: error: {one_line(error)}", err=True)
        sys.exit(1)
