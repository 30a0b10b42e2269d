"""The intrinsics of a recording as DSO's camera.txt, if the recording includes them."""

from __future__ import annotations

import math
import re
from pathlib import Path

from ospc.arrays import ImageSize
from ospc.errors import FormatError
from ospc.formats.files import read_text
from ospc.formats.rules_camera import input_size
from ospc.recording.recording import Recording

_MOST_BYTES = 65536
"""Larger camera.txt and sensor.yaml files are refused; real ones have a few hundred bytes."""

_MULTIPLE = 16
"""DSO halves rectified images several times, so their sides must be multiples of this."""

_CAMERA_FOLDERS = ("mav0/cam0", "cam0", ".")
_MODELS = {"radial-tangential": "RadTan", "radtan": "RadTan", "equidistant": "EquiDistant", "equi": "EquiDistant"}
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


def camera_text(recording: Recording) -> tuple[str | None, list[str]]:
    """Return the content of a camera.txt for a recording, None if its intrinsics are unknown, and notes.

    A ``camera.txt`` of the recording is used unchanged if it is for images of this size; otherwise the intrinsics in
    the ``sensor.yaml`` of a EuRoC folder are written in DSO's format.
    """
    places = [recording.path / folder for folder in _CAMERA_FOLDERS]
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
        raise FormatError(f"{source}: it is for images of another size ({stated}, not {size[0]}×{size[1]})")


def _of_sensor(text: str, source: Path, size: ImageSize) -> str:
    """Return the content of a camera.txt from a sensor.yaml of the EuRoC layout."""
    focal_and_centre = _numbers(text, "intrinsics", source)
    resolution = _numbers(text, "resolution", source)
    distortion = _numbers(text, "distortion_coefficients", source)
    named = re.search(r"^\s*distortion_model:\s*([\w-]+)", text, re.MULTILINE)
    model = _MODELS.get(named[1]) if named else None
    if len(focal_and_centre) != 4 or (len(distortion) != 4 and any(distortion)):
        raise FormatError(f"{source}: it does not hold four intrinsics and four distortion coefficients")
    _check_size(tuple(resolution), source, size)
    if any(distortion) and model is None:
        raise FormatError(
            f"{source}: DSO does not know its distortion model {named[1] if named else 'without a name'}"
        )
    values = [*focal_and_centre, *(distortion if any(distortion) else [0.0])]
    first = f"{model if any(distortion) else 'Pinhole'} {' '.join(f'{value:.12g}' for value in values)}"
    width, height = (side - side % _MULTIPLE if side >= _MULTIPLE else side for side in size)
    return f"{first}\n{size[0]} {size[1]}\ncrop\n{width} {height}\n"


def _numbers(text: str, name: str, source: Path) -> list[float]:
    """Return the numbers of one line ``name: [a, b, …]``."""
    found = re.search(rf"^\s*{name}:\s*\[([^\]\n]{{0,400}})\]", text, re.MULTILINE)
    if found is None:
        raise FormatError(f"{source}: it has no line '{name}: […]'")
    values = [float(number) for number in _NUMBER.findall(found[1])]
    if not all(math.isfinite(value) for value in values):
        raise FormatError(f"{source}: '{name}' holds a number that is not finite")
    return values
