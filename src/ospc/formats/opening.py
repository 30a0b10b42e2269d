"""Open a response and a vignette from whatever file they are in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ospc.arrays import ImageSize
from ospc.errors import FormatError
from ospc.formats.adobe import read_lcp
from ospc.formats.dso import read_pcalib, read_vignette
from ospc.formats.hugin import read_pto
from ospc.formats.opencv import read_opencv
from ospc.formats.radial import vignette_of
from ospc.photometry.calibration import Calibration
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette


@dataclass(frozen=True)
class Photometry:
    """What a calibration says, whatever it was stored as.

    Attributes
    ----------
    name
        Where it was read from.
    response, vignette
        None where the source does not have it.
    calibration
        All of it, where the source is a calibration of this project.
    """

    name: str
    response: Response | None
    vignette: Vignette | None
    calibration: Calibration | None = None

    @property
    def size(self) -> ImageSize | None:
        """Width and height of the images, as far as known."""
        if self.calibration is not None:
            return self.calibration.size
        return None if self.vignette is None else self.vignette.size


def open_photometry(path: str | Path) -> Photometry:
    """Open a calibration from a file or folder.

    Parameters
    ----------
    path
        A calibration.json; a pcalib.txt; a vignette.png; two of them joined by a comma; a folder with any of these,
        of which calibration.json goes first; or a .pto, .lcp or OpenCV's .yml with one calibration.

    Raises
    ------
    FormatError
        If there is nothing of the kind, it cannot be read, or there are several in one file.
    """
    place = Path(path)
    parts = str(path).split(",")
    if not place.exists() and len(parts) == 2:
        return _pair(str(path), open_photometry(parts[0].strip()), open_photometry(parts[1].strip()))
    if place.is_dir() and not (place / "calibration.json").exists():
        return _folder(place)
    suffix = ".json" if place.is_dir() else place.suffix.lower()
    return _READERS.get(suffix, _read_pcalib)(place)


def _read_pcalib(place: Path) -> Photometry:
    return Photometry(str(place), read_pcalib(place), None)


def _read_calibration(place: Path) -> Photometry:
    calibration = Calibration.load(place)
    return Photometry(str(place), calibration.response, calibration.vignette, calibration)


def _read_vignette(place: Path) -> Photometry:
    return Photometry(str(place), None, read_vignette(place))


def _read_opencv(place: Path) -> Photometry:
    return Photometry(str(place), *read_opencv(place))


def _read_pto(place: Path) -> Photometry:
    fits = {image.fit for image in read_pto(place)}
    _check_single(place, len(fits))
    return Photometry(str(place), None, vignette_of(fits.pop()))


def _read_lcp(place: Path) -> Photometry:
    entries = read_lcp(place)
    _check_single(place, len(entries))
    return Photometry(str(place), None, entries[0].vignette())


_READERS: dict[str, Callable[[Path], Photometry]] = {
    ".json": _read_calibration,
    ".png": _read_vignette,
    ".yml": _read_opencv,
    ".yaml": _read_opencv,
    ".pto": _read_pto,
    ".lcp": _read_lcp,
}


def _check_single(place: Path, count: int) -> None:
    if count != 1:
        raise FormatError(f"{place}: holds {count} different vignettes; leave one of them in it")


def _pair(name: str, first: Photometry, second: Photometry) -> Photometry:
    one_response = (first.response is None) != (second.response is None)
    one_vignette = (first.vignette is None) != (second.vignette is None)
    if not (one_response and one_vignette):
        raise FormatError(f"{name}: of a pair, one is a response and the other a vignette")
    return Photometry(name, first.response or second.response, first.vignette or second.vignette)


def _folder(place: Path) -> Photometry:
    table, picture = place / "pcalib.txt", place / "vignette.png"
    if not table.exists() and not picture.exists():
        raise FormatError(f"{place}: holds no calibration.json, pcalib.txt or vignette.png")
    return Photometry(
        str(place),
        read_pcalib(table) if table.exists() else None,
        read_vignette(picture) if picture.exists() else None,
    )
