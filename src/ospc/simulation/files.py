"""Writes a simulated recording in the layout of the TUM monocular dataset, with its truth beside it."""

from __future__ import annotations

import json
import re
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import cv2
import numpy as np

from ospc.arrays import Image
from ospc.errors import SettingError
from ospc.formats.dso import write_pcalib, write_vignette
from ospc.simulation.settings import SimulationSettings
from ospc.simulation.truth import Truth

_PNG_COMPRESSION = 1
"""Fastest level of zlib; noise hardly compresses anyway."""

_IMAGE = re.compile(r"\d{5,}\.(png|jpg)")
_FILES = (
    "times.txt", "camera.txt", "groundtruthSync.txt", "truth.json", "pcalib.txt", "vignette.png", "images.zip",
)  # fmt: skip


@contextmanager
def image_writer(folder: Path, settings: SimulationSettings) -> Iterator[Callable[[int, Image], None]]:
    """Give a function that writes numbered images into ``images/`` or ``images.zip``."""
    suffix = f".{settings.image_format}"
    jpg = [cv2.IMWRITE_JPEG_QUALITY, settings.jpg_quality]
    parameters = jpg if settings.image_format == "jpg" else [cv2.IMWRITE_PNG_COMPRESSION, _PNG_COMPRESSION]
    with zipfile.ZipFile(folder / "images.zip", "w") if settings.archive else nullcontext() as archive:
        if archive is None:
            (folder / "images").mkdir()

        def write(index: int, image: Image) -> None:
            done, coded = cv2.imencode(suffix, image, parameters)
            if not done:
                raise OSError(f"image {index} could not be encoded")
            name = frame_name(index) + suffix
            if archive is None:
                (folder / "images" / name).write_bytes(coded.tobytes())
            else:
                # A fixed date keeps archives of the same recording identical.
                archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), coded.tobytes())

        yield write


def frame_name(index: int) -> str:
    """Return the id of a frame: digits only, as readers of times.txt expect."""
    return f"{index:05d}"


def write_truth(folder: Path, truth: Truth) -> None:
    """Write times.txt, camera.txt, groundtruthSync.txt and the true pcalib.txt, vignette.png and truth.json."""
    width, height = truth.settings.size
    focal = f"{truth.settings.focal_px:.9g}"
    size = f"{width} {height}"
    times = enumerate(zip(truth.stamps_s, truth.metadata_exposures_ms, strict=True))
    rows = np.column_stack([truth.stamps_s, truth.trajectory])
    texts = {
        "times.txt": [f"{frame_name(i)} {stamp:.9f} {e:.9g}" for i, (stamp, e) in times],
        "camera.txt": [f"Pinhole {focal} {focal} {(width - 1) / 2} {(height - 1) / 2} 0", size, "none", size],
        "groundtruthSync.txt": [" ".join(f"{value:.9f}" for value in row) for row in rows],
        "truth.json": [json.dumps(truth.as_dict(), indent=1, allow_nan=False)],
    }
    for name, lines in texts.items():
        (folder / name).write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
    write_pcalib(truth.response, folder / "pcalib.txt")
    write_vignette(truth.vignette, folder / "vignette.png")


def remove_recording(folder: Path) -> None:
    """Remove an earlier simulated recording, and nothing but what :func:`~ospc.simulation.camera.simulate` writes.

    Nothing happens if its folder is missing or empty.

    Raises
    ------
    SettingError
        If the folder holds anything else; then nothing is removed.
    """
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return
    if not (folder / "truth.json").is_file():
        raise SettingError(f"{folder}: is not a simulated recording (it has no truth.json); remove it yourself")
    images = folder / "images"
    inside = list(images.iterdir()) if images.is_dir() else []
    written = [folder / name for name in _FILES if (folder / name).is_file()]
    written += [path for path in inside if _IMAGE.fullmatch(path.name)]
    foreign = {*folder.iterdir(), *inside} - {images, *written}
    if foreign:
        raise SettingError(f"{folder}: also holds {min(foreign).name}, which no simulation wrote; move it away")
    for path in written:
        path.unlink()
    if images.is_dir():
        images.rmdir()
