"""The work on one recording, in this process, in another, or on another machine."""

from __future__ import annotations

import json
import os
import socket
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from itertools import islice
from pathlib import Path
from typing import Literal

import ospc
from ospc.batch.entries import Entry, is_address
from ospc.batch.object_store import local_copy
from ospc.batch.store import VERSION, Result
from ospc.calibrator import OnlineCalibrator, drive
from ospc.errors import RecordingError, one_line
from ospc.library_threads import one_library_thread
from ospc.recording import Recording, open_recording
from ospc.recording.identity import identity

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
