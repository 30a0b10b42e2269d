"""The folder of corrected images. With known exposures, it has the layout of the TUM monocular data set."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from ospc.errors import OspcError
from ospc.formats.files import json_object, json_text, read_bytes, read_text, write_bytes, write_text
from ospc.formats.image_files import encoded
from ospc.formats.image_header import with_metadata
from ospc.recording import Recording
from ospc.recording.writing.conversion import camera_text
from ospc.system.atomic import write_atomically
from ospc.system.folders import Content, check_usable, writing

NOTE = "correction.json"
"""Describes the correction. Every output folder has it; it is written before the first image."""

SCHEMA = "ospc-correction/2"

_DONE = "written.txt"
"""The complete images of an unfinished folder: index and counts, one line each."""

_BESIDE_IMAGES = ("pcalib.txt", "pcalib_16bit.txt", "vignette.png", "camera.txt", "groundtruthSync.txt")
_PNG_COMPRESSION = 1
"""The fastest level of zlib that uses its usual strategy."""


class Counts(NamedTuple):
    """Number of values of an image in all channels, and how many are saturated or exceed the range of the output."""

    values: int
    saturated: int
    clipped: int


@dataclass(frozen=True)
class CorrectedFolder:
    """A folder for corrected images, checked by :meth:`at`.

    An unfinished folder, as stated in its note, has no ``times.txt``, so that it is not opened as a recording.
    """

    path: Path

    @classmethod
    def at(cls, path: str | Path, recording: Path, *, force: bool = False) -> CorrectedFolder:
        """Check a folder without changing anything.

        It may be new, empty, or left unfinished by an interrupted correction. With ``force``, finished corrected
        images may also be replaced. The folder of the recording is always refused.

        Raises
        ------
        SettingError
            If the folder cannot be used.
        """
        place = Path(path)
        check_usable(place, recording, _content, force=force)
        return cls(place)

    def begin(self, note: dict[str, Any], files: Sequence[PurePosixPath]) -> dict[int, Counts]:
        """Prepare the folder: continue an unfinished correction with the same note, or remove an earlier one.

        ``note`` has everything that the images depend on, as JSON-compatible values; ``files`` are the images to be
        written. Returns the counts of the images that an interrupted correction has finished, by index.
        """
        planned = {"schema": SCHEMA, "finished": False, "files": [str(name) for name in files], **note}
        before = json_object(self.path / NOTE)
        with writing(self.path):
            done = self._done() if before == json.loads(json.dumps(planned)) else {}
            if before and not done:
                # The folder counts as unfinished until everything is removed.
                self._write_note(before | {"finished": False})
                for path in self._written(before):
                    path.unlink(missing_ok=True)
            self.path.mkdir(parents=True, exist_ok=True)
            self._write_note(planned)
            for folder in {self._place(name).parent for name in files}:
                folder.mkdir(parents=True, exist_ok=True)
        return done

    def write_image(
        self, name: PurePosixPath, image: npt.NDArray[np.generic], original: bytes, modified_ns: int | None
    ) -> None:
        """Write an image in the format of its name, with the metadata of its original; thread-safe.

        ``modified_ns`` becomes the modification time of the file; None for the current time.
        """
        place = self._place(name)
        data = encoded(image, name.suffix.lower(), str(place), png_compression=_PNG_COMPRESSION)
        with writing(place):
            write_atomically(place, with_metadata(data, original), durable=False)
            if modified_ns is not None:
                os.utime(place, ns=(modified_ns, modified_ns))

    def mark_written(self, index: int, counts: Counts) -> None:
        """Record that an image is complete, so that it need not be written again after an interruption."""
        with writing(self.path), (self.path / _DONE).open("a", encoding="ascii") as file:
            # The line break comes first, so that a truncated line before it stays separate.
            file.write(f"\n{index} {counts.values} {counts.saturated} {counts.clipped} .")

    def copy_geometry(self, recording: Recording) -> list[str]:
        """Copy camera.txt, if it is for images of this size, and groundtruthSync.txt, and return their names."""
        copied = []
        text, _ = camera_text(recording)
        if text is not None:
            write_text(self.path / "camera.txt", text)
            copied.append("camera.txt")
        truth = recording.path / "groundtruthSync.txt"
        if truth.is_file():
            with suppress(OspcError):  # optional: the images do not depend on it
                write_bytes(self.path / truth.name, read_bytes(truth))
                copied.append(truth.name)
        return copied

    def finish(self, note: dict[str, Any], files: Sequence[PurePosixPath]) -> None:
        """Write the final note, which marks the folder as complete."""
        self._write_note({"schema": SCHEMA, "finished": True, "files": [str(name) for name in files], **note})
        (self.path / _DONE).unlink(missing_ok=True)

    def _place(self, name: PurePosixPath) -> Path:
        return self.path / "images" / name

    def _write_note(self, content: dict[str, Any]) -> None:
        write_text(self.path / NOTE, json_text(content) + "\n")

    def _done(self) -> dict[int, Counts]:
        """Return the finished images; truncated lines, which do not end with a full stop, are ignored."""
        if not (self.path / _DONE).is_file():
            return {}
        whole = re.findall(r"^(\d+) (\d+) (\d+) (\d+) \.$", read_text(self.path / _DONE), re.ASCII | re.MULTILINE)
        return {int(index): Counts(*map(int, counts)) for index, *counts in whole}

    def _written(self, note: dict[str, Any]) -> list[Path]:
        """Return the files of an earlier correction."""
        images = [PurePosixPath(str(name)) for name in note.get("files", [])]
        inside = [self._place(name) for name in images if not name.is_absolute() and ".." not in name.parts]
        # times.txt first: a partly removed recording must not look complete.
        return [self.path / name for name in ("times.txt", _DONE, *_BESIDE_IMAGES)] + inside


def _content(place: Path) -> Content:
    note = json_object(place / NOTE)
    if note.get("schema") != SCHEMA:
        return Content("contains other files than corrected images", "never")
    allowed: Literal["always", "with force"] = "always" if note.get("finished") is False else "with force"
    return Content("contains corrected images", allowed, earlier_output=True)
