"""The results of a batch on disk: one file per recording, keyed by content and settings, and a table of all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Literal

from ospc.errors import FormatError, os_error_as
from ospc.formats.files import csv_text, write_bytes, write_text
from ospc.photometry.calibration import Calibration
from ospc.pooling.summary import Summary
from ospc.state import container
from ospc.state.container import Container
from ospc.state.values import pack, unpack

KIND, VERSION = "batch-result", 9
"""Kind and version that the result files declare."""


@dataclass(frozen=True)
class Result:
    """The calibration of one recording.

    The key identifies content and settings. ``summary`` is needed for merging; None if nothing was learned.
    """

    key: str
    calibration: Calibration
    summary: Summary | None
    notes: tuple[str, ...] = ()

    def to_bytes(self) -> bytes:
        """Return the content of the result file; equal results give equal bytes."""
        content, arrays = pack(self)
        return container.to_bytes(Container(KIND, VERSION, content, arrays))


@dataclass(frozen=True)
class Store:
    """A folder of results; it need not exist yet."""

    folder: Path

    def put(self, key: str, data: bytes) -> Path:
        """Check a result, which may come over a network, store it atomically, and return its path."""
        name = f"the result of {key[:12]}…"
        found = container.from_bytes(data, name)
        if (found.kind, found.version, found.content.get("key")) != (KIND, VERSION, key):
            raise FormatError(f"{name} is not the requested one; do all workers have the same version?")
        place = self._place(key)
        with os_error_as(FormatError, f"{place.parent}: cannot be made", "check its permissions"):
            place.parent.mkdir(parents=True, exist_ok=True)
        return write_bytes(place, data)

    def get(self, key: str) -> Result:
        """Return a result; FormatError if it is missing, damaged, or of another version."""
        place = self._place(key)
        found = container.load(place, KIND, VERSION)
        return unpack(Result, found.content, found.arrays, str(place))

    def has(self, key: str) -> bool:
        """Return whether an intact result of this version is stored."""
        try:
            self.get(key)
        except FormatError:
            return False
        return True

    def _place(self, key: str) -> Path:
        # Folders of hundreds of thousands of files are slow in many file systems.
        return self.folder / key[:2] / f"{key}.ospc"


SCHEMA = "ospc-batch-table/1"
"""Version of the columns, repeated in the first column."""

CSV_NAME = "batch.csv"

Status = Literal["done", "failed", "not done"]


@dataclass(frozen=True)
class Row:
    """The outcome of one recording.

    ``recording`` and ``camera`` are from the manifest. ``error`` says in one sentence why it was not calibrated.
    ``attempts`` is the number of tries, 0 if an earlier run had done it. ``seconds`` and ``worker`` (host and
    process) refer to the last attempt. ``key`` identifies the result. ``response`` and ``vignette`` are states of
    verdicts; the sigmas are the largest standard deviations of g, at the measured grey levels, and V. ``differs``
    says how the recording contradicts the others of its camera. ``notes`` are about its exposures and skipped frames.
    """

    recording: str
    camera: str
    status: Status = "not done"
    error: str = ""
    attempts: int = 0
    seconds: float = 0.0
    worker: str = ""
    key: str = ""
    frames: int = 0
    skipped: int = 0
    pairs: int = 0
    samples: int = 0
    response: str = ""
    vignette: str = ""
    response_sigma: float | None = None
    vignette_sigma: float | None = None
    differs: str = ""
    notes: str = ""


def write_csv(rows: Sequence[Row], path: Path) -> Path:
    """Write the table as CSV atomically, and return the path.

    No cell is interpreted as a formula, see :func:`~ospc.formats.files.csv_text`.
    """
    header = ["schema", *(entry.name for entry in fields(Row))]
    return write_text(path, csv_text([header, *((SCHEMA, *astuple(row)) for row in rows)]))
