"""Run a batch: calibrate every recording, retry failures, merge by camera, and write a table and a page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from ospc.batch.cameras import Camera, merged_cameras, page
from ospc.batch.manifest import Entry
from ospc.batch.store import CSV_NAME, Row, Store, write_csv
from ospc.batch.work import Answer, Runner, Task, Work
from ospc.errors import OspcError
from ospc.formats.files import json_object, json_text, write_text
from ospc.system.folders import Content, check_usable
from ospc.system.versions import versions

SCHEMA = "ospc-batch/1"
"""Version of the folder layout, stored in ``batch.json``."""

PAGE_NAME = "index.html"
_HEAD = "batch.json"
_RECORDINGS = "recordings"
_OWN_NAMES = {_RECORDINGS, "cameras", CSV_NAME, PAGE_NAME}
"""Files and folders of an unfinished batch; ``batch.json`` is written last."""


@dataclass(frozen=True)
class BatchOutcome:
    """Outcome of a batch: a row per recording in the order of the manifest, cameras and files.

    An interrupted batch continues if it is run again.
    """

    rows: tuple[Row, ...]
    cameras: tuple[Camera, ...]
    files: tuple[Path, ...]
    interrupted: bool = False

    @property
    def failed(self) -> tuple[Row, ...]:
        """Recordings that could not be calibrated."""
        return tuple(row for row in self.rows if row.status == "failed")


_Show = Callable[[str, int, int, int], None]


def run_batch(
    entries: Sequence[Entry],
    folder: str | Path,
    runner: Runner,
    *,
    retries: int = 1,
    force: bool = False,
    progress: _Show = lambda _stage, _done, _total, _failed: None,
) -> BatchOutcome:
    """Calibrate recordings and merge those of each camera, reusing the results of an earlier run.

    The folder must be new, empty, or from an earlier run, unless ``force`` is set. It receives ``batch.csv``,
    ``index.html``, a folder per camera in ``cameras``, and a result per recording in ``recordings``. A recording that
    fails is retried after all others. ``progress`` is called with the name of the stage, how many recordings or
    cameras are done, their total, and how many failed. If it raises ``KeyboardInterrupt``, or the runner an error
    because it cannot continue, the results so far are written.
    """
    place = Path(folder)
    check_usable(place, content_of=_content, force=force)
    batch = _Batch(entries, [Row(entry.recording, entry.camera) for entry in entries], place, runner, progress)
    try:
        batch.recognise()
        for attempt in range(1, retries + 2):
            batch.calibrate(attempt)
    except KeyboardInterrupt:
        return batch.written(interrupted=True)
    except OspcError:  # the runner failed, or the disk is full: keep the results so far
        if any(row.status != "not done" for row in batch.rows):
            with suppress(OspcError):
                batch.written(interrupted=True)
        raise
    return batch.written(interrupted=False)


@dataclass
class _Batch:
    """A running batch, with one row per entry."""

    entries: Sequence[Entry]
    rows: list[Row]
    folder: Path
    runner: Runner
    show: _Show

    def __post_init__(self) -> None:
        self.store = Store(self.folder / _RECORDINGS)

    def recognise(self) -> None:
        """Find the recordings that an earlier run has done."""

        def recognised(row: Row, answer: Answer) -> Row:
            return replace(row, key=answer.key, status="done" if self.store.has(answer.key) else "not done")

        if any(self.store.folder.glob("??/*.ospc")):
            self._work("identify", "recognising", recognised)

    def calibrate(self, attempt: int) -> None:
        """Calibrate the recordings that are not done."""

        def recorded(row: Row, answer: Answer) -> Row:
            if not answer.error:
                self.store.put(answer.key, answer.result)
            return replace(
                row,
                status="failed" if answer.error else "done",
                error=answer.error.removeprefix(f"{row.recording}: "),
                attempts=attempt,
                seconds=round(answer.seconds, 3),
                worker=answer.worker,
                key=answer.key,
            )

        self._work("calibrate", "calibrating" if attempt == 1 else f"trying again ({attempt - 1})", recorded)

    def _work(self, what: Work, name: str, taken: Callable[[Row, Answer], Row]) -> None:
        """Run a piece of work on all recordings that are not done."""
        left = [number for number, row in enumerate(self.rows) if row.status != "done"]
        failed = 0
        with closing(self.runner(Task(number, self.entries[number], what) for number in left)) as answers:
            for count, answer in enumerate(answers, start=1):
                row = taken(self.rows[answer.number], answer)
                self.rows[answer.number] = row
                failed += row.status == "failed"
                self.show(name, count, len(left), failed)

    def written(self, *, interrupted: bool) -> BatchOutcome:
        """Merge the results and write everything that users read."""
        place, store = self.folder, self.store
        place.mkdir(parents=True, exist_ok=True)
        rows = [_with_result(row, store) if row.status == "done" else row for row in self.rows]
        cameras: list[Camera] = []
        try:
            cameras, rows = merged_cameras(
                rows, store, place, lambda done, total: self.show("merging", done, total, 0)
            )
        except KeyboardInterrupt:
            interrupted = True
        files = [write_csv(rows, place / CSV_NAME)]
        files.append(write_text(place / PAGE_NAME, page(cameras, rows)))
        content = {
            "schema": SCHEMA,
            "recordings": len(rows),
            "failed": sum(row.status == "failed" for row in rows),
            "cameras": [camera.name for camera in cameras],
            "interrupted": interrupted,
            "versions": versions(),
        }
        files.append(write_text(place / _HEAD, json_text(content) + "\n"))
        return BatchOutcome(tuple(rows), tuple(cameras), tuple(files), interrupted)


def _with_result(row: Row, store: Store) -> Row:
    """Return the row of a finished recording, completed with the figures of its result."""
    result = store.get(row.key)
    found = result.calibration
    counts, states = found.counts, {name: verdict.state for name, verdict in found.verdicts.items()}
    response, response_sigma = found.response, None
    if response is not None and response.inverse_sigma is not None:
        response_sigma = float(response.inverse_sigma[response.measured].max())
    return replace(
        row,
        frames=int(counts.get("frames", 0)),
        skipped=int(counts.get("skipped", 0)),
        pairs=int(counts.get("pairs", 0)),
        samples=int(counts.get("samples", 0)),
        response=states.get("response", ""),
        vignette=states.get("vignette", ""),
        response_sigma=response_sigma,
        vignette_sigma=None if found.vignette_sigma is None else float(found.vignette_sigma.max()),
        notes="; ".join(result.notes),
    )


def _content(place: Path) -> Content:
    earlier = Content("contains an earlier batch", "always")
    if (place / _HEAD).exists():
        schema = json_object(place / _HEAD).get("schema")
        if schema == SCHEMA:
            return earlier
        return Content(f"contains a batch of another version (schema {schema!r}, expected {SCHEMA!r})", "never")
    # A batch that was killed before its end has results, and perhaps some of the final files.
    found = {entry.name for entry in place.iterdir()}
    if _RECORDINGS in found and found <= _OWN_NAMES:
        return earlier
    return Content("contains something other than an earlier batch", "with force")
