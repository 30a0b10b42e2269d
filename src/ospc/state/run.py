"""The state of a run over a recording: a file to continue the run from, and to merge it with others."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from ospc.errors import FormatError
from ospc.state import container
from ospc.state.container import Array, Container
from ospc.state.values import layout, pack, unpack

KIND, VERSION = "calibrator", 29
"""Kind and version of the files."""

T = TypeVar("T")
Run = TypeVar("Run")


def save_run(path: str | Path, run: object, method: object | None, summary: object | None) -> Path:
    """Write a state atomically and return its path; FormatError if that fails."""
    content: dict[str, Any] = {"method": None, "layout": "", "summary": None}
    arrays: dict[str, Array] = {}
    for part, value in (("run", run), ("method", method), ("summary", summary)):
        if value is not None:
            content[part], found = pack(value, part)
            arrays |= found
    if method is not None:
        content["layout"] = layout(type(method))
    return container.save(Container(KIND, VERSION, content, arrays), path)


def load_run(path: str | Path, run: type[Run], method_of: Callable[[Run], type[T] | None]) -> tuple[Run, T | None]:
    """Read the file of :func:`save_run`: the state of the run, and of its method, None if it has none.

    ``method_of`` returns the class of the method's state, given the state of the run.

    Raises
    ------
    FormatError
        As for :func:`~ospc.state.container.load`, or if the state is from another version of the method.
    """
    found = container.load(path, KIND, VERSION)
    known = unpack(run, found.content.get("run"), found.arrays, str(path))
    if found.content.get("method") is None:
        return known, None
    method = method_of(known)
    if method is None or found.content.get("layout") != layout(method):
        version = getattr(known, "versions", {}).get("ospc", "unknown")
        raise FormatError(
            f"{path}: was written by another version of the method (ospc {version}) and cannot be continued; start "
            "again from the recording"
        )
    return known, unpack(method, found.content["method"], found.arrays, str(path))


def load_summary(path: str | Path, kind: type[T]) -> T | None:
    """Read the summary for merging; None if there is none, as in a checkpoint of an unfinished run.

    Raises
    ------
    FormatError
        As for :func:`~ospc.state.container.load`.
    """
    found = container.load(path, KIND, VERSION)
    content = found.content.get("summary")
    return None if content is None else unpack(kind, content, found.arrays, str(path))
