"""The state of a run over a recording: one file from which it goes on, and from which it can be merged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from ospc.errors import FormatError
from ospc.state import container
from ospc.state.container import Array, Container
from ospc.state.values import layout, pack, unpack

KIND, VERSION = "calibrator", 3
"""What the files claim to hold."""

T = TypeVar("T")
Run = TypeVar("Run")


@dataclass(frozen=True)
class SavedRun(Generic[Run]):
    """A file's content, of which the larger parts are unpacked when asked for.

    Attributes
    ----------
    name
        What to call the file in messages.
    run
        What the run knows beside its method.
    version
        Version of ospc that wrote it.
    """

    name: str
    run: Run
    version: str
    _content: dict[str, Any] = field(repr=False)
    _arrays: Mapping[str, Array] = field(repr=False)

    def method(self, kind: type[T]) -> T | None:
        """Return the state of the method, None where no frame had been usable.

        Raises
        ------
        FormatError
            If another version of the method made it.
        """
        if self._content.get("method") is None:
            return None
        if self._content.get("layout") != layout(kind):
            raise FormatError(
                f"{self.name}: was made by another version of the method (ospc {self.version}) and cannot be "
                "continued; start anew from the recording"
            )

        return _part(self.name, self._content["method"], kind, self._arrays)


def save_run(path: str | Path, run: object, method: object | None, summary: object | None = None) -> Path:
    """Write a state, whole or not at all, and return its path.

    Raises
    ------
    FormatError
        If it cannot be written; an earlier file is unchanged then.
    """
    content: dict[str, Any] = {"method": None, "layout": "", "summary": None}
    arrays: dict[str, Array] = {}
    for part, value in (("run", run), ("method", method), ("summary", summary)):
        if value is not None:
            content[part], found = pack(value, part)
            arrays |= found
    if method is not None:
        content["layout"] = layout(type(method))
    return container.save(Container(KIND, VERSION, content, arrays), path)


def load_run(path: str | Path, kind: type[Run]) -> SavedRun[Run]:
    """Read what :func:`save_run` wrote.

    Raises
    ------
    FormatError
        If there is no such file, or it is torn, damaged, none of this kind, or of another version.
    """
    found = container.load(path, KIND, VERSION)
    run = _part(str(path), found.content.get("run"), kind, found.arrays)
    version = str(getattr(run, "versions", {}).get("ospc", "unknown"))
    return SavedRun(str(path), run, version, found.content, found.arrays)


def load_summary(path: str | Path, kind: type[T]) -> T | None:
    """Read what a run can be merged by; None where there is none, as in a checkpoint of a run that did not end.

    Raises
    ------
    FormatError
        If there is no such file, or it is torn, damaged, none of this kind, or of another version.
    """
    found = container.load(path, KIND, VERSION)
    content = found.content.get("summary")
    return None if content is None else _part(str(path), content, kind, found.arrays)


def _part(name: str, content: Any, kind: type[T], arrays: Mapping[str, Array]) -> T:
    try:
        return unpack(kind, content, arrays)
    except FormatError as error:
        raise FormatError(f"{name}: not readable as a state, {error}") from None
