"""Trivial tasks, in a separate module so that other processes can import them."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import asdict
from functools import partial
from pathlib import Path

from ospc.research.measurement import Measurement
from ospc.research.runner import Task


def fake_task(name, shape=0.01, log=None, error=None, wait_for=None):
    return Task(name, {"kind": "fake", "shape": shape}, partial(_fake, name, shape, log, error, wait_for))


def _fake(name, shape, log: Path | None, error: type[BaseException] | None, wait_for: Path | None, progress):
    if error is not None:
        raise error
    if log is not None:
        with log.open("a") as file:
            file.write(f"{name}\n")
    while wait_for is not None and not (wait_for.exists() and wait_for.read_text()):
        time.sleep(0.05)
    progress(0.5)
    progress(1.0)
    return [asdict(Measurement(name, "default", {"response_shape_rmse": shape}))]


def deadly_task():
    """Return a task whose process is killed, as for lack of memory."""
    return Task("deadly", {"kind": "deadly"}, _die)


def _die(_progress):
    os.kill(os.getpid(), signal.SIGKILL)


def sleeping_program(program, source):
    """Return a task that runs a program which records its process id and does not end on its own."""
    return Task("sleeping", {"kind": "sleeping"}, partial(_track, program, source))


def _track(program, source, _progress):
    return program.track(source, 0).as_dict()
