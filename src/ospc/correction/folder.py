"""The folder of a corrected recording, in the layout of the TUM monocular data set."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ospc.arrays import ImageSize
from ospc.errors import OspcError, SettingError
from ospc.formats.dso import write_pcalib, write_times, write_vignette
from ospc.formats.files import json_object, read_bytes, write_bytes, write_text
from ospc.formats.pcalib_table import MOST_VALUES
from ospc.photometry.response import Response
from ospc.photometry.vignette import RasterVignette

NOTE = "correction.json"
"""Describes the correction; every output folder has it, written before the first image."""

SCHEMA = "ospc-correction/1"

_IMAGE = re.compile(r"\d{5,}\.(png|tiff)")
_PARAMETERS = ("pcalib.txt", "pcalib_16bit.txt", "vignette.png")
_GEOMETRY = ("camera.txt", "groundtruthSync.txt")

_PNG_COMPRESSION = 1
"""zlib level from 0 to 9; higher ones take several times as long for files a few per cent smaller."""

_TIFF_UNCOMPRESSED = 1
"""Value of the TIFF tag Compression."""


@dataclass(frozen=True)
class CorrectedFolder:
    """A folder for a corrected recording; make one with :meth:`at`.

    ``times.txt`` is written last: a folder without it is unfinished, and nothing opens it as a recording.

    Attributes
    ----------
    path
        The folder.
    """

    path: Path

    @classmethod
    def at(cls, path: str | Path, recording: Path, *, force: bool = False) -> CorrectedFolder:
        """Check a folder before the work begins, without changing anything.

        Parameters
        ----------
        path
            A new or empty folder, or one that an interrupted correction left unfinished.
        recording
            The recording to correct; its own folder is refused.
        force
            Whether a finished corrected recording may be replaced, too.

        Raises
        ------
        SettingError
            If the folder is none of these, or cannot be used.
        """
        place = Path(path)
        try:
            if place.resolve() in (recording.resolve(), (recording / "images").resolve()):
                raise SettingError(f"{place}: holds the recording itself; choose another output folder")
            if place.exists() and not place.is_dir():
                raise SettingError(f"{place}: is a file; choose a folder for the output")
            if place.is_dir() and any(place.iterdir()):
                _check_replaceable(place, force)
        except OSError as error:
            raise SettingError(f"{place}: cannot be used for output ({error.strerror}); choose another") from None
        return cls(place)

    def begin(self, note: dict[str, Any]) -> None:
        """Create the folder, remove an earlier corrected recording from it, and write the note.

        Raises
        ------
        SettingError
            If that fails.
        """
        try:
            for path in _written_before(self.path):
                path.unlink()
            (self.path / "images").mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise SettingError(f"{self.path}: cannot be written ({error.strerror}); choose another folder") from None
        self.write_note(note)

    def write_note(self, note: dict[str, Any]) -> None:
        """Write the description of the correction."""
        content = {"schema": SCHEMA, **note}
        write_text(self.path / NOTE, json.dumps(content, indent=1, allow_nan=False) + "\n")

    def write_image(self, index: int, image: npt.NDArray[np.generic]) -> None:
        """Write the image of a frame; safe to call from several threads.

        Raises
        ------
        SettingError
            If that fails, as on a full disk.
        """
        floats = image.dtype == np.float32
        suffix = ".tiff" if floats else ".png"
        options = (
            [cv2.IMWRITE_TIFF_COMPRESSION, _TIFF_UNCOMPRESSED]
            if floats
            else [cv2.IMWRITE_PNG_COMPRESSION, _PNG_COMPRESSION]
        )
        place = self.path / "images" / f"{index:05d}{suffix}"
        done, coded = cv2.imencode(suffix, image, options)
        if not done:
            raise SettingError(f"{place}: the image cannot be encoded")
        try:
            with place.open("wb") as file:
                file.write(coded.data)
        except OSError as error:
            raise SettingError(f"{place}: cannot be written ({error.strerror}); free some space") from None

    def write_linear_parameters(self, size: ImageSize, max_grey: int) -> None:
        """Write the response and vignette of the corrected images: linear, and 1 everywhere."""
        linear = Response(np.linspace(0.0, 1.0, 256), model={"name": "linear"})
        write_pcalib(linear, self.path / "pcalib.txt")
        if max_grey > 255:
            write_pcalib(linear, self.path / "pcalib_16bit.txt", MOST_VALUES)
        write_vignette(RasterVignette(np.ones((size[1], size[0]), np.float32)), self.path / "vignette.png")

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

    def write_times(self, ids: Sequence[int], stamps_s: npt.ArrayLike, exposures_ms: npt.ArrayLike) -> None:
        """Write times.txt, which makes the folder a recording."""
        write_times(self.path / "times.txt", ids, stamps_s, exposures_ms)


def _check_replaceable(place: Path, force: bool) -> None:
    note = json_object(place / NOTE)
    if note.get("schema") != SCHEMA:
        raise SettingError(f"{place}: holds something other than a corrected recording; choose another folder")
    if note.get("finished") is not False and not force:
        raise SettingError(f"{place}: holds an earlier corrected recording; choose another folder, or add --force")


def _written_before(place: Path) -> list[Path]:
    """Return the files of an earlier corrected recording; all others stay."""
    images = place / "images"
    numbered = [p for p in images.iterdir() if _IMAGE.fullmatch(p.name)] if images.is_dir() else []
    # times.txt first: a half-removed recording must not look like a whole one.
    return [p for name in ("times.txt", *_PARAMETERS, *_GEOMETRY) if (p := place / name).is_file()] + numbered
