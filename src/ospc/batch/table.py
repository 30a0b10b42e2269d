"""The table of a batch: one row a recording, as CSV and, with the extra ``parquet``, as Parquet."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

from ospc.atomic import write_atomically
from ospc.errors import FormatError, MissingExtraError, said_by
from ospc.formats.files import read_text

SCHEMA = "ospc-batch-table/1"
"""Version of the columns; it is in the first of them."""

CSV_NAME, PARQUET_NAME = "batch.csv", "batch.parquet"

Status = Literal["done", "failed", "not done"]


@dataclass(frozen=True)
class Row:
    """What became of one recording.

    Attributes
    ----------
    recording, camera
        As in the manifest.
    status
        Whether it was calibrated.
    error
        Why not, as one sentence.
    attempts
        How often it was tried; 0 where an earlier run had done it.
    seconds
        How long the last attempt took.
    worker
        Who made it.
    key
        Name of its result: content and settings.
    frames, skipped, pairs, samples
        What the result rests on.
    response, vignette
        What is known: identifiable, marginal or not identifiable.
    response_sigma, vignette_sigma
        Largest standard deviation of g, and that of V at the corner; None where unknown.
    differs
        In what it differs from the other recordings of its camera; empty where it does not.
    notes
        What was found of its exposures, and why frames were skipped.
    """

    recording: str
    camera: str
    status: Status
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


_COLUMNS = tuple(entry.name for entry in fields(Row))
_WHOLE = ("attempts", "frames", "skipped", "pairs", "samples")
_NUMBERS = ("seconds", "response_sigma", "vignette_sigma")


def write_csv(rows: Sequence[Row], path: Path) -> Path:
    """Write the table as CSV, whole or not at all, and return the path.

    Raises
    ------
    FormatError
        If it cannot be written.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("schema", *_COLUMNS))
    for row in rows:
        values = (getattr(row, name) for name in _COLUMNS)
        writer.writerow((SCHEMA, *("" if value is None else value for value in values)))
    return _written(path, text.getvalue().encode("utf-8", "surrogateescape"))


def write_parquet(rows: Sequence[Row], path: Path) -> Path:
    """Write the table as Parquet, whole or not at all, and return the path.

    Raises
    ------
    MissingExtraError
        Without pyarrow.
    FormatError
        If it cannot be written.
    """
    arrow, parquet = _arrow("writing Parquet tables")
    kinds = {name: arrow.int64() for name in _WHOLE} | {name: arrow.float64() for name in _NUMBERS}
    columns = {"schema": arrow.array([SCHEMA] * len(rows), arrow.string())}
    for name in _COLUMNS:
        values = [getattr(row, name) for row in rows]
        columns[name] = arrow.array(values, kinds.get(name, arrow.string()))
    sink = io.BytesIO()
    parquet.write_table(arrow.table(columns), sink)
    return _written(path, sink.getvalue())


def read_table(path: str | Path) -> list[Row]:
    """Read a table that :func:`write_csv` or :func:`write_parquet` wrote.

    Raises
    ------
    FormatError
        If it is none, or of another version.
    MissingExtraError
        If it is Parquet, without pyarrow.
    """
    place = Path(path)
    found = _parquet_rows(place) if place.suffix == ".parquet" else _csv_rows(place)
    rows = []
    for number, values in enumerate(found, start=2):
        if values.get("schema") != SCHEMA:
            raise FormatError(
                f"{place}: is of another version (schema {values.get('schema')!r}, expected {SCHEMA!r}); run "
                "'ospc batch' again, which keeps the results that are there"
            )
        try:
            rows.append(_row(values))
        except (LookupError, TypeError, ValueError) as error:
            raise FormatError(f"{place}, row {number}: not readable as a table of a batch ({error})") from None
    return rows


def _row(values: dict[str, Any]) -> Row:
    content: dict[str, Any] = {name: values[name] for name in _COLUMNS}
    for name in _WHOLE:
        content[name] = int(content[name])
    for name in _NUMBERS:
        content[name] = None if content[name] in ("", None) else float(content[name])
    return Row(**content)


def _csv_rows(place: Path) -> list[dict[str, Any]]:
    try:
        reader = csv.DictReader(io.StringIO(read_text(place), newline=""), strict=True)
        if reader.fieldnames is None or "schema" not in reader.fieldnames:
            raise FormatError(f"{place}: is no table of a batch; give the batch.csv that 'ospc batch' wrote")
        return list(reader)
    except csv.Error as error:
        raise FormatError(f"{place}: not readable as a table of a batch ({error})") from None


def _parquet_rows(place: Path) -> list[dict[str, Any]]:
    arrow, parquet = _arrow("reading Parquet tables")
    try:
        rows: list[dict[str, Any]] = parquet.read_table(place).to_pylist()
    except (OSError, arrow.ArrowException) as error:
        raise FormatError(f"{place}: not readable as a table of a batch ({said_by(error)})") from None
    if rows and "schema" not in rows[0]:
        raise FormatError(f"{place}: is no table of a batch; give the batch.parquet that 'ospc batch' wrote")
    return rows


def _arrow(feature: str) -> tuple[Any, Any]:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise MissingExtraError(feature, "parquet") from None
    return pyarrow, parquet


def _written(path: Path, content: bytes) -> Path:
    try:
        return write_atomically(path, content)
    except OSError as error:
        raise FormatError(f"{path}: cannot be written ({error.strerror})") from None
