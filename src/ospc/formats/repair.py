"""Mended copies of parameter files that other programs refuse, and what was changed in them."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import scipy.optimize

from ospc.arrays import BoolArray, FloatArray, Image, ImageSize
from ospc.errors import FormatError
from ospc.formats.dso import FEWEST_VALUES, LARGEST_ID, strictly_increasing_float32, write_times
from ospc.formats.files import read_text, write_text
from ospc.formats.png import read_png, write_png
from ospc.formats.rules_times import TimesLines, scan_times
from ospc.formats.validation import ParameterFile, image_names

_MOST_INVENTED = 0.1
_LARGEST_VALUE = 1e30
_ASPECT_TOLERANCE = 0.01


@dataclass(frozen=True)
class Repair:
    """A mended copy of a parameter file.

    Attributes
    ----------
    source
        The file as it was; it is not touched.
    path
        The copy.
    changes
        What was changed, a sentence each; empty if nothing had to be, and then there is no copy.
    """

    source: Path
    path: Path
    changes: tuple[str, ...]


def repair(file: ParameterFile, size: ImageSize | None = None) -> Repair:
    """Write ``<name>.repaired.<ext>`` beside a parameter file unless nothing needs mending.

    Parameters
    ----------
    file
        The file and its kind.
    size
        Width and height a vignette shall have; its own where not given.

    Raises
    ------
    FormatError
        If mending it would mean inventing its content: too few values, a curve that falls as a whole, a vignette of
        another aspect ratio, lines that cannot be told to which image they belong.
    """
    target = file.path.with_name(f"{file.path.stem}.repaired{file.path.suffix}")
    if file.kind == "vignette":
        changes = _mend_vignette(file.path, target, size)
    else:
        mend = {"pcalib": _mend_pcalib, "times": _mend_times, "camera": _mend_camera}[file.kind]
        changes = mend(file.path, target)
    return Repair(file.path, target, tuple(changes))


def _mend_pcalib(source: Path, target: Path) -> list[str]:
    changes: list[str] = []
    values = _table(source, read_text(source), changes)
    known = np.abs(values) < _LARGEST_VALUE
    if not known.all():
        if not (known[0] and known[-1]) or np.mean(~known) > _MOST_INVENTED:
            raise FormatError(f"{source}: too many values, or an end, are no numbers; calibrate again")
        values[~known] = np.interp(np.flatnonzero(~known), np.flatnonzero(known), values[known])
        changes.append(f"{np.count_nonzero(~known)} values that are no numbers interpolated between their neighbours")
    if values[-1] <= values[0]:
        raise FormatError(
            f"{source}: falls from {values[0]:g} to {values[-1]:g} and so is no inverse response; calibrate again"
        )
    if np.any(np.diff(values.astype(np.float32)) <= 0):
        values = _increasing(values, changes)
    if values.size != FEWEST_VALUES:
        changes.append(f"{values.size} values resampled to {FEWEST_VALUES}: the table for 8-bit images")
        values = np.interp(np.linspace(0, 1, FEWEST_VALUES), np.linspace(0, 1, values.size), values)
    if changes:
        table = strictly_increasing_float32(255 * (values - values[0]) / (values[-1] - values[0]))
        write_text(target, " ".join(f"{value:.9g}" for value in table) + "\n")
    return changes


def _table(source: Path, text: str, changes: list[str]) -> FloatArray:
    """Return the values of a table, whatever separates them; words that are no numbers are left out."""
    lines = [line for line in text.splitlines() if line.strip()]
    first = lines[0] if lines else ""
    words = _words(first)
    if len(words) == 1 and len(lines) >= FEWEST_VALUES:
        words = [word for line in lines for word in _words(line)]
        changes.append(f"the values of {len(lines)} lines put on one line")
    elif len(lines) > 1:
        changes.append(f"all after the first line dropped, beginning with {lines[1].strip()[:30]!r}")
    if "," in first or ";" in first:
        changes.append("commas or semicolons replaced by spaces")
    numbers = [_number(word) for word in words]
    end = next((i for i, number in enumerate(numbers) if number is None), len(words))
    if FEWEST_VALUES <= end < len(words):  # what follows a complete table is a remark, its numbers included
        changes.append(f"text after value {end} dropped: {' '.join(words[end:])[:30]!r}")
        words, numbers = words[:end], numbers[:end]
    texts = [word for word, number in zip(words, numbers, strict=True) if number is None]
    if texts:
        changes.append(f"words that are no numbers dropped: {' '.join(texts)[:30]!r}")
    values = np.array([number for number in numbers if number is not None], dtype=np.float64)
    if values.size < FEWEST_VALUES:
        raise FormatError(
            f"{source}: has {values.size} values, and nothing says to which grey levels they belong; "
            f"write the {FEWEST_VALUES} values of an 8-bit camera"
        )
    return values


def _words(line: str) -> list[str]:
    return re.split(r"[\s,;]+", line.strip(" \t\r,;"))


def _number(word: str) -> float | None:
    try:
        return float(word)
    except ValueError:
        return None


def _increasing(values: FloatArray, changes: list[str]) -> FloatArray:
    """Return the least-squares nearest increasing curve with the same ends where these are its extremes."""
    monotone = np.asarray(scipy.optimize.isotonic_regression(values).x)
    span = float(monotone[-1] - monotone[0])
    moved = np.abs(monotone - values)
    falls = int(np.count_nonzero(np.diff(values) < 0))
    if falls:
        changes.append(
            f"{falls} values that fall levelled by isotonic regression; {np.count_nonzero(moved > 1e-9 * span)} "
            f"values move, by {100 * float(moved.max()) / span:.3g} % of the range at most"
        )
    changes.append("values equal as 32-bit floats moved apart by the least representable steps")
    return monotone


def _mend_vignette(source: Path, target: Path, size: ImageSize | None) -> list[str]:
    _, image = read_png(source)
    changes: list[str] = []
    if image.ndim == 3:
        changes.append(f"{image.shape[2]} channels turned to grey")
        image = cv2.cvtColor(np.ascontiguousarray(image[..., :3]), cv2.COLOR_BGR2GRAY)
    if image.max() == 0:
        raise FormatError(f"{source}: is black all over; calibrate the vignette again")
    if size is not None and size != (image.shape[1], image.shape[0]):
        image = _resized(source, image, size, changes)
    zeros = int(np.count_nonzero(image == 0))
    if zeros:
        changes.append(f"{zeros} pixels of 0 set to 1 of 65535")
    if changes:
        if image.dtype == np.uint8:
            image = image.astype(np.uint16) * 257
            changes.append("8 bits widened to 16")
        write_png(target, np.maximum(image, 1))
    return changes


def _resized(source: Path, image: Image, size: ImageSize, changes: list[str]) -> Image:
    height, width = image.shape
    if abs(math.log((size[0] / size[1]) / (width / height))) > _ASPECT_TOLERANCE:
        raise FormatError(
            f"{source}: {width}x{height} and {size[0]}x{size[1]} differ in aspect ratio, so that one is a crop of "
            f"the other; cut the vignette to the part of the image that is used"
        )
    changes.append(f"resized from {width}x{height} to {size[0]}x{size[1]}, which keeps the field of view")
    shrinking = size[0] < width
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA if shrinking else cv2.INTER_LINEAR))


def _mend_times(source: Path, target: Path) -> list[str]:
    changes: list[str] = []
    text = read_text(source)
    plain = re.sub(r"[,;]", " ", text)
    if plain != text:
        changes.append("commas or semicolons replaced by spaces")
    names, lines = _named_lines(plain, changes)
    images = image_names(source.parent)
    if images is not None and len(images) != len(names):
        lines = _lines_of_images(source, lines, names, images, changes)
    if lines.ids.size == 0:
        raise FormatError(f"{source}: has no line 'id stamp[s] exposure[ms]'; write it anew")
    exposures = _filled(source, lines.exposures_ms, changes)
    if changes:
        write_times(target, [int(i) for i in lines.ids], lines.stamps_s, exposures)
    return changes


def _named_lines(text: str, changes: list[str]) -> tuple[list[str], TimesLines]:
    """Return the first word of every line with a stamp, and the lines with integer ids."""
    kept: list[str] = []
    names: list[str] = []
    other = 0
    for line in text.splitlines():
        words = line.split()
        numbers = [_number(word) for word in words[1:3]]
        if len(words) >= 2 and None not in numbers and not words[0].startswith("#"):
            names.append(words[0])
            kept.append(" ".join(words[1:3]))
        elif words and not words[0].startswith("#"):
            other += 1
    if other:
        changes.append(f"{other} lines without stamp dropped")
    fits = all(re.fullmatch(r"[0-9]{1,19}", name) and int(name) <= LARGEST_ID for name in names)
    if not fits:
        changes.append("ids that are no 32-bit integers replaced by the numbers 0, 1, 2, …")
    ids = names if fits else [str(i) for i in range(len(names))]
    return names, scan_times("\n".join(f"{i} {rest}" for i, rest in zip(ids, kept, strict=True)))


def _lines_of_images(
    source: Path, lines: TimesLines, names: list[str], images: list[str], changes: list[str]
) -> TimesLines:
    """Return the lines whose ids are the names of the images, in the order of the images."""
    place = {Path(name).stem: i for i, name in enumerate(names)}
    rows = [place.get(Path(image).stem, -1) for image in images]
    if min(rows, default=-1) < 0:
        missing = images[rows.index(-1)] if rows else "all"
        raise FormatError(
            f"{source}: {len(names)} lines for {len(images)} images, and no line is called like the image {missing}, "
            f"so nothing says which line belongs to which image; write it anew from the recording's source"
        )
    changes.append(f"{len(names) - len(rows)} lines without an image dropped")
    keep = np.array(rows)
    return TimesLines(lines.ids[keep], lines.stamps_s[keep], lines.exposures_ms[keep], (), (), None)


def _filled(source: Path, exposures: FloatArray, changes: list[str]) -> FloatArray:
    """Return the exposures with the missing ones interpolated in the logarithm."""
    known: BoolArray = np.isfinite(exposures) & (exposures > 0)
    if known.all():
        return exposures
    missing = int(np.count_nonzero(~known))
    if missing > _MOST_INVENTED * exposures.size:
        raise FormatError(
            f"{source}: {missing} of {exposures.size} exposures are missing, too many to interpolate; record them, "
            f"or leave the third column out"
        )
    places = np.arange(exposures.size)
    filled = exposures.copy()
    filled[~known] = np.exp(np.interp(places[~known], places[known], np.log(exposures[known])))
    changes.append(f"{missing} missing or invalid exposures interpolated between their neighbours")
    return filled


def _mend_camera(source: Path, target: Path) -> list[str]:
    text = read_text(source)
    mended = "".join(f"{line.rstrip()}\n" for line in text.splitlines())
    if mended.rstrip("\n") == text.rstrip("\n"):
        return []
    write_text(target, mended)
    return ["line ends made those of Unix, and white space at the ends of lines dropped"]
