"""Work on one recording, in this process, in other processes, or on another machine."""

from __future__ import annotations

import json
import os
import socket
import time
from collections.abc import Callable, Generator, Iterable
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from itertools import islice
from pathlib import Path
from typing import Literal, TypeAlias

import ospc
from ospc.batch.manifest import Entry
from ospc.batch.object_store import local_copy
from ospc.batch.store import VERSION, Result
from ospc.calibrator import OnlineCalibrator, drive
from ospc.errors import RecordingError, one_line
from ospc.recording import Recording, open_recording
from ospc.recording.recording import identity
from ospc.system.library_threads import one_library_thread
from ospc.system.processes import in_processes

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
        answer = replace(answer, error=one_line(error), result=b"")
    return replace(answer, seconds=time.monotonic() - begun_s, worker=f"{socket.gethostname()}:{os.getpid()}")


def _calibrated(recording: Recording, source: dict[str, object], key: str, entry: Entry) -> Result:
    calibrator = OnlineCalibrator.of(recording, entry.settings, correct_lag=entry.correct_lag, source=source)
    drive(calibrator, recording)
    calibration = calibrator.calibration()
    notes = (*calibration.notes, *calibration.warnings, *calibrator.first_reasons)
    return Result(key, calibration, calibrator.summary(), notes)


def _key(place: Path, source: dict[str, object], entry: Entry) -> str:
    """Return a hash of a recording's content, its reading options and settings, and the version."""
    # It covers all stamps and exposures, some images, and the names and sizes of all files, but not the modification
    # times or the location of the recording.
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


Runner: TypeAlias = Callable[[Iterable[Task]], Generator[Answer, None, None]]
"""Runs tasks, here or elsewhere, and yields one answer per task as they arrive, in any order."""


def on_this_machine(tasks: Iterable[Task], processes: int) -> Generator[Answer, None, None]:
    """Yield the answers from this many processes of this machine; if one dies, only its task fails."""
    found = in_processes(work, tasks, processes, lambda task, why: Answer(task.number, error=why))
    with closing(found) as answers:
        for _, answer in answers:
            yield answer


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
