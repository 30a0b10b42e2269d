"""Writes a recording in the layout of the TUM monocular dataset, and its truth beside it."""

from __future__ import annotations

import json
import re
import zipfile
from pathlib import Path
from types import TracebackType

import cv2
import numpy as np

from ospc.arrays import Image
from ospc.errors import SettingError
from ospc.simulation.settings import SimulationSettings
from ospc.simulation.truth import Truth

_PNG_COMPRESSION = 1
_IMAGE = re.compile(r"\d{5,}\.(png|jpg)")
_FILES = (
    "times.txt",
    "camera.txt",
    "groundtruthSync.txt",
    "pcalib.txt",
    "vignette.png",
    "truth.json",
    "images.zip",
)


class ImageWriter:
    """Writes numbered images into ``images/`` or ``images.zip``; to be used in a with statement."""

    def __init__(self, folder: Path, settings: SimulationSettings) -> None:
        self._folder = folder / "images"
        self._suffix = "." + settings.image_format
        self._parameters = (
            [cv2.IMWRITE_JPEG_QUALITY, settings.jpg_quality]
            if settings.image_format == "jpg"
            else [cv2.IMWRITE_PNG_COMPRESSION, _PNG_COMPRESSION]
        )
        self._archive = zipfile.ZipFile(folder / "images.zip", "w") if settings.archive else None
        if self._archive is None:
            self._folder.mkdir()

    def write(self, index: int, image: Image) -> None:
        """Write one image.

        Raises
        ------
        OSError
            If that fails.
        """
        done, coded = cv2.imencode(self._suffix, image, self._parameters)
        if not done:
            raise OSError(f"image {index} could not be coded")
        name = frame_name(index) + self._suffix
        if self._archive is None:
            (self._folder / name).write_bytes(coded.tobytes())
        else:
            # A fixed date keeps archives of the same recording identical.
            self._archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), coded.tobytes())

    def __enter__(self) -> ImageWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._archive is not None:
            self._archive.close()


def frame_name(index: int) -> str:
    """Return a frame's id: all digits, as the readers of times.txt ask for."""
    return f"{index:05d}"


def write_truth(folder: Path, truth: Truth) -> None:
    """Write times.txt, camera.txt, groundtruthSync.txt and the true pcalib.txt, vignette.png and truth.json."""
    width, height = truth.settings.size
    focal = truth.settings.focal_px
    times = zip(truth.stamps_s, truth.metadata_exposures_ms, strict=True)
    _write(folder / "times.txt", [f"{frame_name(i)} {stamp:.9f} {e:.9g}" for i, (stamp, e) in enumerate(times)])
    _write(
        folder / "camera.txt",
        [
            f"Pinhole {focal:.9g} {focal:.9g} {(width - 1) / 2} {(height - 1) / 2} 0",
            f"{width} {height}",
            "none",
            f"{width} {height}",
        ],
    )
    poses = zip(truth.stamps_s, truth.trajectory, strict=True)
    _write(
        folder / "groundtruthSync.txt",
        [f"{stamp:.9f} " + " ".join(f"{value:.9f}" for value in pose) for stamp, pose in poses],
    )
    inverse = truth.response.resampled(256) * 255
    _write(folder / "pcalib.txt", [" ".join(f"{value:.12g}" for value in inverse)])
    attenuation = truth.vignette.image()
    levels = np.rint(attenuation / attenuation.max() * 65535)
    done, coded = cv2.imencode(".png", np.clip(levels, 1, 65535).astype(np.uint16))
    if not done:
        raise OSError("the vignette could not be coded")
    (folder / "vignette.png").write_bytes(coded.tobytes())
    (folder / "truth.json").write_text(
        json.dumps(truth.as_dict(), indent=1, allow_nan=False) + "\n", encoding="utf-8"
    )


def _write(path: Path, lines: list[str]) -> None:
    path.write_text("\n".join(lines) + "\n", encoding="ascii", newline="\n")


def remove_recording(folder: Path) -> None:
    """Remove an earlier simulated recording, and nothing but what :func:`~ospc.simulation.camera.simulate` writes.

    Parameters
    ----------
    folder
        Where it is; nothing happens if there is nothing or an empty folder.

    Raises
    ------
    SettingError
        If the folder holds something else; nothing is removed then.
    """
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return
    if not (folder / "truth.json").is_file():
        raise SettingError(f"{folder}: is not a simulated recording (no truth.json); remove it yourself")
    images = folder / "images"
    numbered = [p for p in images.iterdir() if _IMAGE.fullmatch(p.name)] if images.is_dir() else []
    written = [folder / name for name in _FILES if (folder / name).is_file()]
    strangers = {*folder.iterdir()} - {images, *written} | ({*images.iterdir()} if images.is_dir() else set()) - {
        *numbered
    }
    if strangers:
        raise SettingError(
            f"{folder}: also holds {sorted(strangers)[0].name}, which no simulation wrote; move it away"
        )
    for path in (*numbered, *written):
        path.unlink()
    if images.is_dir():
        images.rmdir()
