"""Conversion of recordings to the layout of the TUM monocular data set, which DSO and its descendants read."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ospc.errors import FormatError, RecordingError, counted
from ospc.formats.dso import write_times
from ospc.formats.files import read_text, write_text
from ospc.formats.rules_camera import input_size
from ospc.formats.validation import validate
from ospc.recording.euroc import FIRST_CAMERA
from ospc.recording.recording import Recording
from ospc.recording.stream import usable_frames
from ospc.recording.writing.images import ImageFormat, NumberedImages, encode, encoding_notes, original_file
from ospc.system.folders import Content, check_usable, writing


def camera_text(recording: Recording) -> tuple[str | None, list[str]]:
    """Return the ``camera.txt`` of a recording, or None if there is none for images of this size, and notes."""
    full = [(recording.path / place).resolve() for place in FIRST_CAMERA]
    sources = [recording.path / "camera.txt", *(p.parent.parent / "dso" / p.name / "camera.txt" for p in full)]
    notes: list[str] = []
    for source in filter(Path.is_file, sources):
        try:
            text = read_text(source)
        except FormatError as error:
            notes.append(f"no camera.txt from {error}")
            continue
        found = input_size(text)
        if found == recording.size:
            return text, notes
        stated = "none" if found is None else f"{found[0]}×{found[1]}"
        wanted = f"{recording.size[0]}×{recording.size[1]}"
        notes.append(f"no camera.txt from {source}: is for images of another size ({stated}, not {wanted})")
    return None, notes


PARTS = ("images", "images.zip", "camera.txt", "times.txt")
"""Files and folders that a conversion writes or replaces, in this order."""

_SHOWN_REASONS = 3
"""Number of reasons for skipped frames in a note; more would be too long."""


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
    check_usable(place, recording.path, lambda _place: Content("is not empty", "with force"), force=overwrite)
    existed = place.exists()
    try:
        with writing(place):
            place.mkdir(parents=True, exist_ok=True)
            with TemporaryDirectory(prefix=".converting-", dir=place, ignore_cleanup_errors=True) as stage:
                converted = _write(recording, Path(stage), place, image_format, archive=archive, progress=progress)
                _move(Path(stage), place)
    finally:
        if not existed and place.is_dir() and not any(place.iterdir()):
            place.rmdir()
    return converted


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
    """Exchange the files for those in place, or none of them; a folder with ``times.txt`` is complete at any time."""
    moves = [(place / name, stage / f"old {name}") for name in reversed(PARTS)]
    moves += [(stage / name, place / name) for name in PARTS]
    moves = [(source, target) for source, target in moves if os.path.lexists(source)]
    try:
        for source, target in moves:
            source.rename(target)
    except BaseException:
        for source, target in reversed(moves):
            if os.path.lexists(target) and not os.path.lexists(source):
                target.rename(source)
        raise
