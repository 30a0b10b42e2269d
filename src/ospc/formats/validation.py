"""Check and repair parameter files by the rules of the programs that read them."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ospc.arrays import ImageSize
from ospc.errors import FormatError
from ospc.formats.files import read_bytes, read_text
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
"""What the name of a file says of its kind; the first of these words that is in it counts."""
_WITHOUT_PCALIB = UNCORRECTED | {"mono": "corrects neither: no vignette without a response"}
_PNG = b"\x89PNG"
_LARGEST_FILE = 2**30
"""Most bytes of a file that is validated: bounds memory, and exceeds any table or map of a vignette."""


@dataclass(frozen=True)
class ParameterFile:
    """A parameter file and its kind."""

    path: Path
    kind: Kind


@dataclass(frozen=True)
class Validation:
    """The rules of a program that parameter files break, file by file.

    ``size`` is that of the images, as given or from camera.txt; None if unknown.
    """

    program: Program
    size: ImageSize | None
    files: tuple[ParameterFile, ...]
    findings: tuple[Finding, ...]

    @property
    def valid(self) -> bool:
        """Whether no rule is broken with an error."""
        return not any(finding.severity == "error" for finding in self.findings)


@dataclass(frozen=True)
class Repair:
    """A repaired copy of a parameter file, and what was changed, one sentence each; without changes there is none."""

    source: Path
    path: Path
    changes: tuple[str, ...]


def kind_of(path: str | Path) -> Kind:
    """Return the kind of a parameter file by its name and content; FormatError if it is unknown or not readable."""
    place = Path(path)
    if place.suffix.lower() == ".png" or read_bytes(place, _LARGEST_FILE).startswith(_PNG):
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
        f"{place}: neither name nor content is that of a pcalib.txt, vignette.png, times.txt or camera.txt; "
        f"rename it if it is one of these"
    )


def validate(paths: Iterable[str | Path], program: Program, size: ImageSize | None = None) -> Validation:
    """Check parameter files, or those of the usual names in folders, by the rules of the program that reads them.

    ``size`` is the width and height of the images; taken from a camera.txt among the files if None. FormatError if
    the kind of a file is unknown, or a folder holds no parameter file.
    """
    files = tuple(found for path in paths for found in _parameter_files(Path(path)))
    in_files = (input_size(read_text(file.path)) for file in files if file.kind == "camera")
    known_size = size or next(filter(None, in_files), None)
    findings: list[Finding] = []
    for file in files:
        findings += _FORMATS[file.kind].findings(file.path, _context(file, program, known_size))
    vignettes = [str(file.path) for file in files if file.kind == "vignette"]
    if vignettes and not any(file.kind == "pcalib" for file in files):
        rule = "a vignette comes with a pcalib.txt; none was given"
        remedy = "give both; a linear camera needs a pcalib.txt with the numbers 0 to 255"
        findings.append(Finding("note", rule, f"without one it {_WITHOUT_PCALIB[program]}", remedy, vignettes[0]))
    return Validation(program, known_size, files, tuple(findings))


def repair(file: ParameterFile, program: Program = "dso", size: ImageSize | None = None) -> Repair:
    """Write ``<name>.repaired.<ext>`` beside a parameter file, unless nothing needs a repair.

    The copy keeps the rules of the program; ``size`` is what a vignette needs, its own size if None. FormatError if a
    repair would have to invent content: too few values, a curve that falls as a whole, a vignette of another aspect
    ratio, lines that cannot be matched with images.
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
    """Return the names of all entries in a folder's images or images.zip, sorted; None if it has neither.

    DSO takes every entry of the folder for an image.
    """
    if (folder / "images").is_dir():
        return tuple(sorted(entry.name for entry in (folder / "images").iterdir()))
    try:
        with zipfile.ZipFile(folder / "images.zip") as archive:
            return tuple(sorted(archive.namelist()))
    except (OSError, zipfile.BadZipFile):
        return None


def _parameter_files(path: Path) -> list[ParameterFile]:
    if not path.is_dir():
        if not path.exists():
            raise FormatError(f"{path}: there is no such file; check the path")
        return [ParameterFile(path, kind_of(path))]
    found = [ParameterFile(path / name, kind_of(path / name)) for name in FOLDER_FILES if (path / name).is_file()]
    if not found:
        raise FormatError(f"{path}: holds none of {', '.join(FOLDER_FILES)}; name the files")
    return found
