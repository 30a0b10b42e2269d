"""What odometry reads: a recording in the monocular layout with the files of one condition."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ospc.errors import RecordingError, SettingError
from ospc.formats.dso import write_pcalib, write_times, write_vignette
from ospc.formats.opening import Photometry
from ospc.odometry.conditions import Condition
from ospc.recording import Recording
from ospc.recording.identity import identity
from ospc.recording.writing.conversion import convert_recording

CAMERA, TIMES, PCALIB, VIGNETTE = "camera.txt", "times.txt", "pcalib.txt", "vignette.png"
_SUFFIXES = (".png", ".jpg", ".jpeg")


@dataclass(frozen=True)
class OdometryInput:
    """A recording under a condition.

    Attributes
    ----------
    recording
        The recording; its folder has a camera.txt.
    images
        Folder that holds its images and nothing else, one file a frame, in temporal order by name.
    condition
        How it is to be seen.
    photometry
        Response and vignette; None where the condition needs none.
    """

    recording: Recording
    images: Path
    condition: Condition
    photometry: Photometry | None

    @property
    def exposures_ms(self) -> Any:
        """Exposures that odometry is told, shape (frames,)."""
        exposures = np.asarray(self.recording.exposures_ms)
        return exposures if self.condition.metadata_exposures else np.ones_like(exposures)

    def fingerprint(self) -> dict[str, Any]:
        """Return what results depend on: recording, camera, mode, and a hash of each parameter."""
        described: dict[str, Any] = {
            "recording": identity(self.recording) | {"name": ""},
            "camera": _hash(camera_file(self.recording).read_bytes()),
            "mode": self.condition.mode,
            "metadata_exposures": self.condition.metadata_exposures,
        }
        if self.photometry is not None:
            response, vignette = self.photometry.response, self.photometry.vignette
            described["response"] = None if response is None else _hash(response.resampled(256).tobytes())
            described["vignette"] = None if vignette is None else _hash(vignette.image().tobytes())
        return described

    @contextmanager
    def folder(self) -> Iterator[Path]:
        """Give a temporary folder with images (a link), times.txt, camera.txt and the condition's parameter files.

        Programs are to be started within it and to be given relative paths: DSO ends a path at its first blank.
        """
        with TemporaryDirectory(prefix="ospc-odometry-") as name:
            place = Path(name)
            (place / "images").symlink_to(self.images.resolve(), target_is_directory=True)
            shutil.copyfile(camera_file(self.recording), place / CAMERA)
            count = len(self.recording)
            write_times(place / TIMES, range(count), self.recording.stamps_s, self.exposures_ms)
            if self.photometry is not None and self.photometry.response is not None:
                write_pcalib(self.photometry.response, place / PCALIB)
            if self.photometry is not None and self.photometry.vignette is not None:
                write_vignette(self.photometry.vignette, place / VIGNETTE)
            yield place


def camera_file(recording: Recording) -> Path:
    """Return the path of a recording's camera.txt.

    Raises
    ------
    RecordingError
        If there is none.
    """
    place = recording.path / CAMERA
    if not place.is_file():
        raise RecordingError(f"{recording.path}: has no {CAMERA}; odometry needs the camera's geometry")
    return place


def images_of(recording: Recording, cache: Path) -> Path:
    """Return a folder with a recording's images as odometry reads them, one file a frame.

    That is its own folder ``images`` where that holds just the frames; otherwise they are written below ``cache``.

    Raises
    ------
    SettingError
        If they cannot be written.
    """
    own = recording.path / "images"
    if own.is_dir() and recording.max_grey == 255:
        entries = list(own.iterdir())
        if len(entries) == len(recording) and all(p.suffix.lower() in _SUFFIXES for p in entries):
            return own
    place = cache / ("images-" + _hash(repr(sorted(identity(recording).items())).encode())[:16])
    if (place / TIMES).is_file():
        return place / "images"
    try:
        if place.exists():
            shutil.rmtree(place)
        place.mkdir(parents=True)
    except OSError as error:
        raise SettingError(f"{place}: cannot be written ({error.strerror}); choose another folder") from None
    made = convert_recording(recording, place)
    if made.frames != len(recording):
        raise RecordingError(
            f"{recording.path}: {made.skipped} of its {len(recording)} images cannot be read; odometry needs them all"
        )
    return place / "images"


def _hash(content: bytes) -> str:
    return sha256(content).hexdigest()
