"""Check parameter files against the rules of the programs that read them."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from ospc.arrays import ImageSize
from ospc.errors import FormatError
from ospc.formats.files import read_bytes, read_text
from ospc.formats.findings import UNCORRECTED, Context, Finding, Kind, Program
from ospc.formats.rules_camera import check_camera, input_size
from ospc.formats.rules_pcalib import check_pcalib
from ospc.formats.rules_times import check_times
from ospc.formats.rules_vignette import check_vignette
from ospc.formats.scanning import leading_numbers, scanned

FOLDER_FILES = {"pcalib.txt": "pcalib", "vignette.png": "vignette", "times.txt": "times", "camera.txt": "camera"}
"""Names of the parameter files in the folder of a recording."""

_CHECKS: dict[Kind, Callable[[Path, Context], Iterator[Finding]]] = {
    "pcalib": check_pcalib,
    "vignette": check_vignette,
    "times": check_times,
    "camera": check_camera,
}
_WORDS: tuple[tuple[str, Kind], ...] = (
    ("pcalib", "pcalib"),
    ("gamma", "pcalib"),
    ("camera", "camera"),
    ("times", "times"),
    ("calib", "camera"),
)
_PNG = b"\x89PNG"
_CAMERA_NAME = re.compile(r"\s*(FOV|Pinhole|RadTan|KannalaBrandt|EquiDistant)\s")


@dataclass(frozen=True)
class ParameterFile:
    """A parameter file and its kind."""

    path: Path
    kind: Kind


@dataclass(frozen=True)
class Validation:
    """Result of checking parameter files.

    Attributes
    ----------
    program
        Whose rules were applied.
    size
        Size of the images as given or as in camera.txt; None where unknown.
    files
        What was checked.
    findings
        What was found, file by file.
    """

    program: Program
    size: ImageSize | None
    files: tuple[ParameterFile, ...]
    findings: tuple[Finding, ...]

    @property
    def valid(self) -> bool:
        """Whether the program reads all files and uses them as meant, warnings aside."""
        return not any(finding.severity == "error" for finding in self.findings)


def kind_of(path: str | Path) -> Kind:
    """Tell from name and content what kind of parameter file a file is.

    Raises
    ------
    FormatError
        If it cannot be read or is of no known kind.
    """
    place = Path(path)
    if place.suffix.lower() == ".png" or read_bytes(place, 2**30).startswith(_PNG):
        return "vignette"
    if place.suffix.lower() == ".txt":
        for word, kind in _WORDS:
            if word in place.stem.lower():
                return kind
    first, second, *_ = [*read_text(place).split("\n"), "", ""]
    if leading_numbers(first)[0].size > 16:
        return "pcalib"
    if _CAMERA_NAME.match(first) or (len(scanned(first, "f" * 5)) == 5 and len(scanned(second, "ddd")) == 2):
        return "camera"
    if len(scanned(second if first.startswith("#") else first, "dff")) == 3:
        return "times"
    raise FormatError(
        f"{place}: neither name nor content is that of a pcalib.txt, vignette.png, times.txt or camera.txt; "
        f"rename it to one of these"
    )


def validate(paths: Iterable[str | Path], program: Program, size: ImageSize | None = None) -> Validation:
    """Check parameter files as the program that reads them would.

    Parameters
    ----------
    paths
        Files, or folders in which those with the usual names are checked.
    program
        Whose rules apply.
    size
        Width and height of the images; taken from a camera.txt among the files where not given.

    Raises
    ------
    FormatError
        If a file's kind cannot be told, or a folder holds none.
    """
    files = tuple(found for path in paths for found in _parameter_files(Path(path)))
    known_size = size or next(filter(None, map(_size_in, files)), None)
    findings: list[Finding] = []
    for file in files:
        images = image_names(file.path.parent) if file.kind == "times" else None
        context = Context(program, known_size, None if images is None else len(images))
        try:
            findings += _CHECKS[file.kind](file.path, context)
        except FormatError as error:
            rule = str(error).removeprefix(f"{file.path}: ")
            findings.append(Finding("error", str(file.path), rule, UNCORRECTED[program]))
    findings += _about_pairs(files, program)
    return Validation(program, known_size, files, tuple(findings))


def image_names(folder: Path) -> list[str] | None:
    """Return the names of what DSO takes for images in a folder's images or images.zip, sorted; None without either.

    Everything in there counts, whatever it is.
    """
    if (folder / "images").is_dir():
        return sorted(entry.name for entry in (folder / "images").iterdir())
    try:
        with zipfile.ZipFile(folder / "images.zip") as archive:
            return sorted(archive.namelist())
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


def _size_in(file: ParameterFile) -> ImageSize | None:
    return input_size(read_text(file.path)) if file.kind == "camera" else None


def _about_pairs(files: tuple[ParameterFile, ...], program: Program) -> Iterator[Finding]:
    kinds = {file.kind for file in files}
    if "vignette" in kinds and "pcalib" not in kinds:
        name = next(str(file.path) for file in files if file.kind == "vignette")
        refuses = {"dso": UNCORRECTED["dso"], "mono": "corrects neither: no vignette without a response"}[program]
        yield Finding(
            "note",
            name,
            "a vignette comes with a pcalib.txt; none was given",
            f"without one it {refuses}",
            "give both; a linear camera needs a pcalib.txt with the numbers 0 to 255",
        )
