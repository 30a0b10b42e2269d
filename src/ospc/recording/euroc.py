"""Folders in the layout of the EuRoC and TUM-VI data sets: ``mav0/cam0`` with ``data.csv`` and ``data/``.

The layout does not include exposures. They are read from ``dso/cam0/times.txt`` next to ``mav0``, as in TUM-VI, or
from a list of exposures next to ``data.csv``.
"""

from __future__ import annotations

from pathlib import Path

from ospc.errors import RecordingError
from ospc.formats.files import by_name
from ospc.recording.exposure_lists import read_list
from ospc.recording.image_sequence import ImageSequence, open_sequence
from ospc.recording.image_source import FolderImages
from ospc.recording.list_search import lists_in, only_list
from ospc.recording.options import DEFAULT, ReadingOptions

_IMAGES, _INDEX = "data", "data.csv"
FIRST_CAMERA = ("mav0/cam0", "cam0", ".")
"""Folder of the first camera if the path is the recording, its ``mav0``, or the camera itself."""


class _Euroc:
    name = "euroc"

    def recognises(self, path: Path) -> bool:
        return _camera(path) is not None

    def open(self, path: Path, options: ReadingOptions = DEFAULT) -> ImageSequence:
        camera = _camera(path)
        if camera is None:
            raise RecordingError(f"{path}: a {self.name} recording has mav0/cam0 with {_INDEX} and {_IMAGES}/")
        others = [other for other in _cameras_next_to(camera) if other.name != camera.name]
        notes = []
        if others and camera != path:
            notes.append(f"reading {camera.name}; to read the other camera, open {others[0]}")
        # The path may be '.' or 'cam0', so its parents are only known after it is resolved.
        full = camera.resolve()
        dso_list = full.parent.parent / "dso" / full.name / "times.txt"
        lists = lists_in(camera) + ([dso_list] if dso_list.is_file() else [])
        advice = "put exposures.csv with a header 'timestamp_ns,exposure_ms' there"
        images = FolderImages.of(camera / _IMAGES)
        return open_sequence(
            path,
            self.name,
            images,
            lambda: read_list(only_list(lists, camera, advice), options, images=images.names),
            notes,
            options=options,
        )

    def cameras(self, path: Path, options: ReadingOptions) -> dict[str, tuple[Path, ReadingOptions]]:
        camera = _camera(path)
        if camera is None or camera == path:
            return {path.resolve().name: (path, options)}
        return {p.name: (p, options) for p in _cameras_next_to(camera)}


def _camera(path: Path) -> Path | None:
    """Return the folder of the first camera under the path."""
    for inner in FIRST_CAMERA:
        camera = path / inner
        if (camera / _INDEX).is_file() and (camera / _IMAGES).is_dir():
            return camera
    return None


def _cameras_next_to(camera: Path) -> list[Path]:
    return sorted((p.parent for p in camera.parent.glob(f"cam*/{_INDEX}")), key=lambda p: by_name(p.name))


KIND = _Euroc()
