"""Conversion of recordings to the layout of the TUM monocular data set, which DSO and its descendants read."""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ospc.arrays import ImageSize
from ospc.errors import FormatError, RecordingError, counted
from ospc.folders import Content, check_usable, writing
from ospc.formats.dso import write_times
from ospc.formats.files import read_text, write_text
from ospc.formats.rules_camera import input_size
from ospc.formats.scanning import STREAM_NUMBER
from ospc.formats.validation import validate
from ospc.recording.euroc import FIRST_CAMERA
from ospc.recording.recording import Recording
from ospc.recording.stream import usable_frames
from ospc.recording.writing.images import ImageFormat, NumberedImages, encode, encoding_notes, original_file

_MOST_BYTES = 65536
"""Maximum size of camera.txt and sensor.yaml files; typical ones have a few hundred bytes."""

_MULTIPLE = 16
"""The sides of rectified images must be multiples of this, because DSO halves them several times."""

_MODELS = {"radial-tangential": "RadTan", "radtan": "RadTan", "equidistant": "EquiDistant", "equi": "EquiDistant"}


def camera_text(recording: Recording) -> tuple[str | None, list[str]]:
    """Return the content of camera.txt for a recording, or None if its intrinsics are unknown, and notes.

    The ``camera.txt`` of the recording is copied if it is for images of this size. Otherwise, the intrinsics in the
    ``sensor.yaml`` of a EuRoC folder are converted to the format of DSO.
    """
    places = [recording.path / folder for folder in FIRST_CAMERA]
    full = [place.resolve() for place in places]
    sources = [recording.path / "camera.txt", *(p.parent.parent / "dso" / p.name / "camera.txt" for p in full)]
    sources += [place / "sensor.yaml" for place in places]
    notes: list[str] = []
    for source in sources:
        if source.is_file():
            try:
                text = read_text(source, _MOST_BYTES)
                if source.suffix == ".yaml":
                    return _of_sensor(text, source, recording.size), notes
                _check_size(input_size(text), source, recording.size)
                return text, notes
            except FormatError as error:
                notes.append(f"no camera.txt from {error}")
    return None, notes


def _check_size(found: tuple[float, ...] | None, source: Path, size: ImageSize) -> None:
    if found != size:
        stated = "none" if found is None else "×".join(f"{side:g}" for side in found)
        raise FormatError(f"{source}: is for images of another size ({stated}, not {size[0]}×{size[1]})")


def _of_sensor(text: str, source: Path, size: ImageSize) -> str:
    """Return the content of camera.txt from the sensor.yaml of a EuRoC folder."""
    focal_and_centre = _numbers(text, "intrinsics", source)
    resolution = _numbers(text, "resolution", source)
    distortion = _numbers(text, "distortion_coefficients", source)
    named = re.search(r"^\s*distortion_model:\s*([\w-]+)", text, re.MULTILINE)
    model = _MODELS.get(named[1]) if named else None
    if len(focal_and_centre) != 4 or (len(distortion) != 4 and any(distortion)):
        raise FormatError(f"{source}: does not have four intrinsics and four distortion coefficients")
    _check_size(tuple(resolution), source, size)
    if any(distortion) and model is None:
        raise FormatError(
            f"{source}: DSO does not support its distortion model {named[1] if named else 'without a name'}"
        )
    values = [*focal_and_centre, *(distortion if any(distortion) else [0.0])]
    first = f"{model if any(distortion) else 'Pinhole'} {' '.join(f'{value:.12g}' for value in values)}"
    width, height = (side - side % _MULTIPLE if side >= _MULTIPLE else side for side in size)
    return f"{first}\n{size[0]} {size[1]}\ncrop\n{width} {height}\n"


def _numbers(text: str, name: str, source: Path) -> list[float]:
    """Return the numbers in the line ``name: [a, b, …]``."""
    found = re.search(rf"^\s*{name}:\s*\[([^\]\n]{{0,400}})\]", text, re.MULTILINE)
    if found is None:
        raise FormatError(f"{source}: has no line '{name}: […]'")
    values = [float(number) for number in STREAM_NUMBER.findall(found[1])]
    if not all(math.isfinite(value) for value in values):
        raise FormatError(f"{source}: '{name}' has a number that is not finite")
    return values


PARTS = ("images", "images.zip", "camera.txt", "times.txt")
"""Files and folders that a conversion writes or replaces, in this order."""

_SHOWN_REASONS = 3
"""Number of reasons for skipped frames in a note; more would be too long."""

_STAGE_PREFIX = ".converting-"
"""Prefix of the temporary folder in which files are written until all are complete."""


