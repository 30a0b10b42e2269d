"""The results of a batch on disk: one file per recording, named by content and settings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ospc.errors import FormatError
from ospc.formats.files import write_bytes
from ospc.photometry.calibration import Calibration
from ospc.pooling.summary import Summary
from ospc.state import container
from ospc.state.container import Container
from ospc.state.values import pack, unpack

KIND, VERSION = "batch-result", 3
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
