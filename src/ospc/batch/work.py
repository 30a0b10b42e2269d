"""What is done with one recording, wherever that is: in this process, in another, or on another machine."""

from __future__ import annotations

import json
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from itertools import islice
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from threadpoolctl import threadpool_limits

import ospc
from ospc.batch.entries import Entry
from ospc.batch.object_store import local_copy
from ospc.calibrator import OnlineCalibrator
from ospc.diagnosis.before_calibrating import examine
from ospc.errors import OspcError, said_by
from ospc.recording import Recording, open_recording
from ospc.recording.identity import identity
from ospc.state.container import Container, to_bytes
from ospc.state.values import pack

KIND, VERSION = "batch-result", 1
"""What files of results say they hold."""

_MOST_FILES = 2_000_000


@dataclass(frozen=True)
class Task:
    """Something to do with one recording.

    Attributes
    ----------
    number
        Tells tasks apart.
    entry
        The recording.
    what
        Whether to ``"identify"`` it only, or to ``"calibrate"`` it.
    """

    number: int
    entry: Entry
    what: Literal["identify", "calibrate"] = "calibrate"


@dataclass(frozen=True)
class Answer:
    """What came of a task.

    Attributes
    ----------
    number
        Of the task.
    key
        Tells content and settings of the recording apart from all others; empty where that failed.
    result
        The file of the result; empty where there is none.
    error
        What went wrong, as one sentence; empty if nothing did.
    seconds
        How long it took.
    worker
        Who did it.
    """

    number: int
    key: str = ""
    result: bytes = b""
    error: str = ""
    seconds: float = 0.0
    worker: str = ""


def work(task: Task) -> Answer:
    """Do a task; whatever goes wrong is in the answer."""
    begun_s = time.monotonic()
    answer = Answer(task.number)
    try:
        with _on_one_core(), _there(task.entry) as place:
            recording = open_recording(place, task.entry.kind, task.entry.reading)
            source = identity(recording) | {"name": Path(task.entry.recording.rstrip("/")).name}
            key = _key(place, source, task.entry)
            answer = replace(answer, key=key)
            if task.what == "calibrate":
                answer = replace(answer, result=_calibrated(recording, source, key, task.entry))
    except Exception as error:  # a failure is a result too: the other recordings go on
        text = said_by(error)
        sentence = text if isinstance(error, OspcError) else f"unexpected {type(error).__name__}: {text}"
        answer = replace(answer, error=sentence or type(error).__name__, result=b"")
    return replace(answer, seconds=time.monotonic() - begun_s, worker=f"{socket.gethostname()}:{os.getpid()}")


def _calibrated(recording: Recording, source: dict[str, object], key: str, entry: Entry) -> bytes:
    checked = examine(recording, entry.correct_lag)
    calibrator = OnlineCalibrator(entry.settings)
    calibrator.source = source
    for frame in checked.recording:
        calibrator.push(frame)
    calibration = calibrator.calibration()
    calibration = replace(calibration, source=source, verdicts=checked.judged(calibration.verdicts))
    text = json.dumps(calibration.as_dict(), allow_nan=False).encode()
    summary = calibrator.summary()
    packed, arrays = (None, {}) if summary is None else pack(summary, "summary")
    notes = [*checked.notes, *checked.warnings, *calibrator.first_reasons]
    content = {"key": key, "summary": packed, "notes": notes}
    return to_bytes(Container(KIND, VERSION, content, {**arrays, "calibration": np.frombuffer(text, np.uint8)}))


def _key(place: Path, source: dict[str, object], entry: Entry) -> str:
    """Return a hash of what the recording holds, how it is read and calibrated, and by which version.

    Of the content it covers all stamps and exposures, some images, and the names and sizes of all files; no time
    stamps of files, nor where the recording is.
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
        total.update(f"{name}\0{size}\n".encode())
    return total.hexdigest()


def _listed(folder: Path) -> Iterator[tuple[str, int]]:
    for parent, folders, names in os.walk(folder):
        folders.sort()
        for name in names:
            file = Path(parent) / name
            yield file.relative_to(folder).as_posix(), file.stat().st_size


@contextmanager
def _there(entry: Entry) -> Iterator[Path]:
    """Give the recording as a path on this machine."""
    if entry.is_remote:
        with local_copy(entry.recording) as place:
            yield place
    else:
        yield Path(entry.recording)


@contextmanager
def _on_one_core() -> Iterator[None]:
    """Keep libraries from using threads: recordings are worked on side by side, one on each core."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with threadpool_limits(1):
            yield
    finally:
        cv2.setNumThreads(before)
