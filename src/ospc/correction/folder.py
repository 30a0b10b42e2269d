"""The folder of corrected images: a recording in the layout of the TUM monocular data set if exposures are known."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from ospc.atomic import write_atomically
from ospc.errors import OspcError, SettingError, os_error_as
from ospc.folders import check_usable
from ospc.formats.files import json_object, read_bytes, read_text, write_bytes, write_text
from ospc.formats.image_header import with_metadata

NOTE = "correction.json"
"""Describes the correction; every output folder has it, written before the first image."""

SCHEMA = "ospc-correction/2"

_DONE = "written.txt"
"""The images of an unfinished folder that are whole: index and counts, a line each."""

_PARAMETERS = ("pcalib.txt", "pcalib_16bit.txt", "vignette.png")
_GEOMETRY = ("camera.txt", "groundtruthSync.txt")

_ENCODING = {
    ".png": [cv2.IMWRITE_PNG_COMPRESSION, 1],
    ".tif": [cv2.IMWRITE_TIFF_COMPRESSION, 1],
    ".tiff": [cv2.IMWRITE_TIFF_COMPRESSION, 1],
    ".jpg": [cv2.IMWRITE_JPEG_QUALITY, 97],
    ".jpeg": [cv2.IMWRITE_JPEG_QUALITY, 97],
}
"""PNG: higher zlib levels take several times as long for files a few per cent smaller. TIFF: 1 is the tag's value
for uncompressed. JPEG: the quantisation error is about one grey level."""


class Counts(NamedTuple):
    """Values of an image over all channels: how many there are, are saturated, and are beyond the output's range."""

    values: int
    saturated: int
    clipped: int


@dataclass(frozen=True)
class CorrectedFolder:
    """A folder for corrected images; make one with :meth:`at`.

    A folder whose note says that it is unfinished has no ``times.txt``, and nothing opens it as a recording.
    """

    path: Path

    @classmethod
    def at(cls, path: str | Path, recording: Path, *, force: bool = False) -> CorrectedFolder:
        """Check a folder before the work begins, without changing anything.

        SettingError unless it is new, empty, or what an interrupted correction left unfinished; with ``force``,
        finished corrected images may be replaced, too. The folder of the recording itself is refused.
        """
        place = Path(path)
        check_usable(place, recording, lambda place: _check_replaceable(place, force))
        return cls(place)

    def begin(self, note: dict[str, Any], files: Sequence[PurePosixPath]) -> dict[int, Counts]:
        """Prepare the folder: go on with an unfinished one of the same note, otherwise replace what was written.

        The note holds everything that the images depend on, as JSON-compatible values; ``files`` are the images that
        will be written. Returns those that an interrupted correction finished, by their index.
        """
        planned = {"schema": SCHEMA, "finished": False, "files": [str(name) for name in files], **note}
        before = json_object(self.path / NOTE)
        with _writing(self.path, "choose another folder"):
            done = self._done() if before == json.loads(json.dumps(planned)) else {}
            if before and not done:
                # Until everything is removed, the folder must be known as an unfinished one.
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
        """Write an image in the format of its name, with the metadata of its original; threads may share this folder.

        ``modified_ns`` is the file's time of modification; None for now.
        """
        place = self._place(name)
        suffix = name.suffix.lower()
        done, coded = cv2.imencode(suffix, image, _ENCODING.get(suffix, []))
        if not done:
            raise SettingError(f"{place}: the image cannot be encoded")
        with _writing(place, "free some space"):
            write_atomically(place, with_metadata(coded.tobytes(), original), durable=False)
            if modified_ns is not None:
                os.utime(place, ns=(modified_ns, modified_ns))

    def mark_written(self, index: int, counts: Counts) -> None:
        """Note that an image is whole, so that an interrupted correction need not write it again."""
        with _writing(self.path, "free some space"), (self.path / _DONE).open("a", encoding="ascii") as file:
            # The line break comes first: a torn line before it stays on its own.
            file.write(f"\n{index} {counts.values} {counts.saturated} {counts.clipped} .")

    def copy_geometry(self, recording: Path) -> list[str]:
        """Copy camera.txt and groundtruthSync.txt, which stay valid, and return the names of those that exist."""
        copied = []
        for name in _GEOMETRY:
            if (recording / name).is_file():
                try:
                    write_bytes(self.path / name, read_bytes(recording / name))
                except OspcError:
                    continue  # optional: the images do not depend on it
                copied.append(name)
        return copied

    def finish(self, note: dict[str, Any], files: Sequence[PurePosixPath]) -> None:
        """Write the final note: the folder is complete."""
        self._write_note({"schema": SCHEMA, "finished": True, "files": [str(name) for name in files], **note})
        (self.path / _DONE).unlink(missing_ok=True)

    def _place(self, name: PurePosixPath) -> Path:
        return self.path / "images" / name

    def _write_note(self, content: dict[str, Any]) -> None:
        write_text(self.path / NOTE, json.dumps(content, indent=1, allow_nan=False) + "\n")

    def _done(self) -> dict[int, Counts]:
        """Return the finished images; torn lines, which do not end with a full stop, do not count."""
        if not (self.path / _DONE).is_file():
            return {}
        whole = re.findall(r"^(\d+) (\d+) (\d+) (\d+) \.$", read_text(self.path / _DONE), re.ASCII | re.MULTILINE)
        return {int(index): Counts(*map(int, counts)) for index, *counts in whole}

    def _written(self, note: dict[str, Any]) -> list[Path]:
        """Return what an earlier correction wrote; all other files stay."""
        images = [PurePosixPath(str(name)) for name in note.get("files", [])]
        inside = [self._place(name) for name in images if not name.is_absolute() and ".." not in name.parts]
        # times.txt first: a half-removed recording must not look like a whole one.
        return [self.path / name for name in ("times.txt", _DONE, *_PARAMETERS, *_GEOMETRY)] + inside


def _writing(place: Path, remedy: str) -> AbstractContextManager[None]:
    return os_error_as(SettingError, f"{place}: cannot be written", remedy)


def _check_replaceable(place: Path, force: bool) -> None:
    if not any(place.iterdir()):
        return
    note = json_object(place / NOTE)
    if note.get("schema") != SCHEMA:
        raise SettingError(f"{place}: holds something other than corrected images; choose another folder")
    if note.get("finished") is not False and not force:
        raise SettingError(f"{place}: holds corrected images already; choose another folder, or add --force")
