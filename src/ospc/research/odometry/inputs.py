"""The input of odometry: a recording in the layout of the monocular data set, with the files of one condition."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import RecordingError, SettingError, counted
from ospc.formats.dso import write_pcalib, write_times, write_vignette
from ospc.formats.opening import Photometry
from ospc.recording import Recording
from ospc.recording.identity import identity
from ospc.recording.writing.conversion import convert_recording
from ospc.research.method import Estimate
from ospc.research.odometry.conditions import Condition
from ospc.research.source import PCALIB, VIGNETTE, fingerprints
from ospc.research.store import key_of

CAMERA, TIMES, TRUTH = "camera.txt", "times.txt", "groundtruthSync.txt"
_NEEDED_FOR = {
    CAMERA: "odometry needs the camera's geometry",
    TRUTH: "errors of trajectories need the truth",
}
_SUFFIXES = (".png", ".jpg", ".jpeg")


@dataclass(frozen=True)
class OdometryInput:
    """A recording under a condition.

    Attributes
    ----------
    place
        Folder of the recording, which has a camera.txt.
    images
        Folder that holds its images and nothing else, one file a frame, in temporal order by name.
    stamps_s, exposures_ms
        Time stamps, and the exposures given to odometry, shape (frames,).
    condition
        The condition.
    photometry
        Response and vignette, as far as there are any.
    recording_identity
        What identifies the recording.
    """

    place: Path
    images: Path
    stamps_s: FloatArray = field(repr=False)
    exposures_ms: FloatArray = field(repr=False)
    condition: Condition
    photometry: Photometry
    recording_identity: dict[str, Any] = field(repr=False)

    @classmethod
    def of(cls, recording: Recording, images: Path, condition: Condition, photometry: Photometry) -> OdometryInput:
        """Return a recording under a condition."""
        needed(recording.path, CAMERA)
        exposures = np.asarray(recording.exposures_ms, dtype=np.float64)
        return cls(
            recording.path,
            images,
            np.asarray(recording.stamps_s, dtype=np.float64),
            exposures if condition.metadata_exposures else np.ones_like(exposures),
            condition,
            photometry,
            identity(recording) | {"name": ""},
        )

    def describe(self) -> dict[str, Any]:
        """Return what results depend on: recording, camera, mode, and a hash of each parameter."""
        return {
            "recording": self.recording_identity,
            "camera": sha256(needed(self.place, CAMERA).read_bytes()).hexdigest(),
            "mode": self.condition.mode,
            **fingerprints(self.photometry),
        }

    @contextmanager
    def folder(self) -> Iterator[Path]:
        """Give a temporary folder with images (a link), times.txt, camera.txt and the condition's parameter files.

        Programs are to be started within it and to be given relative paths: DSO ends a path at its first blank.
        """
        with TemporaryDirectory(prefix="ospc-odometry-") as name:
            place = Path(name)
            (place / "images").symlink_to(self.images.resolve(), target_is_directory=True)
            shutil.copyfile(needed(self.place, CAMERA), place / CAMERA)
            write_times(place / TIMES, range(len(self.stamps_s)), self.stamps_s, self.exposures_ms)
            write_curves(self.photometry, place)
            yield place


def write_curves(curves: Photometry | Estimate, place: Path) -> None:
    """Write pcalib.txt and vignette.png into a folder, as far as response and vignette are known."""
    if curves.response is not None:
        write_pcalib(curves.response, place / PCALIB)
    if curves.vignette is not None:
        write_vignette(curves.vignette, place / VIGNETTE)


def needed(place: Path, name: str) -> Path:
    """Return the path of camera.txt or groundtruthSync.txt in a recording's folder."""
    if not (place / name).is_file():
        raise RecordingError(f"{place}: has no {name}; {_NEEDED_FOR[name]}")
    return place / name


def images_of(recording: Recording, cache: Path) -> Path:
    """Return a folder with a recording's images as odometry reads them, one file a frame.

    This is its own folder ``images`` if that holds exactly the frames; otherwise they are written below ``cache``.
    """
    own = recording.path / "images"
    if own.is_dir() and recording.max_grey == 255:
        entries = list(own.iterdir())
        if len(entries) == len(recording) and all(p.suffix.lower() in _SUFFIXES for p in entries):
            return own
    place = cache / f"images-{key_of(identity(recording))[:16]}"
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
            f"{recording.path}: {made.skipped} of its {counted(len(recording), 'image')} cannot be read; odometry "
            f"needs them all"
        )
    return place / "images"
