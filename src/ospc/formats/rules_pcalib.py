"""The rules for pcalib.txt, the inverse response as a table on one line."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ospc.arrays import Float32Array
from ospc.formats.dso import FEWEST_VALUES, MOST_VALUES
from ospc.formats.files import read_text
from ospc.formats.findings import UNCORRECTED, Context, Finding
from ospc.formats.scanning import leading_numbers

_REPAIR = "run with --repair for a mended copy"


def check_pcalib(path: Path, context: Context) -> Iterator[Finding]:
    """Give what is to be said about a pcalib.txt.

    Raises
    ------
    FormatError
        If the file cannot be read.
    """
    name, program = str(path), context.program
    first_line, *others = read_text(path).split("\n")
    numbers, rest = leading_numbers(first_line)
    with np.errstate(over="ignore"):
        values = numbers.astype(np.float32)
    overflow = np.flatnonzero(~np.isfinite(values))
    if overflow.size:  # a stream stops at a number its type cannot hold, too
        values, rest = values[: overflow[0]], f"{numbers[overflow[0]]:g}"

    yield from _about_text(name, values.size, rest, others)
    refusal = _count_refused(values.size, context)
    if refusal:
        remedy = "put all values on the first line" if values.size < 2 and any(map(str.strip, others)) else ""
        resample = f"{_REPAIR} resampled to {FEWEST_VALUES} values" if values.size > FEWEST_VALUES else ""
        fallback = "write the value of every grey level, separated by spaces"
        yield Finding("error", name, refusal, UNCORRECTED[program], remedy or resample or fallback)
    elif values.size > FEWEST_VALUES:
        yield Finding(
            "warning",
            name,
            f"{values.size} values, for images with as many grey levels",
            f"accepts them; but its image reader delivers 8 bits and so uses only the first {FEWEST_VALUES}, "
            f"which are almost black; right only in builds that read deeper images",
            f"{_REPAIR} resampled to {FEWEST_VALUES} values",
        )
    if values.size >= 2:
        yield from _about_order(name, values, context)


def _about_text(name: str, count: int, rest: str, others: list[str]) -> Iterator[Finding]:
    if rest:
        word = rest.split(maxsplit=1)[0][:20]
        yield Finding(
            "warning" if count >= FEWEST_VALUES else "error",
            name,
            f"the first line holds only numbers; {word!r} stands in place {count + 1}",
            f"stops reading there, with {count} values",
            _REPAIR,
        )
    extra = [line.strip() for line in others if line.strip()]
    if extra:
        yield Finding(
            "warning",
            name,
            f"one line; {len(extra)} more follow, the first of them {extra[0][:30]!r}",
            "ignores all but the first line; programs that read the whole file fail or read too many values",
            _REPAIR if count >= FEWEST_VALUES else "",
        )


def _count_refused(count: int, context: Context) -> str:
    """Return why the program refuses this number of values, or an empty string."""
    if context.program == "mono" and count != FEWEST_VALUES:
        return f"exactly {FEWEST_VALUES} values on the first line; there are {count}"
    if count < FEWEST_VALUES:
        return f"at least {FEWEST_VALUES} values on the first line; there are {count}"
    if count > MOST_VALUES:
        return f"at most {MOST_VALUES} values, for which there is memory; there are {count}"
    return ""


def _about_order(name: str, values: Float32Array, context: Context) -> Iterator[Finding]:
    steps = np.diff(values)
    bad = np.flatnonzero(steps <= 0)
    if bad.size:
        falls = int(np.count_nonzero(steps < 0))
        equal = bad.size - falls
        yield Finding(
            "error",
            name,
            f"strictly increasing as 32-bit floats; after grey level {bad[0]} it is not "
            f"({falls} values fall, {equal} equal the one before)",
            UNCORRECTED[context.program],
            _REPAIR if falls else f"write 9 significant digits, or {_REPAIR}",
        )
        return
    span = float(values[-1]) - float(values[0])
    remapped = (255.0 * (values - values[0]).astype(np.float64) / span).astype(np.float32)
    if np.any(np.diff(remapped) <= 0):
        yield Finding(
            "warning",
            name,
            f"strictly increasing after the values are remapped to 0..255; after grey level "
            f"{int(np.argmin(np.diff(remapped)))} it is not",
            "loads it, and divides by zero where it inverts the curve there",
            _REPAIR,
        )
    if values[0] != 0 or values[-1] != 255:
        yield Finding(
            "note",
            name,
            f"values run from {values[0]:g} to {values[-1]:g}",
            "shifts and scales them to 0..255, so that a black level in them is lost",
        )
