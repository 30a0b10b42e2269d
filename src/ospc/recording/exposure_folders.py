"""Folders named by exposure with images named by time stamp, as in recordings of exposure brackets.

``2.0/1695668703271420672.png`` was exposed for 2 ms. If the images are the raw mosaic of a colour sensor, as they
often are, the green pixels are used, at half the width and height.
"""

from __future__ import annotations

import math
import re
from pathlib import Path, PurePosixPath

import numpy as np

from ospc.errors import RecordingError
from ospc.recording.exposure_units import ExposureUnit, in_seconds
from ospc.recording.frame_table import FrameTable, make_table
from ospc.recording.image_sequence import ImageSequence, open_sequence
from ospc.recording.image_source import FolderImages
from ospc.recording.list_search import lists_in
from ospc.recording.options import DEFAULT, ReadingOptions
from ospc.recording.table_text import is_number

_NAME = re.compile(r"(\d{1,9}(?:\.\d{1,9})?)[ _]?(ns|us|ms|s)?", re.ASCII)


class _ExposureFolders:
    name = "exposure_folders"

    def recognises(self, path: Path) -> bool:
        # A single folder whose name is a number is probably not named by exposure.
        return len(_folders(path)) > 1

    def open(self, path: Path, options: ReadingOptions = DEFAULT) -> ImageSequence:
        folders = _folders(path)
        if not folders:
            raise RecordingError(
                f"{path}: an {self.name} recording has folders of images named by their exposure in ms, such as 2.0"
            )
        exposures_ms = {f"{inner.place.name}/{name}": ms for inner, ms in folders for name in inner.names}
        notes = []
        if any(inner.place.name[-1] != "s" for inner, _ in folders):
            notes.append(f"{path}: folder names without a unit are assumed to be exposures in ms")
        source = FolderImages(path, tuple(exposures_ms))
        return open_sequence(
            path, self.name, source, lambda: _table(path, exposures_ms), notes, options=options, take_green=True
        )


def _folders(path: Path) -> list[tuple[FolderImages, float]]:
    """Return the folders of images named by exposure, with their exposures in ms."""
    # A folder with a list of exposures is a recording itself, and its name is only a number.
    found = []
    for inner in sorted(path.iterdir()) if path.is_dir() else ():
        match = _NAME.fullmatch(inner.name)
        exposure_ms = float(ExposureUnit(match[2] or "ms").to_ms(float(match[1]))) if match else 0.0
        if exposure_ms <= 0 or not inner.is_dir() or lists_in(inner):
            continue
        if (images := FolderImages.of(inner)).names:
            found.append((images, exposure_ms))
    return found


def _table(path: Path, exposures_ms: dict[str, float]) -> FrameTable:
    """Return the images of all folders in the order of their time stamps."""
    stamps: dict[str, float] = {}
    for name in exposures_ms:
        stem = PurePosixPath(name).stem
        if not is_number(stem) or not math.isfinite(float(stem)):
            raise RecordingError(f"{path / name}: is not named by its time stamp; rename or remove it")
        stamps[name] = float(stem)
    order = sorted(stamps, key=stamps.__getitem__)
    stamps_s, notes = in_seconds(np.array([stamps[name] for name in order]), str(path))
    return make_table(str(path), order, stamps_s, [exposures_ms[name] for name in order], notes)


KIND = _ExposureFolders()
