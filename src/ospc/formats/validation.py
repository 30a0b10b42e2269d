"""Validation and repair of parameter files according to the rules of the programs that read them."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ospc.arrays import ImageSize
from ospc.errors import UNREADABLE, FormatError
from ospc.formats.files import LARGEST_FILE, read_bytes, read_text
from ospc.formats.image_header import PNG_SIGNATURE
from ospc.formats.rules import UNCORRECTED, Context, Finding, Format, Kind, Program
from ospc.formats.rules_camera import CAMERA, MODELS, input_size
from ospc.formats.rules_pcalib import MOST_COLUMNS, PCALIB
from ospc.formats.rules_times import TIMES
from ospc.formats.rules_vignette import VIGNETTE
from ospc.formats.scanning import leading_numbers, scanned, words_of

FOLDER_FILES = ("pcalib.txt", "vignette.png", "times.txt", "camera.txt")
"""Names of the parameter files in the folder of a recording."""

_FORMATS: dict[Kind, Format[Any]] = {"pcalib": PCALIB, "vignette": VIGNETTE, "times": TIMES, "camera": CAMERA}
_WORDS: dict[str, Kind] = {
    "pcalib": "pcalib",
    "gamma": "pcalib",
    "camera": "camera",
    "times": "times",
    "calib": "camera",
}
"""Words in the name of a file that determine its kind; the first match counts."""
_WITHOUT_PCALIB = UNCORRECTED | {"mono": "corrects neither, because it needs a response to correct a vignette"}


@dataclass(frozen=True)
class ParameterFile:
    """A parameter file and its kind."""

    path: Path
    kind: Kind


@dataclass(frozen=True)
class Validation:
    """The rules of a program that parameter files break, by file.

    ``size`` is the size of the images, as given or from camera.txt; None if unknown.
    """

    program: Program
    size: ImageSize | None
    files: tuple[ParameterFile, ...]
    findings: tuple[Finding, ...]

    @property
    def valid(self) -> bool:
        """Whether there are no errors."""
        return not any(finding.severity == "error" for finding in self.findings)


@dataclass(frozen=True)
class Repair:
    """A repaired copy of a parameter file, and a sentence about each change; without changes there is no copy."""

    source: Path
    path: Path
    changes: tuple[str, ...]


def kind_of(path: str | Path) -> Kind:
    """Return the kind of a parameter file by name and content; FormatError if it is unknown or unreadable."""
    place = Path(path)
    if place.suffix.lower() == ".png" or read_bytes(place, LARGEST_FILE).startswith(PNG_SIGNATURE[:4]):
        return "vignette"
    if place.suffix.lower() == ".txt":
        for word, kind in _WORDS.items():
            if word in place.stem.lower():
                return kind
    first, second, *_ = [*read_text(place).split("\n"), "", ""]
    if len(words_of(first)) > MOST_COLUMNS and leading_numbers(first)[0].size:
        return "pcalib"
    words = first.split(maxsplit=1)
    if (len(words) > 1 and words[0] in MODELS) or (
        len(scanned(first, "f" * 5)) == 5 and len(scanned(second, "ddd")) == 2
    ):
        return "camera"
    if len(scanned(second if first.startswith("#") else first, "dff")) == 3:
        return "times"
    raise FormatError(
        f"{place}: not recognised as a pcalib.txt, vignette.png, times.txt or camera.txt by name or content; rename "
        f"it if it is one of these"
    )


def validate(paths: Iterable[str | Path], program: Program, size: ImageSize | None = None) -> Validation:
    """Check parameter files, or those with the usual names in folders, by the rules of the program that reads them.

    ``size`` is the width and height of the images; if None, it is read from a camera.txt among the files.

    Raises
    ------
    FormatError
        If the kind of a file is unknown, or a folder has no parameter files.
    """
    files = tuple(found for path in paths for found in _parameter_files(Path(path)))
    in_files = (input_size(read_text(file.path)) for file in files if file.kind == "camera")
    known_size = size or next(filter(None, in_files), None)
    findings: list[Finding] = []
    for file in files:
        findings += _FORMATS[file.kind].findings(file.path, _context(file, program, known_size))
    vignettes = [str(file.path) for file in files if file.kind == "vignette"]
    if vignettes and not any(file.kind == "pcalib" for file in files):
        rule = "a vignette is used with a pcalib.txt; none was given"
        remedy = "give both; a linear camera needs a pcalib.txt with the numbers 0 to 255"
        findings.append(Finding("note", rule, f"then {_WITHOUT_PCALIB[program]}", remedy, file=vignettes[0]))
    return Validation(program, known_size, files, tuple(findings))


def repair(file: ParameterFile, program: Program = "dso", size: ImageSize | None = None) -> Repair:
    """Write ``<name>.repaired.<ext>`` next to a parameter file if it needs a repair.

    The copy follows the rules of the program. ``size`` is the required size of a vignette; None to keep its size.

    Raises
    ------
    FormatError
        If a repair would have to invent content: too few values, a decreasing curve, a vignette with another aspect
        ratio, or lines that cannot be matched with images.
    """
    target = file.path.with_name(f"{file.path.stem}.repaired{file.path.suffix}")
    kind = _FORMATS[file.kind]
    document, changes = kind.repaired(file.path, _context(file, program, size))
    if changes:
        kind.write(document, target)
    return Repair(file.path, target, changes)


def _context(file: ParameterFile, program: Program, size: ImageSize | None) -> Context:
    return Context(program, size, _image_names(file.path.parent) if file.kind == "times" else None)


def _image_names(folder: Path) -> tuple[str, ...] | None:
    """Return the sorted names of all entries in images or images.zip of a folder; None if it has neither."""
    # DSO treats every entry as an image.
    if (folder / "images").is_dir():
        return tuple(sorted(entry.name for entry in (folder / "images").iterdir()))
    try:
        with zipfile.ZipFile(folder / "images.zip") as archive:
            return tuple(sorted(archive.namelist()))
    except (OSError, *UNREADABLE):
        return None


def _parameter_files(path: Path) -> list[ParameterFile]:
    if not path.is_dir():
        if not path.exists():
            raise FormatError(f"{path}: there is no such file; check the path")
        return [ParameterFile(path, kind_of(path))]
    found = [ParameterFile(path / name, kind_of(path / name)) for name in FOLDER_FILES if (path / name).is_file()]
    if not found:
        raise FormatError(f"{path}: has none of {', '.join(FOLDER_FILES)}; give the files")
    return found