@dataclass(frozen=True)
class Converted:
    """The folder, the number of frames written, copied, and skipped because they cannot be read, and notes.

    ``has_camera`` is whether ``camera.txt`` was written.
    """

    path: Path
    frames: int
    copied: int
    skipped: int
    has_camera: bool
    notes: tuple[str, ...]


def convert_recording(
    recording: Recording,
    out: str | Path,
    *,
    image_format: ImageFormat | None = None,
    archive: bool = False,
    overwrite: bool = False,
    progress: Callable[[int, int], None] = lambda _done, _all: None,
) -> Converted:
    """Write a recording as ``images/`` or ``images.zip``, ``times.txt`` and, if intrinsics are known, ``camera.txt``.

    Memory does not grow with the length of the recording. Image files that other programs read the same way are
    copied; others are encoded again, those with more than 8 bits left-aligned in 16. Everything is written to a
    hidden folder and moved into place at the end, so that the output folder is unchanged after an error or an
    interruption.

    Parameters
    ----------
    out
        A folder, new or empty.
    image_format
        ``"png"`` or ``"jpg"`` (8 bit, lossy); None to copy files if possible and write PNG otherwise.
    archive
        Whether to write ``images.zip`` instead of the folder ``images``.
    overwrite
        Whether the folder may contain files. A recording in it is replaced; other files are kept.
    progress
        Called with the number of finished frames and the total.

    Raises
    ------
    SettingError
        If the folder is not empty, contains the recording or may contain a part of it, or cannot be written.
    RecordingError
        If no frame can be read, or time stamps are equal when rounded to nanoseconds.
    """
    place = Path(out)
    check_usable(place, recording.path, partial(_content, recording.path.resolve()), force=overwrite)
    existed = place.exists()
    try:
        with writing(place):
            place.mkdir(parents=True, exist_ok=True)
            with TemporaryDirectory(prefix=_STAGE_PREFIX, dir=place, ignore_cleanup_errors=True) as stage:
                converted = _write(recording, Path(stage), place, image_format, archive=archive, progress=progress)
                _move(Path(stage), place)
    finally:
        if not existed and place.is_dir() and not any(place.iterdir()):
            place.rmdir()
    return converted


def _content(recorded: Path, place: Path) -> Content:
    full = place.resolve()
    if any(recorded.is_relative_to(full / part) for part in PARTS):
        return Content("contains the recording itself", "never")
    return Content("is not empty", "with force")


def _write(
    recording: Recording,
    stage: Path,
    place: Path,
    image_format: ImageFormat | None,
    *,
    archive: bool,
    progress: Callable[[int, int], None],
) -> Converted:
    """Write all files to the folder ``stage``."""
    written: list[int] = []
    problems: list[str] = []
    copied = 0
    with NumberedImages(stage, len(recording), archive=archive) as images:
        for frame in usable_frames(recording, problems.append):
            data = original_file(recording, frame, image_format)
            copied += data is not None
            images.write(len(written), data if data is not None else encode(frame, image_format or "png"))
            written.append(frame.index)
            progress(frame.index + 1, len(recording))
    if not written:
        raise RecordingError(
            f"{recording.path}: none of its frames can be read; first problem: {' '.join(problems[:1])}"
        )
    stamps_s = recording.stamps_s[written]
    if np.any(np.diff(np.round(stamps_s, 9)) <= 0):
        raise RecordingError(f"{recording.path}: time stamps are less than a nanosecond apart; scale them")
    camera, notes = camera_text(recording)
    if camera is not None:
        write_text(stage / "camera.txt", camera)
    write_times(stage / "times.txt", range(len(written)), stamps_s, recording.exposures_ms[written])
    notes = [*encoding_notes(recording, len(written) - copied, image_format), *notes]
    for finding in validate([stage], "dso", recording.size).findings:
        if finding.severity == "error":
            said = f"{Path(finding.file).name}: {finding.rule}; DSO {finding.effect}; {finding.remedy}"
            notes.append(said.rstrip("; "))
    if problems:
        more = "; …" if len(problems) > _SHOWN_REASONS else ""
        notes.insert(0, f"{counted(len(problems), 'frame')} left out: {'; '.join(problems[:_SHOWN_REASONS])}{more}")
    return Converted(place, len(written), copied, len(problems), camera is not None, tuple(notes))


def _move(stage: Path, place: Path) -> None:
    """Move the files into place; ``times.txt`` comes last, so that a folder with it is complete."""
    for name in PARTS:
        old = place / name
        if old.is_dir() and not old.is_symlink():
            shutil.rmtree(old)
        else:
            old.unlink(missing_ok=True)
    for name in PARTS:
        if (stage / name).exists():
            (stage / name).rename(place / name)
