"""The results of a batch on disk: one file per recording, named by content and settings, and the table of all."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Literal

from ospc.errors import FormatError, needs_extra
from ospc.formats.files import csv_text, write_bytes, write_text
from ospc.photometry.calibration import Calibration
from ospc.pooling.summary import Summary
from ospc.state import container
from ospc.state.container import Container
from ospc.state.values import pack, unpack

KIND, VERSION = "batch-result", 4
"""What the files claim to hold."""


@dataclass(frozen=True)
class Result:
    """The calibration of one recording, as ``calibration.json`` holds it.

    The key identifies content and settings. ``summary`` is what it can be merged by; None where nothing was learned.
    """

    key: str
    calibration: dict[str, Any]
    summary: Summary | None
    notes: tuple[str, ...] = ()

    def to_bytes(self) -> bytes:
        """Return its file; equal results give equal bytes."""
        content, arrays = pack(self)
        return container.to_bytes(Container(KIND, VERSION, content, arrays))


@dataclass(frozen=True)
class Store:
    """A folder of results; it need not exist yet."""

    folder: Path

    def keys(self) -> set[str]:
        """Return the keys of all results in the folder."""
        return {place.stem for place in self.folder.glob("??/*.ospc")}

    def put(self, key: str, data: bytes) -> Path:
        """Keep a result, whole or not at all, and return its path; it may come over a network, and is checked."""
        name = f"the result of {key[:12]}…"
        found = container.from_bytes(data, name)
        if (found.kind, found.version, found.content.get("key")) != (KIND, VERSION, key):
            raise FormatError(f"{name} is not what was asked for; do all workers have the same version?")
        place = self._place(key)
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FormatError(f"{place.parent}: cannot be made ({error.strerror}); check its permissions") from None
        return write_bytes(place, data)

    def get(self, key: str) -> Result:
        """Return a result; a format error says if it is not there, damaged, or of another version."""
        place = self._place(key)
        found = container.load(place, KIND, VERSION)
        try:
            result = unpack(Result, found.content, found.arrays)
            Calibration.from_dict(result.calibration)
        except (FormatError, LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
            raise FormatError(f"{place}: not readable as a result of a batch, {error}") from None
        return result

    def has(self, key: str) -> bool:
        """Tell whether a result is there, whole and of this version."""
        try:
            self.get(key)
        except FormatError:
            return False
        return True

    def _place(self, key: str) -> Path:
        # Folders of hundreds of thousands of files are slow in many file systems.
        return self.folder / key[:2] / f"{key}.ospc"


SCHEMA = "ospc-batch-table/1"
"""Version of the columns, repeated in the first of them."""

CSV_NAME, PARQUET_NAME = "batch.csv", "batch.parquet"

Status = Literal["done", "failed", "not done"]


@dataclass(frozen=True)
class Row:
    """The outcome of one recording.

    Attributes
    ----------
    recording, camera
        As in the manifest.
    status
        Whether it was calibrated.
    error
        Why not, in one sentence.
    attempts
        How often it was tried; 0 where an earlier run had done it.
    seconds
        Duration of the last attempt.
    worker
        Host and process that did it.
    key
        Name of its result, made from content and settings.
    frames, skipped, pairs, samples
        What the result rests on.
    response, vignette
        Whether each was determined: identifiable, marginal or not identifiable.
    response_sigma, vignette_sigma
        Largest standard deviation of g, and that of V at the corner; None where unknown.
    differs
        How it differs from the other recordings of its camera; empty where it does not.
    notes
        What was found about its exposures, and why frames were skipped.
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


_COLUMNS = ("schema", *(entry.name for entry in fields(Row)))
_INTEGERS = ("attempts", "frames", "skipped", "pairs", "samples")
_FLOATS = ("seconds", "response_sigma", "vignette_sigma")


def write_csv(rows: Sequence[Row], path: Path) -> Path:
    """Write the table as CSV, whole or not at all, and return the path.

    As :func:`~ospc.formats.files.csv_text` has it, no cell is a formula.
    """
    return write_text(path, csv_text([_COLUMNS, *(_values(row).values() for row in rows)]))


def write_parquet(rows: Sequence[Row], path: Path) -> Path:
    """Write the table as Parquet (extra ``parquet``), whole or not at all, and return the path."""
    with needs_extra("writing Parquet tables", "parquet"):
        import pyarrow as arrow
        from pyarrow import parquet
    kinds = {name: arrow.int64() for name in _INTEGERS} | {name: arrow.float64() for name in _FLOATS}
    schema = arrow.schema([(name, kinds.get(name, arrow.string())) for name in _COLUMNS])
    packed = io.BytesIO()
    parquet.write_table(arrow.Table.from_pylist([_values(row) for row in rows], schema), packed)
    return write_bytes(path, packed.getvalue())


def _values(row: Row) -> dict[str, object]:
    """Return the cells of a row; what UTF-8 cannot express, as in names that were never UTF-8, is escaped."""
    cells = {"schema": SCHEMA, **asdict(row)}
    return {
        name: cell.encode("utf-8", "backslashreplace").decode() if isinstance(cell, str) else cell
        for name, cell in cells.items()
    }
