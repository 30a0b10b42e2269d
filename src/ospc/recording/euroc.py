"""Folders in the layout of the EuRoC and TUM visual-inertial datasets: ``mav0/cam0`` with ``data.csv`` and ``data/``.

The layout does not include exposures. They are read from ``dso/cam0/times.txt`` beside ``mav0``, as in the TUM
dataset, or from a list of exposures beside ``data.csv``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ospc.errors import ExposureError, RecordingError, listed
from ospc.recording.frame_table import table_or_unlisted
from ospc.recording.image_folder import exposure_lists, read_exposures
from ospc.recording.image_names import by_name
from ospc.recording.image_sequence import ImageSequence, open_sequence
from ospc.recording.image_source import FolderImages
from ospc.recording.options import DEFAULT, ReadingOptions

_IMAGES, _INDEX = "data", "data.csv"
_FIRST_CAMERA = ("mav0/cam0", "cam0", ".")
"""Where the first camera is if the path is the recording, its ``mav0``, or the camera itself."""


@dataclass(frozen=True)
class Euroc:
    """The kind of recording with ``data.csv`` and ``data/`` for each camera of ``mav0``."""

    name: str = "euroc"

    def recognises(self, path: Path) -> bool:
        """Tell whether the path is such a recording, its ``mav0``, or one camera of it."""
        return _camera(path) is not None

    def open(self, path: Path, options: ReadingOptions = DEFAULT) -> ImageSequence:
        """Open the camera at the path, otherwise the first one.

        Raises
        ------
        RecordingError
            If there is no such camera, or its images do not correspond to the exposures.
        ExposureError
            If exposures are missing or invalid, or there are several lists.
        """
        camera = _camera(path)
        if camera is None:
            raise RecordingError(f"{path}: a {self.name} recording has mav0/cam0 with {_INDEX} and {_IMAGES}/")
        source = FolderImages.of(camera / _IMAGES)
        if not source.names:
            raise RecordingError(f"{source.place}: holds no images; put the images of {camera / _INDEX} there")
        others = sorted(p.parent.name for p in camera.parent.glob(f"cam*/{_INDEX}") if p.parent.name != camera.name)
        notes = []
        if others and camera != path:
            notes.append(f"{camera.name} is read; open {camera.parent}/{others[0]} for that camera")
        table = table_or_unlisted(
            lambda: read_exposures(_list_of(camera), options),
            str(source.place),
            len(source.names),
            allowed=options.unknown_exposures,
        )
        return open_sequence(path, self.name, source, table, notes, options=options)

    def cameras(self, path: Path, options: ReadingOptions) -> dict[str, tuple[Path, ReadingOptions]]:
        """Return all cameras of ``mav0``, or the one camera at the path."""
        camera = _camera(path)
        if camera is None or camera == path:
            return {path.resolve().name: (path, options)}
        found = sorted((p.parent for p in camera.parent.glob(f"cam*/{_INDEX}")), key=lambda p: by_name(p.name))
        return {p.name: (p, options) for p in found}


def _camera(path: Path) -> Path | None:
    """Return the folder of the first camera under the path."""
    for inner in _FIRST_CAMERA:
        camera = path / inner
        if (camera / _INDEX).is_file() and (camera / _IMAGES).is_dir():
            return camera
    return None


def _list_of(camera: Path) -> Path:
    # The path may be '.' or 'cam0': only the full path shows what is beside it.
    full = camera.resolve()
    beside = full.parent.parent / "dso" / full.name / "times.txt"
    found = exposure_lists(camera) + ([beside] if beside.is_file() else [])
    if len(found) > 1:
        raise ExposureError(f"{camera}: has several lists of exposures ({listed(found)}); keep the one to use")
    if not found:
        raise ExposureError(
            f"{camera}: has no list of exposures; put exposures.csv with a header 'timestamp_ns,exposure_ms' there"
        )
    return found[0]


KIND = Euroc()
