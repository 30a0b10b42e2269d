"""The work on one recording: in this process, in others of this machine, or on another machine."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import socket
import time
from collections.abc import Generator, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from itertools import islice
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Literal, Protocol

import ospc
from ospc.batch.manifest import Entry, is_address
from ospc.batch.object_store import local_copy
from ospc.batch.store import VERSION, Result
from ospc.calibrator import OnlineCalibrator, drive
from ospc.errors import RecordingError, one_line
from ospc.library_threads import one_library_thread
from ospc.recording import Recording, open_recording
from ospc.recording.recording import identity

_MOST_FILES = 2_000_000
"""Files of a recording whose names and sizes are part of its key; far more than any has."""


@dataclass(frozen=True)
class Task:
    """A piece of work on one recording: only to identify it, or to calibrate it. Numbers are unique."""

    number: int
    entry: Entry
    what: Literal["identify", "calibrate"] = "calibrate"


@dataclass(frozen=True)
class Answer:
    """The outcome of the task of this number, and the host and process that did it.

    ``key`` identifies content and settings of the recording, ``result`` is the file of the result, and ``error`` a
    sentence on what went wrong; each is empty where there is none.
    """

    number: int
    key: str = ""
    result: bytes = b""
    error: str = ""
    seconds: float = 0.0
    worker: str = ""


def work(task: Task) -> Answer:
    """Do a task; whatever goes wrong is reported in the answer."""
    begun_s = time.monotonic()
    answer = Answer(task.number)
    try:
        with one_library_thread(), _here(task.entry.recording) as place:
            recording = open_recording(place, task.entry.kind, task.entry.reading)
            source = identity(recording) | {"name": Path(task.entry.recording.rstrip("/")).name}
            key = _key(place, source, task.entry)
            answer = replace(answer, key=key)
            if task.what == "calibrate":
                result = _calibrated(recording, source, key, task.entry)
                if _key(place, source, task.entry) != key:  # a result must not pass for that of other content
                    raise RecordingError(f"{place}: its files changed meanwhile; run the command again")
                answer = replace(answer, result=result.to_bytes())
    except Exception as error:  # a failure is a result too: the other recordings go on
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
    """Return a hash of what a recording holds, how it is read and calibrated, and by which version.

    Of the content it covers all stamps and exposures, some images, and the names and sizes of all files. When files
    were changed and where the recording is do not matter.
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
    for name, size in sorted(islice(_listed(place), _MOST_FILES)):
        total.update(f"{name}\0{size}\n".encode("utf-8", "surrogatepass"))
    return total.hexdigest()


def _listed(folder: Path) -> Iterator[tuple[str, int]]:
    for parent, folders, names in os.walk(folder):
        folders.sort()
        for name in names:
            file = Path(parent) / name
            yield file.relative_to(folder).as_posix(), file.stat().st_size


def _here(recording: str) -> AbstractContextManager[Path]:
    """Give the recording as a path on this machine."""
    return local_copy(recording) if is_address(recording) else nullcontext(Path(recording))


_PATIENCE_S = 5
"""Time an idle or terminated process gets to end before it is killed."""


class Runner(Protocol):
    """Does tasks, here or elsewhere."""

    def run(self, tasks: Iterable[Task]) -> Generator[Answer, None, None]:
        """Give the answers to tasks as they come, one to each, in no particular order."""
        ...


class ThisProcess:
    """Does one task after the other."""

    def run(self, tasks: Iterable[Task]) -> Generator[Answer, None, None]:
        """Give the answers in the order of the tasks."""
        yield from map(work, tasks)


@dataclass
class _Worker:
    process: SpawnProcess
    connection: Connection
    task: Task | None = None


@dataclass(frozen=True)
class Processes:
    """Does tasks in processes of this machine; one that dies takes only its own task with it."""

    count: int

    def run(self, tasks: Iterable[Task]) -> Generator[Answer, None, None]:
        """Give the answers as they come."""
        waiting, workers = iter(tasks), list[_Worker]()
        try:
            while True:
                self._hand_out(waiting, workers)
                busy = [worker for worker in workers if worker.task is not None]
                if not busy:
                    return
                ready = wait([worker.connection for worker in busy])
                for worker in busy:
                    if worker.connection in ready:
                        yield _answer_of(worker)
                        if not worker.process.is_alive():
                            workers.remove(worker)
        finally:
            for worker in workers:
                _end(worker)

    def _hand_out(self, waiting: Iterator[Task], workers: list[_Worker]) -> None:
        """Give every idle worker a task, and start workers as long as there are tasks for them."""
        while True:
            idle = next((worker for worker in workers if worker.task is None), None)
            if idle is None and len(workers) >= self.count:
                return
            task = next(waiting, None)
            if task is None:
                return
            if idle is None:
                idle = _started()
                workers.append(idle)
            idle.task = task
            with suppress(OSError):  # a worker that died meanwhile is noticed when its answer is awaited
                idle.connection.send(task)


def _started() -> _Worker:
    # A fresh interpreter, because libraries with threads do not survive a fork.
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_serve, args=(there,), daemon=True)
    process.start()
    there.close()
    return _Worker(process, here)


def _serve(connection: Connection) -> None:
    """Answer tasks until there are no more."""
    # Ctrl-C reaches all processes of a terminal, but only the one that hands out work must act on it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(EOFError, OSError):
        while True:
            connection.send(work(connection.recv()))


def _answer_of(worker: _Worker) -> Answer:
    task, worker.task = worker.task, None
    assert task is not None
    try:
        answer: Answer = worker.connection.recv()
    except (EOFError, OSError):
        worker.process.join()
        return Answer(task.number, error=f"the process that worked on it died ({_death(worker.process.exitcode)})")
    return answer


def _death(exitcode: int | None) -> str:
    if exitcode is None or exitcode >= 0:
        return f"exit code {exitcode}"
    with suppress(ValueError):
        name = signal.Signals(-exitcode).name
        return f"{name}, perhaps for lack of memory" if name == "SIGKILL" else name
    return f"signal {-exitcode}"


def _end(worker: _Worker) -> None:
    worker.connection.close()
    if worker.task is not None:
        worker.process.terminate()
    worker.process.join(_PATIENCE_S)
    if worker.process.is_alive():
        worker.process.kill()
        worker.process.join()


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
