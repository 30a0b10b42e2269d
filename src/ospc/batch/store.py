"""The results of a batch on disk: one file of each recording, named by content and settings."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ospc.atomic import write_atomically
from ospc.batch.work import KIND, VERSION
from ospc.errors import FormatError
from ospc.pooling.summary import Summary
from ospc.state import container
from ospc.state.container import Container
from ospc.state.values import unpack

_NAME = re.compile(r"[0-9a-f]{64}\.ospc")


@dataclass(frozen=True)
class Result:
    """What was found of one recording.

    Attributes
    ----------
    key
        Tells content and settings apart from all others.
    calibration
        The calibration as ``calibration.json`` has it.
    summary
        What it can be merged by; None where nothing was learned.
    notes
        What was found of its exposures, and why frames were skipped.
    """

    key: str
    calibration: dict[str, Any]
    summary: Summary | None
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, found: Container, name: str) -> Result:
        """Return what a file holds.

        Raises
        ------
        FormatError
            If it is no result.
        """
        try:
            packed = found.content["summary"]
            summary = None if packed is None else unpack(Summary, packed, found.arrays)
            calibration = json.loads(found.arrays["calibration"].tobytes())
            if not isinstance(calibration, dict):
                raise ValueError("its calibration is none")
            return cls(str(found.content["key"]), calibration, summary, tuple(map(str, found.content["notes"])))
        except (LookupError, TypeError, ValueError, FormatError) as error:
            raise FormatError(f"{name}: not readable as a result of a batch ({error})") from None


@dataclass(frozen=True)
class Store:
    """A folder of results.

    Attributes
    ----------
    folder
        The folder; it need not exist yet.
    """

    folder: Path

    def keys(self) -> set[str]:
        """Return the keys of all results that are there."""
        if not self.folder.is_dir():
            return set()
        return {place.stem for place in self._files()}

    def put(self, key: str, data: bytes) -> Path:
        """Keep a result, whole or not at all, and return its path.

        Raises
        ------
        FormatError
            If it cannot be written, or is no whole result: what comes over a network is looked at first.
        """
        found = container.from_bytes(data, f"the result of {key[:12]}…")
        if (found.kind, found.version, found.content.get("key")) != (KIND, VERSION, key):
            raise FormatError(
                f"the result of {key[:12]}… is not what was asked for; do all workers have one version?"
            )
        place = self._place(key)
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
            return write_atomically(place, data)
        except OSError as error:
            raise FormatError(f"{place}: cannot be written ({error.strerror}); make room and run it again") from None

    def get(self, key: str) -> Result:
        """Return a result.

        Raises
        ------
        FormatError
            If it is not there, damaged, or of another version.
        """
        place = self._place(key)
        return Result.of(container.load(place, KIND, VERSION), str(place))

    def has(self, key: str) -> bool:
        """Tell whether a result is there, whole and of this version; a damaged one is made again."""
        try:
            self.get(key)
        except FormatError:
            return False
        return True

    def _files(self) -> Iterator[Path]:
        return (place for place in self.folder.glob("??/*.ospc") if _NAME.fullmatch(place.name))

    def _place(self, key: str) -> Path:
        # Folders of hundreds of thousands of files are slow in many file systems.
        return self.folder / key[:2] / f"{key}.ospc"
