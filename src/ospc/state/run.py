"""The state of a run over a recording: one file to resume from, and to merge with others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from ospc.arrays import ImageSize
from ospc.errors import FormatError
from ospc.state import container
from ospc.state.container import Array, Container
from ospc.state.values import layout, pack, unpack

KIND, VERSION = "calibrator", 3
"""What the files claim to hold."""

T = TypeVar("T")


@dataclass(frozen=True)
class RunState:
    """What a run knows besides the state of its method.

    Attributes
    ----------
    settings
        Name of the preset and all settings.
    size, max_grey
        Size of the frames in pixels, and their largest grey value; (0, 0) and 0 before the first.
    frames
        Frames pushed.
    skipped, reasons
        Number of frames that could not be used, and why the last of them could not.
    first_reasons
        Why the first of them could not.
    first_frames
        Hash over the first usable frames, and how many it covers; it tells live streams apart.
    source
        Identification of the recording, empty for a live stream.
    versions
        Versions of the software that wrote the state.
    """

    settings: dict[str, Any]
    size: ImageSize
    max_grey: int
    frames: int
    skipped: int
    reasons: list[str]
    first_reasons: list[str]
    first_frames: tuple[str, int]
    source: dict[str, Any]
    versions: dict[str, Any]


@dataclass(frozen=True)
class SavedRun:
    """The content of a file; its larger parts are unpacked on demand.

    Attributes
    ----------
    name
        Name of the file for messages.
    run
        All but the method's state.
    """

    name: str
    run: RunState
    _content: dict[str, Any] = field(repr=False)
    _arrays: Mapping[str, Array] = field(repr=False)

    def method(self, kind: type[T]) -> T | None:
        """Return the state of the method; None where there was no usable frame.

        Raises
        ------
        FormatError
            If another version of the method wrote it.
        """
        if self._content.get("method") is None:
            return None
        if self._content.get("layout") != layout(kind):
            made = self.run.versions.get("ospc")
            raise FormatError(
                f"{self.name}: was made by another version of the method (ospc {made}) and cannot be continued; "
                "start anew from the recording"
            )
        return self._part("method", kind)

    def summary(self, kind: type[T]) -> T | None:
        """Return what the run can be merged by; None in a checkpoint of a run that had not ended."""
        return None if self._content.get("summary") is None else self._part("summary", kind)

    def _part(self, part: str, kind: type[T]) -> T:
        try:
            return unpack(kind, self._content[part], self._arrays)
        except FormatError as error:
            raise FormatError(f"{self.name}: not readable as a state, {error}") from None


def save_run(path: str | Path, run: RunState, method: object | None, summary: object | None = None) -> Path:
    """Write a state, whole or not at all, and return its path.

    Raises
    ------
    FormatError
        If it cannot be written; an earlier file is unchanged then.
    """
    content: dict[str, Any] = {"run": pack(run)[0], "method": None, "layout": "", "summary": None}
    arrays: dict[str, Array] = {}
    for part, value in (("method", method), ("summary", summary)):
        if value is not None:
            content[part], found = pack(value, part)
            arrays |= found
    if method is not None:
        content["layout"] = layout(type(method))
    return container.save(Container(KIND, VERSION, content, arrays), path)


def load_run(path: str | Path) -> SavedRun:
    """Read what :func:`save_run` wrote.

    Raises
    ------
    FormatError
        If there is no such file, or it is torn, damaged, none of this kind, or of another version.
    """
    found = container.load(path, KIND, VERSION)
    try:
        run = unpack(RunState, found.content.get("run"), found.arrays)
    except FormatError as error:
        raise FormatError(f"{path}: not readable as a state, {error}") from None
    return SavedRun(str(path), run, found.content, found.arrays)
