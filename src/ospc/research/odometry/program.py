"""Runs DSO, or a program that takes the same arguments and writes a result.txt."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from ospc.errors import FormatError, SettingError
from ospc.evaluation.trajectory import Trajectory, read_trajectory
from ospc.research.odometry.experiment import Tracked
from ospc.research.odometry.inputs import CAMERA, OdometryInput
from ospc.research.source import PCALIB, VIGNETTE

_RESULT = "result.txt"
_LOG_TAIL = 4000
"""Bytes kept from the end of a program's output."""


@dataclass(frozen=True)
class Program:
    """A program with the command line of DSO, and additional arguments.

    It is started with ``files= calib= mode= gamma= vignette=`` in a folder of its own, where it writes
    ``result.txt``.
    """

    executable: Path
    timeout_s: float = 3600.0
    arguments: tuple[str, ...] = ("preset=0", "nogui=1", "quiet=1", "nolog=1")

    def __post_init__(self) -> None:
        """Check the executable and the time limit."""
        if not self.executable.is_file() or not os.access(self.executable, os.X_OK):
            raise SettingError(f"{self.executable}: is not an executable; give the path of your dso_dataset")
        if not self.timeout_s > 0:
            raise SettingError(f"the time limit of a run is {self.timeout_s} s; give a positive number")

    def describe(self) -> dict[str, Any]:
        """Return a hash of the executable and the arguments."""
        return {"executable": sha256(self.executable.read_bytes()).hexdigest(), "arguments": list(self.arguments)}

    def command(self, source: OdometryInput) -> list[str]:
        """Return the command line, with paths relative to the folder of :meth:`OdometryInput.folder`.

        The path of the images has a slash because DSO looks for times.txt next to the part after the last slash.
        """
        curves = source.photometry
        given: dict[str, object] = {"files": "./images", "calib": CAMERA, "mode": source.condition.mode}
        if curves.response is not None:
            given["gamma"] = PCALIB
        if curves.vignette is not None:
            given["vignette"] = VIGNETTE
        return [str(self.executable.resolve()), *(f"{key}={value}" for key, value in given.items()), *self.arguments]

    def track(self, source: OdometryInput, run: int) -> Tracked:
        """Run the program once in a folder of its own."""
        with source.folder() as place, (place / "log.txt").open("w+b") as log:
            began = time.monotonic()
            code = self._exit_code(self.command(source), place, log.fileno())
            seconds = time.monotonic() - began
            log.seek(max(0, log.seek(0, os.SEEK_END) - _LOG_TAIL))
            tail = log.read().decode(errors="replace")
            trajectory, problem = _result(place / _RESULT)
        if code is None:
            failure = f"it took longer than {self.timeout_s:g} s"
        elif code != 0:
            failure = f"it ended with exit code {code}" if code > 0 else f"it was ended by signal {-code}"
        else:
            failure = problem
        return Tracked(trajectory, failure, code is None, tail, seconds)

    def _exit_code(self, command: list[str], place: Path, log: int) -> int | None:
        """Run a command, and kill all of its processes on a timeout, when the code is None, and on any exception."""
        with subprocess.Popen(  # noqa: S603 - the user's own program
            command,
            cwd=place,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
            start_new_session=True,
        ) as process:
            try:
                return process.wait(self.timeout_s)
            except subprocess.TimeoutExpired:
                return None
            finally:
                if process.poll() is None:
                    os.killpg(process.pid, signal.SIGKILL)


def _result(path: Path) -> tuple[Trajectory | None, str]:
    if not path.is_file():
        return None, f"it wrote no {_RESULT}"
    try:
        return read_trajectory(path), ""
    except FormatError as error:
        return None, f"its {_RESULT} cannot be read: {str(error).removeprefix(f'{path}: ')}"
