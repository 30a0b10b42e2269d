"""Export of calibrations to other programs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeAlias, get_args

from ospc.arrays import ImageSize
from ospc.errors import FormatError, NotObservableError, SettingError, os_error_as
from ospc.formats.dso import PARAMETER_FILES, parameter_files
from ospc.formats.hugin import write_pto
from ospc.formats.lens_profiles import write_lcp, write_lensfun
from ospc.formats.opencv import write_opencv
from ospc.formats.opening import Photometry
from ospc.formats.radial import Optics
from ospc.formats.resize import crop_calibration, resize_calibration
from ospc.formats.rules_pcalib import FEWEST_VALUES
from ospc.photometry.calibration import Calibration, map_beside
from ospc.photometry.geometry import image_size
from ospc.photometry.verdict import State, Verdict
from ospc.photometry.vignette import RasterVignette

Program: TypeAlias = Literal["dso", "lensfun", "hugin", "opencv", "adobe", "json"]
"""Programs that calibrations can be exported to."""

_SUFFIXES: dict[str, tuple[str, ...]] = {
    "lensfun": (".xml",),
    "hugin": (".pto",),
    "opencv": (".yml", ".yaml"),
    "adobe": (".lcp",),
    "json": (".json",),
}
"""Suffixes by which :func:`~ospc.formats.opening.open_photometry` recognises the files again."""


@dataclass(frozen=True)
class Exported:
    """Paths of the written files, and notes on residuals and on parts that were not written."""

    files: tuple[Path, ...]
    notes: tuple[str, ...]


def adapted(
    photometry: Photometry, crop: tuple[int, int, int, int] | None = None, size: ImageSize | None = None
) -> Photometry:
    """Return the photometry for images that are first cropped, then scaled to a size.

    ``crop`` is column, row, width and height of the part that is kept.

    Raises
    ------
    SettingError
        If the part is not inside the image, scaling would change the aspect ratio, or the size of the images is
        unknown.
    """
    if crop is None and size is None:
        return photometry
    calibration = as_calibration(photometry)
    if crop is not None:
        calibration = crop_calibration(calibration, crop[:2], crop[2:])
    if size is not None:
        calibration = resize_calibration(calibration, size)
    whole = calibration if photometry.calibration is not None else None
    return Photometry(
        photometry.name, calibration.response, calibration.vignette, whole, caveat_beside=photometry.caveat
    )


def as_calibration(photometry: Photometry, size: ImageSize | None = None, max_grey: int | None = None) -> Calibration:
    """Return the photometry as a calibration that states its source.

    ``size`` is required if the photometry does not state it; ``max_grey`` defaults to that of the calibration or the
    table.

    Raises
    ------
    SettingError
        If ``size`` is missing or contradicts the photometry.
    FormatError
        If there is neither response nor vignette, or an image cannot have this size.
    """
    response, known = photometry.response, photometry.size or size
    if known is None:
        raise SettingError(f"{photometry.name}: does not state the image size; add the vignette, or --size")
    if size not in (None, known):
        raise SettingError(
            f"{photometry.name}: is for images of {known[0]}×{known[1]} pixels; leave out --size, then scale the "
            f"result with 'ospc export --size'"
        )
    if photometry.calibration is not None:
        return replace(photometry.calibration, max_grey=max_grey or photometry.calibration.max_grey)
    if response is None and photometry.vignette is None:
        raise FormatError(f"{photometry.name}: has neither a response nor a vignette")
    return Calibration(
        image_size(*known),
        response,
        photometry.vignette,
        {part: _verdict(part, photometry) for part in ("response", "vignette")},
        max_grey=max_grey or (255 if response is None else response.inverse_table.size - 1),
        source={"imported_from": photometry.name},
        rests_on=photometry.caveat,
    )


def _verdict(part: str, photometry: Photometry) -> Verdict:
    if getattr(photometry, part) is None:
        if part == "response" and photometry.unread:
            return Verdict("not identifiable", photometry.unread, "import it from a pcalib.txt or a calibration.json")
        return Verdict("not identifiable", f"{photometry.name} does not have it", "calibrate from a recording")
    state: State = "marginal" if photometry.caveat else "identifiable"
    return Verdict(state, f"imported from {photometry.name}, which states no uncertainty")


def files_of(program: Program, out: str | Path) -> list[Path]:
    """Return all files that an export may write; FormatError if the name does not have the suffix of the format."""
    place = Path(out)
    if program == "dso":
        return [place / name for name in PARAMETER_FILES]
    suffixes = _SUFFIXES[program]
    if place.suffix.lower() not in suffixes:
        raise FormatError(f"{place}: such files must have the suffix {' or '.join(suffixes)}; choose another name")
    return [place, *([map_beside(place)] if program == "json" else [])]


def export(
    photometry: Photometry,
    program: Program,
    out: str | Path,
    optics: Optics | None = None,
    values: int = FEWEST_VALUES,
) -> Exported:
    """Write a calibration for another program, to a folder for ``dso``, and to a file for all others.

    ``optics`` are needed for lensfun and Adobe; ``values`` is the number of grey levels in pcalib.txt.

    Raises
    ------
    NotObservableError
        If no part that the program can use is known.
    SettingError
        If ``optics`` lack something that the program needs, or the program is unknown.
    FormatError
        If the format cannot represent the calibration, the file has another suffix, or it cannot be written.
    """
    if program not in get_args(Program):
        raise SettingError(f"{program!r} is not a program; known: {', '.join(get_args(Program))}")
    place, notes = Path(out), _unknown(photometry)
    files_of(program, place)  # refuses a wrong suffix
    if program in ("lensfun", "hugin", "adobe"):
        return _vignette_only(photometry, program, place, optics or Optics())
    if program == "json":
        calibration = as_calibration(photometry)
        files = [calibration.save(place)]
        if isinstance(calibration.vignette, RasterVignette):
            files.append(map_beside(place))
    elif photometry.response is None and photometry.vignette is None:
        raise NotObservableError(f"{photometry.name}: has neither a response nor a vignette")
    elif program == "opencv":
        files = [write_opencv(photometry.response, photometry.vignette, place)]
    else:
        files = _to_dso(photometry, place, values)
        # Programs would use them with the new ones.
        others = [old for name in PARAMETER_FILES if (old := place / name) not in files and old.exists()]
        notes += tuple(f"{old} is not of this calibration; remove it unless both belong together" for old in others)
    return Exported(tuple(files), notes)


def _to_dso(photometry: Photometry, folder: Path, values: int) -> list[Path]:
    with os_error_as(FormatError, f"{folder}: the folder cannot be created"):
        folder.mkdir(parents=True, exist_ok=True)
    files = parameter_files(photometry.response, photometry.vignette, 255, photometry.caveat, values)
    return [write(folder / name) for name, write in files]


def _vignette_only(photometry: Photometry, program: str, place: Path, optics: Optics) -> Exported:
    if photometry.vignette is None:
        raise NotObservableError(f"{photometry.name}: has no vignette, which is all that is written for {program}")
    if program == "lensfun":
        fit = write_lensfun(photometry.vignette, place, optics)
    elif program == "adobe":
        fit = write_lcp(photometry.vignette, place, optics)
    else:
        fit = write_pto(photometry.vignette, place)
    left_out = "" if photometry.response is None else f"no response is written for {program}, only the vignette"
    return Exported((place,), tuple(filter(None, (fit.note, left_out, photometry.caveat))))


def _unknown(photometry: Photometry) -> tuple[str, ...]:
    """Return a note for each unknown part, with the remedy if the calibration has one."""
    notes: list[str] = []
    for name in ("response", "vignette"):
        if getattr(photometry, name) is None:
            verdict = None if photometry.calibration is None else photometry.calibration.verdicts.get(name)
            why = "" if verdict is None else "; ".join(filter(None, (verdict.reason, verdict.remedy)))
            notes.append(f"the {name} is unknown and was not written" + (f": {why}" if why else ""))
    return tuple(filter(None, (*notes, photometry.caveat)))
