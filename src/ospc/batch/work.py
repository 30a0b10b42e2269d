"""Work on one recording, in this process, in other processes, or on another machine."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import socket
import time
from collections.abc import Generator, Iterable
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from itertools import islice
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Literal, Protocol, TypeAlias

import ospc
from ospc.batch.manifest import Entry
from ospc.batch.object_store import local_copy
from ospc.batch.store import VERSION, Result
from ospc.calibrator import OnlineCalibrator, drive
from ospc.errors import RecordingError, one_line
from ospc.library_threads import one_library_thread
from ospc.recording import Recording, open_recording
from ospc.recording.recording import identity

_MOST_FILES = 2_000_000
"""Most files of a recording whose names and sizes enter its key; far more than any recording has."""


Work: TypeAlias = Literal["identify", "calibrate"]


@dataclass(frozen=True)
class Task:
    """A piece of work on one recording: only identify it, or calibrate it. Numbers are unique."""

    number: int
    entry: Entry
    what: Work = "calibrate"


@dataclass(frozen=True)
class Answer:
    """The outcome of the task with this number, and the host and process that ran it.

    ``key`` identifies content and settings of the recording, ``result`` is the content of the result file, and
    ``error`` says in a sentence what went wrong; each may be empty.
    """

    number: int
    key: str = ""
    result: bytes = b""
    error: str = ""
    seconds: float = 0.0
    worker: str = ""


def work(task: Task) -> Answer:
    """Run a task; any error is reported in the answer."""
    begun_s = time.monotonic()
    answer = Answer(task.number)
    try:
        with one_library_thread(), local_copy(task.entry.recording) as place:
            recording = open_recording(place, task.entry.kind, task.entry.reading)
            source = identity(recording) | {"name": Path(task.entry.recording.rstrip("/")).name}
            key = _key(place, source, task.entry)
            answer = replace(answer, key=key)
            if task.what == "calibrate":
                result = _calibrated(recording, source, key, task.entry)
                if _key(place, source, task.entry) != key:  # the result would be stored for the wrong content
                    raise RecordingError(f"{place}: its files changed meanwhile; run the command again")
                answer = replace(answer, result=result.to_bytes())
    except Exception as error:  # the other recordings go on
        answer = replace(answer, error=one_line(error) or type(error).__name__, result=b"")
    return replace(answer, seconds=time.monotonic() - begun_s, worker=f"{socket.gethostname()}:{os.getpid()}")


def _calibrated(recording: Recording, source: dict[str, object], key: str, entry: Entry) -> Result:
    calibrator = OnlineCalibrator.of(recording, entry.settings, correct_lag=entry.correct_lag)
    calibrator.source = source
    drive(calibrator, recording)
    calibration = calibrator.calibration()
    notes = (*calibration.notes, *calibration.warnings, *calibrator.first_reasons)
    return Result(key, calibration.as_dict(), calibrator.summary(), notes)


def _key(place: Path, source: dict[str, object], entry: Entry) -> str:
    """Return a hash of a recording's content, its reading options and settings, and the version.

    It covers all stamps and exposures, some images, and the names and sizes of all files, but not the modification
    times or the location of the recording.
    """
    content = {
        "source": {name: value for name, value in source.items() if name != "name"},
        "files": _files(place),
        "reading": sorted((name, value) for name, value in entry.options if name not in asdict(entry.settings)),
        "settings": asdict(entry.settings),
        "version": [VERSION, ospc.__version__],
    }
    return sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _files(place: Path) -> str:
    """Return a hash of the names and sizes of all files of a recording."""
    if place.is_file():
        return str(place.stat().st_size)
    total = sha256()
    files = (Path(parent) / name for parent, _, names in os.walk(place) for name in names)
    sizes = ((file.relative_to(place).as_posix(), file.stat().st_size) for file in islice(files, _MOST_FILES))
    for name, size in sorted(sizes):
        total.update(f"{name}\0{size}\n".encode("utf-8", "surrogatepass"))
    return total.hexdigest()


_PATIENCE_S = 5
"""Time that an idle or terminated process has to exit before it is killed."""


class Runner(Protocol):
    """Runs tasks, here or elsewhere."""

    def run(self, tasks: Iterable[Task]) -> Generator[Answer, None, None]:
        """Yield one answer per task as they arrive, in any order."""
        ...


class ThisProcess:
    """Runs tasks one after the other in this process."""

    def run(self, tasks: Iterable[Task]) -> Generator[Answer, None, None]:
        """Yield the answers in the order of the tasks."""
        yield from map(work, tasks)


@dataclass(frozen=True)
class Processes:
    """Runs tasks in processes of this machine; if one dies, only its task fails."""

    count: int

    def run(self, tasks: Iterable[Task]) -> Generator[Answer, None, None]:
        """Yield the answers as they arrive."""
        waiting, idle, busy = iter(tasks), list[_Worker](), list[_Worker]()
        try:
            while True:
                while len(busy) < self.count and (task := next(waiting, None)) is not None:
                    busy.append(idle.pop() if idle else _Worker())
                    busy[-1].give(task)
                if not busy:
                    return
                ready = wait([worker.connection for worker in busy])
                for worker in [each for each in busy if each.connection in ready]:
                    answer = worker.answer()
                    busy.remove(worker)
                    if worker.process.is_alive():
                        idle.append(worker)
                    yield answer
        finally:
            for worker in (*idle, *busy):
                worker.end(at_once=worker in busy)


class _Worker:
    """A process that runs tasks one after the other."""

    def __init__(self) -> None:
        # A fresh interpreter, because libraries with threads do not survive a fork.
        context = multiprocessing.get_context("spawn")
        self.connection, there = context.Pipe()
        self.process = context.Process(target=_serve, args=(there,), daemon=True)
        self.process.start()
        there.close()
        self._number = 0

    def give(self, task: Task) -> None:
        self._number = task.number
        with suppress(OSError):  # if the process has died, waiting for its answer shows that
            self.connection.send(task)

    def answer(self) -> Answer:
        try:
            answer: Answer = self.connection.recv()
        except (EOFError, OSError):
            self.process.join()
            why = f"the process that worked on it died ({_death(self.process.exitcode)})"
            return Answer(self._number, error=why)
        return answer

    def end(self, *, at_once: bool) -> None:
        self.connection.close()
        if at_once:
            self.process.terminate()
        self.process.join(_PATIENCE_S)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()


def _serve(connection: Connection) -> None:
    """Answer tasks until there are no more."""
    # Ctrl-C reaches all processes of a terminal, but only the parent process handles it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(EOFError, OSError):
        while True:
            connection.send(work(connection.recv()))


def _death(exitcode: int | None) -> str:
    if exitcode is None or exitcode >= 0:
        return f"exit code {exitcode}"
    with suppress(ValueError):
        name = signal.Signals(-exitcode).name
        return f"{name}, perhaps out of memory" if name == "SIGKILL" else name
    return f"signal {-exitcode}"


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
