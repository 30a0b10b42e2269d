"""The state of a run over a recording: one file from which it goes on, and from which it can be merged."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from ospc.errors import FormatError
from ospc.state import container
from ospc.state.container import Array, Container
from ospc.state.values import layout, pack, unpack

KIND, VERSION = "calibrator", 12
"""What the files claim to hold."""

T = TypeVar("T")
Run = TypeVar("Run")


def save_run(path: str | Path, run: object, method: object | None, summary: object | None = None) -> Path:
    """Write a state and return its path; FormatError if that fails, which leaves an earlier file unchanged."""
    content: dict[str, Any] = {"method": None, "layout": "", "summary": None}
    arrays: dict[str, Array] = {}
    for part, value in (("run", run), ("method", method), ("summary", summary)):
        if value is not None:
            content[part], found = pack(value, part)
            arrays |= found
    if method is not None:
        content["layout"] = layout(type(method))
    return container.save(Container(KIND, VERSION, content, arrays), path)


def load_run(path: str | Path, run: type[Run], method: type[T]) -> tuple[Run, T | None]:
    """Read what :func:`save_run` wrote: what the run knows, and the state of its method, None where there is none.

    FormatError as :func:`~ospc.state.container.load`, and for a state of another version of the method.
    """
    found = container.load(path, KIND, VERSION)
    known = _part(str(path), found.content.get("run"), run, found.arrays)
    if found.content.get("method") is None:
        return known, None
    if found.content.get("layout") != layout(method):
        version = getattr(known, "versions", {}).get("ospc", "unknown")
        raise FormatError(
            f"{path}: was made by another version of the method (ospc {version}) and cannot be continued; start anew "
            "from the recording"
        )
    return known, _part(str(path), found.content["method"], method, found.arrays)


def load_summary(path: str | Path, kind: type[T]) -> T | None:
    """Read what a run can be merged by; None where there is none, as in a checkpoint of a run that did not end.

    FormatError as :func:`~ospc.state.container.load`.
    """
    found = container.load(path, KIND, VERSION)
    content = found.content.get("summary")
    return None if content is None else _part(str(path), content, kind, found.arrays)


def _part(name: str, content: Any, kind: type[T], arrays: Mapping[str, Array]) -> T:
    try:
        return unpack(kind, content, arrays)
    except FormatError as error:
        raise FormatError(f"{name}: not readable as a state, {error}") from None
