"""Opening of responses and vignettes from any supported file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ospc.arrays import ImageSize
from ospc.errors import FormatError, SettingError, listed
from ospc.formats.dso import read_caveat, read_pcalib, read_vignette
from ospc.formats.files import read_text
from ospc.formats.hugin import read_pto
from ospc.formats.lens_profiles import read_lcp, read_lensfun
from ospc.formats.opencv import read_opencv
from ospc.formats.radial import RadialFit
from ospc.formats.rules_pcalib import MOST_COLUMNS
from ospc.formats.scanning import words_of
from ospc.photometry.calibration import Calibration
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette

_NOT_FROM_HUGIN = "the response in a .pto is not read, because its coefficients refer to the base curves of hugin"


@dataclass(frozen=True)
class Photometry:
    """Response and vignette of a camera from the file ``name``; None for a part that is not in it.

    ``calibration`` is the entire calibration if the file is a calibration.json. ``caveat_beside`` is the caveat in a
    file next to a pcalib.txt or vignette.png; empty if there is none. ``unread`` says why the response in the file is
    not read; empty if it has none.
    """

    name: str
    response: Response | None = None
    vignette: Vignette | None = None
    calibration: Calibration | None = None
    caveat_beside: str = ""
    unread: str = ""

    @property
    def caveat(self) -> str:
        """Caveat to include in all output; empty if there is none."""
        return self.caveat_beside if self.calibration is None else self.calibration.caveat

    @property
    def max_grey(self) -> int | None:
        """Largest grey value of the images; None if unknown."""
        return None if self.calibration is None else self.calibration.max_grey

    @property
    def size(self) -> ImageSize | None:
        """Width and height of the images; None if unknown."""
        if self.calibration is not None:
            return self.calibration.size
        return None if self.vignette is None else self.vignette.size


def open_photometry(path: str | Path, size: ImageSize | None = None) -> Photometry:
    """Open a calibration from a file or folder.

    Parameters
    ----------
    path
        A calibration.json; a pcalib.txt; a vignette.png; two of them joined by a comma; a folder with any of these,
        in which calibration.json takes precedence; or hugin's .pto, Adobe's .lcp, lensfun's .xml or OpenCV's .yml
        with one calibration.
    size
        Width and height of the images, for files that do not state it.

    Raises
    ------
    FormatError
        If there is no calibration, it cannot be read, or a file has several.
    SettingError
        If ``size`` is None and the file does not state it.
    """
    place = Path(path)
    parts = str(path).split(",")
    if not place.exists() and len(parts) == 2:
        first, second = (open_photometry(part.strip(), size) for part in parts)
        return together(first, second)
    if place.is_dir() and not (place / "calibration.json").is_file():
        return _folder(place)
    name = str(place)
    match ".json" if place.is_dir() else place.suffix.lower():
        case ".json":
            whole = Calibration.load(place)
            found = Photometry(name, whole.response, whole.vignette, whole)
        case ".png":
            found = Photometry(name, vignette=read_vignette(place), caveat_beside=read_caveat(place.parent))
        case ".yml" | ".yaml":
            found = Photometry(name, *read_opencv(place))
        case ".pto":
            found = Photometry(name, vignette=_only(place, read_pto(place)), unread=_NOT_FROM_HUGIN)
        case ".lcp":
            found = Photometry(name, vignette=_only(place, read_lcp(place, size)))
        case ".xml":
            found = Photometry(name, vignette=_only(place, read_lensfun(place, size)))
        case _:
            _check_numeric(place)
            found = Photometry(name, read_pcalib(place), caveat_beside=read_caveat(place.parent))
    return found


def open_both(a: str | Path, b: str | Path) -> tuple[Photometry, Photometry]:
    """Open two calibrations; the image size of one is used if the other does not state it."""
    try:
        first = open_photometry(a)
    except SettingError:
        second = open_photometry(b)
        return open_photometry(a, second.size), second
    return first, open_photometry(b, first.size)


def together(first: Photometry, second: Photometry) -> Photometry:
    """Combine a file with only a response and a file with only a vignette; FormatError for other files."""
    name = f"{first.name},{second.name}"
    one_response = (first.response is None) != (second.response is None)
    one_vignette = (first.vignette is None) != (second.vignette is None)
    if not (one_response and one_vignette):
        raise FormatError(f"{name}: one of the two files must have only a response, and the other only a vignette")
    caveats = dict.fromkeys(filter(None, (first.caveat, second.caveat)))
    return Photometry(
        name,
        first.response or second.response,
        first.vignette or second.vignette,
        caveat_beside="; ".join(caveats),
    )


def _only(place: Path, fits: tuple[RadialFit, ...]) -> Vignette:
    different = set(fits)
    if len(different) != 1:
        count = f"{len(different)} different vignettes; remove all but one" if different else "no vignette"
        raise FormatError(f"{place}: has {count}")
    return fits[0].vignette()


def _check_numeric(place: Path) -> None:
    """Raise a FormatError if a file does not begin like a pcalib.txt; later checks would give misleading advice."""
    first, *others = read_text(place).strip().split("\n")
    values = words_of(first)
    text = bool(values) and not values[0][0].isdigit() and values[0][0] not in "+-."
    columns = bool(others) and 1 < len(values) <= MOST_COLUMNS
    if text or columns:
        raise FormatError(
            f"{place}: is not a pcalib.txt, which has a response as numbers on one line; other files are recognised "
            f"by their suffix: .pto (hugin), .lcp (Adobe), .xml (lensfun), .yml (OpenCV), .json"
        )


def _folder(place: Path) -> Photometry:
    table, picture = place / "pcalib.txt", place / "vignette.png"
    if not table.is_file() and not picture.is_file():
        inner = sorted(path.parent.name for path in place.glob("*/calibration.json"))
        remedy = f"give one of its folders: {listed(inner)}" if inner else ""
        raise FormatError(f"{place}: has no calibration.json, pcalib.txt or vignette.png", remedy)
    return Photometry(
        str(place),
        read_pcalib(table) if table.is_file() else None,
        read_vignette(picture) if picture.is_file() else None,
        caveat_beside=read_caveat(place),
    )
