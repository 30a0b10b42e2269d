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
from ospc.errors import FormatError, OspcError, SettingError
from ospc.formats.dso import write_pcalib, write_times, write_vignette
from ospc.formats.files import read_bytes, read_text, write_bytes, write_text
from ospc.formats.rules_pcalib import MOST_VALUES
from ospc.photometry.response import Response
from ospc.photometry.vignette import RasterVignette

NOTE = "correction.json"
"""Says what was done; every folder written here has it, from before the first image on."""

SCHEMA = "ospc-correction/1"

_IMAGE = re.compile(r"\d{5,}\.(png|tiff)")
_PARAMETERS = ("pcalib.txt", "pcalib_16bit.txt", "vignette.png")
_GEOMETRY = ("camera.txt", "groundtruthSync.txt")
_PNG_COMPRESSION = 1
_TIFF_UNCOMPRESSED = 1


@dataclass(frozen=True)
class CorrectedFolder:
    """A folder that a corrected recording can be written to; make one with :meth:`at`.

    ``times.txt`` comes last: a folder without it is not finished, and nothing opens it as a recording.

    Attributes
    ----------
    path
        The folder.
    """

    path: Path

    @classmethod
    def at(cls, path: str | Path, recording: Path, *, force: bool = False) -> CorrectedFolder:
        """Check a folder before the work begins; nothing is changed yet.

        Parameters
        ----------
        path
            A new or empty folder.
        recording
            The recording that is corrected; its own folder is refused.
        force
            Whether an earlier corrected recording will do, too; it is then replaced.

        Raises
        ------
        SettingError
            If it is none of these, or cannot be used.
        """
        place = Path(path)
        try:
            if place.resolve() in (recording.resolve(), (recording / "images").resolve()):
                raise SettingError(f"{place}: holds the recording itself; choose another folder for the output")
            if place.exists() and not place.is_dir():
                raise SettingError(f"{place}: is a file; name a folder for the output")
            if place.is_dir() and any(place.iterdir()):
                _check_replaceable(place, force)
        except OSError as error:
            raise SettingError(f"{place}: cannot be used for output ({error.strerror}); choose another") from None
        return cls(place)

    def begin(self, note: dict[str, Any]) -> None:
        """Make the folder, remove an earlier corrected recording from it, and write the note.

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
        """Write what was done, or is being done."""
        content = {"schema": SCHEMA, **note}
        write_text(self.path / NOTE, json.dumps(content, indent=1, allow_nan=False) + "\n")

    def write_image(self, index: int, image: npt.NDArray[np.generic]) -> None:
        """Write the image of a frame; several threads may do so at the same time.

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
            raise SettingError(f"{place}: the image cannot be coded")
        try:
            with place.open("wb") as file:
                file.write(coded.data)
        except OSError as error:
            raise SettingError(f"{place}: cannot be written ({error.strerror}); free some space") from None

    def write_linear_parameters(self, size: ImageSize, max_grey: int) -> None:
        """Write the response and vignette that the images have now: linear, and none."""
        linear = Response(np.linspace(0.0, 1.0, 256), model={"name": "linear"})
        write_pcalib(linear, self.path / "pcalib.txt")
        if max_grey > 255:
            write_pcalib(linear, self.path / "pcalib_16bit.txt", MOST_VALUES)
        write_vignette(RasterVignette(np.ones((size[1], size[0]), np.float32)), self.path / "vignette.png")

    def copy_geometry(self, recording: Path) -> list[str]:
        """Copy camera.txt and groundtruthSync.txt, which the correction leaves true, and return what there was."""
        copied = []
        for name in _GEOMETRY:
            if (recording / name).is_file():
                try:
                    write_bytes(self.path / name, read_bytes(recording / name))
                except OspcError:
                    continue  # a convenience: the images do not depend on it
                copied.append(name)
        return copied

    def write_times(self, ids: Sequence[int], stamps_s: npt.ArrayLike, exposures_ms: npt.ArrayLike) -> None:
        """Write times.txt, which makes the folder a recording."""
        write_times(self.path / "times.txt", ids, stamps_s, exposures_ms)


def _check_replaceable(place: Path, force: bool) -> None:
    try:
        note = json.loads(read_text(place / NOTE))
        ours = isinstance(note, dict) and note.get("schema") == SCHEMA
    except (FormatError, ValueError, RecursionError):
        ours = False
    if not ours:
        raise SettingError(f"{place}: holds something else than a corrected recording; choose another folder")
    if not force:
        raise SettingError(f"{place}: holds an earlier corrected recording; choose another folder, or add --force")


def _written_before(place: Path) -> list[Path]:
    """Return the files of an earlier corrected recording; others in the folder are not ours to remove."""
    images = place / "images"
    numbered = [p for p in images.iterdir() if _IMAGE.fullmatch(p.name)] if images.is_dir() else []
    # times.txt first: what is half removed must not look like a recording.
    return [p for name in ("times.txt", *_PARAMETERS, *_GEOMETRY) if (p := place / name).is_file()] + numbered
