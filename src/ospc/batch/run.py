"""A batch: every recording calibrated, failures tried again, those of one camera merged, a table and a page made."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ospc.atomic import write_atomically
from ospc.batch.cameras import Camera, merged_cameras
from ospc.batch.entries import Entry
from ospc.batch.local import Runner
from ospc.batch.overview import write_overview
from ospc.batch.store import Store
from ospc.batch.table import CSV_NAME, PARQUET_NAME, Row, write_csv, write_parquet
from ospc.batch.work import Answer, Task
from ospc.errors import FormatError, MissingExtraError, OspcError, SettingError
from ospc.formats.files import read_text
from ospc.versions import versions

SCHEMA = "ospc-batch/1"
"""Version of the folder's layout; it is in ``batch.json``."""

PAGE_NAME = "index.html"
_HEAD = "batch.json"


@dataclass(frozen=True)
class Stage:
    """How far a batch has come.

    Attributes
    ----------
    name
        What is being done.
    done, total
        How many of how many are done.
    failed
        How many of these failed.
    """

    name: str
    done: int
    total: int
    failed: int = 0


@dataclass(frozen=True)
class Outcome:
    """What came of a batch.

    Attributes
    ----------
    rows
        One of each recording, in the order of the manifest.
    cameras
        The cameras.
    files
        What was written.
    notes
        What the user should know.
    interrupted
        Whether it was stopped before its end; running it again goes on.
    """

    rows: tuple[Row, ...]
    cameras: tuple[Camera, ...]
    files: tuple[Path, ...]
    notes: tuple[str, ...] = ()
    interrupted: bool = False

    @property
    def failed(self) -> tuple[Row, ...]:
        """Recordings that could not be calibrated."""
        return tuple(row for row in self.rows if row.status == "failed")


@dataclass
class _Progress:
    """What is known of every recording while the batch runs."""

    entries: Sequence[Entry]
    keys: dict[int, str] = field(default_factory=dict)
    done: set[int] = field(default_factory=set)
    errors: dict[int, str] = field(default_factory=dict)
    attempts: dict[int, int] = field(default_factory=dict)
    answers: dict[int, Answer] = field(default_factory=dict)

    @property
    def left(self) -> list[int]:
        return [number for number in range(len(self.entries)) if number not in self.done]


def run_batch(
    entries: Sequence[Entry],
    folder: str | Path,
    runner: Runner,
    *,
    retries: int = 1,
    force: bool = False,
    progress: Callable[[Stage], None] = lambda _stage: None,
) -> Outcome:
    """Calibrate recordings and merge those of each camera; what an earlier run did is not done again.

    Parameters
    ----------
    entries
        The recordings.
    folder
        Where to: a new or empty folder, or that of an earlier run. It gets ``batch.csv``, ``batch.parquet``,
        ``index.html``, a folder of each camera in ``cameras``, and the results of the recordings in ``recordings``.
    runner
        Who does the work.
    retries
        How often a recording that failed is tried again, after all others.
    force
        Whether a folder that holds something else will do.
    progress
        Told how far it has come. It may raise ``KeyboardInterrupt``: what is done by then is written.

    Raises
    ------
    SettingError
        If the folder cannot be used.
    FormatError
        If results cannot be written.
    OspcError
        If the runner cannot go on at all; what was done by then is written.
    """
    place = Path(folder)
    _check(place, force=force)
    store = Store(place / "recordings")
    state = _Progress(entries)
    interrupted = False
    try:
        _recognise(state, store, runner, progress)
        for attempt in range(retries + 1):
            _calibrate(state, store, runner, progress, attempt)
    except KeyboardInterrupt:
        interrupted = True
    except (
        OspcError
    ):  # whoever did the work is gone, or the disk is full: what is done should not look as if it were not
        if state.done or state.errors:
            with suppress(OspcError):
                _written(state, store, place, progress, interrupted=True)
        raise
    return _written(state, store, place, progress, interrupted=interrupted)


def _recognise(state: _Progress, store: Store, runner: Runner, progress: Callable[[Stage], None]) -> None:
    """Find out which recordings an earlier run has done."""
    there = store.keys()
    if not there:
        return
    total = len(state.entries)
    tasks = (Task(number, entry, "identify") for number, entry in enumerate(state.entries))
    with closing(runner.run(tasks)) as answers:
        for count, answer in enumerate(answers, start=1):
            state.keys[answer.number] = answer.key
            if answer.key in there and store.has(answer.key):
                state.done.add(answer.number)
            progress(Stage("recognising", count, total))


def _calibrate(
    state: _Progress, store: Store, runner: Runner, progress: Callable[[Stage], None], attempt: int
) -> None:
    left = state.left
    stage = "calibrating" if attempt == 0 else f"trying again ({attempt})"
    failed = 0
    tasks = (Task(number, state.entries[number]) for number in left)
    with closing(runner.run(tasks)) as answers:
        for count, answer in enumerate(answers, start=1):
            failed += _take(state, store, answer, attempt)
            progress(Stage(stage, count, len(left), failed))


def _take(state: _Progress, store: Store, answer: Answer, attempt: int) -> bool:
    """Take note of an answer and return whether it is a failure."""
    number = answer.number
    state.attempts[number] = attempt + 1
    state.keys[number] = answer.key
    # The result is on disk from here on: hundreds of thousands of them in memory would be too many.
    state.answers[number] = replace(answer, result=b"")
    if answer.error:
        state.errors[number] = answer.error
        return True
    store.put(answer.key, answer.result)
    state.errors.pop(number, None)
    state.done.add(number)
    return False


def _written(
    state: _Progress, store: Store, place: Path, progress: Callable[[Stage], None], *, interrupted: bool
) -> Outcome:
    place.mkdir(parents=True, exist_ok=True)
    try:
        cameras, rows = merged_cameras(
            list(_rows(state, store)), store, place, lambda done, total: progress(Stage("merging", done, total))
        )
    except KeyboardInterrupt:
        interrupted, cameras, rows = True, [], list(_rows(state, store))
    notes: list[str] = []
    files = [write_csv(rows, place / CSV_NAME)]
    try:
        files.append(write_parquet(rows, place / PARQUET_NAME))
    except MissingExtraError as error:
        (place / PARQUET_NAME).unlink(missing_ok=True)  # one of an earlier run would contradict the other table
        notes.append(f"no {PARQUET_NAME}: {error}")
    files.append(write_overview(cameras, rows, place / PAGE_NAME))
    content = {
        "schema": SCHEMA,
        "recordings": len(rows),
        "failed": sum(row.status == "failed" for row in rows),
        "cameras": [camera.name for camera in cameras],
        "interrupted": interrupted,
        "versions": versions(),
    }
    files.append(_write_head(place, content))
    return Outcome(tuple(rows), tuple(cameras), tuple(files), tuple(notes), interrupted)


def _rows(state: _Progress, store: Store) -> Iterator[Row]:
    for number, entry in enumerate(state.entries):
        answer = state.answers.get(number, Answer(number))
        row = Row(
            entry.recording,
            entry.camera,
            "failed" if number in state.errors else "not done",
            error=state.errors.get(number, ""),
            attempts=state.attempts.get(number, 0),
            seconds=round(answer.seconds, 3),
            worker=answer.worker,
            key=state.keys.get(number, ""),
        )
        yield _with_result(row, store) if number in state.done else row


def _with_result(row: Row, store: Store) -> Row:
    result = store.get(row.key)
    found = result.calibration
    counts = found["counts"]
    verdicts = {name: found["verdicts"].get(name, {}).get("state", "") for name in ("response", "vignette")}
    response, vignette = found["response"], found["vignette"]
    return replace(
        row,
        status="done",
        frames=int(counts.get("frames", 0)),
        skipped=int(counts.get("skipped", 0)),
        pairs=int(counts.get("pairs", 0)),
        samples=int(counts.get("samples", 0)),
        **verdicts,
        notes="; ".join(result.notes),
        response_sigma=_largest(response, "inverse_sigma"),
        vignette_sigma=_largest(vignette, "profile_sigma"),
    )


def _largest(part: dict[str, Any] | None, name: str) -> float | None:
    return None if part is None or not part.get(name) else float(max(part[name]))


def _check(place: Path, *, force: bool) -> None:
    if place.exists() and not place.is_dir():
        raise SettingError(f"{place}: is a file; name a folder for the output")
    if not place.exists() or not any(place.iterdir()):
        return
    head = place / _HEAD
    if head.exists():
        try:
            content = json.loads(read_text(head))
            schema = content.get("schema") if isinstance(content, dict) else None
        except (FormatError, ValueError, RecursionError):
            schema = None
        if schema != SCHEMA:
            raise SettingError(
                f"{place}: holds a batch of another version (schema {schema!r}, expected {SCHEMA!r}); choose another "
                "folder"
            )
        return
    # A batch that was killed before its end has left results and nothing else.
    if not force and {entry.name for entry in place.iterdir()} - {"recordings", "cameras"}:
        raise SettingError(
            f"{place}: holds something else than an earlier batch; choose another folder, or add --force to write "
            "into it"
        )


def _write_head(place: Path, content: dict[str, Any]) -> Path:
    try:
        return write_atomically(place / _HEAD, json.dumps(content, indent=1).encode() + b"\n")
    except OSError as error:
        raise FormatError(f"{place / _HEAD}: cannot be written ({error.strerror})") from None
