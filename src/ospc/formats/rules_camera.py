"""The rules for camera.txt: intrinsics and rectification."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ospc.arrays import ImageSize
from ospc.errors import counted
from ospc.formats.files import BYTE_ORDER_MARK, read_text, write_text
from ospc.formats.rules import Broken, Context, Format, Program, mark_before
from ospc.formats.scanning import scanned

MODELS = {"KannalaBrandt": 8, "RadTan": 8, "EquiDistant": 8, "FOV": 5, "Pinhole": 5}
"""Names that DSO and its descendants support, and the number of parameters that follow."""

_BAD_LINE = {
    "dso": "prints one line, drops the camera and crashes",
    "mono": "prints one line and does not rectify",
}
_RECTIFICATIONS = ("crop", "full", "none")

_FEWEST_LEVELS = 3
"""Number of pyramid levels below which DSO prints that it will probably crash."""

_MOST_LEVELS = 6
"""Maximum number of pyramid levels in DSO."""

_SMALLEST_PIXELS = 5000
"""DSO does not halve images with fewer pixels."""

_SMALL_SIDE = 100
"""DSO warns about too few pyramid levels if both sides of the smallest level are longer."""

_LONGEST_RELATIVE_FOCAL = 20
"""Larger focal lengths relative to the image size are probably in pixels."""

_SHORTEST_FOCAL_PX = 5
"""Smaller focal lengths in pixels are probably relative to the image size."""

_LARGEST_OMEGA = 3.2
"""The angle omega of the FOV model is between 0 and π."""


def intrinsics(line: str, program: Program) -> tuple[str, list[float]]:
    """Return the camera model and the parameters in the first line; the name is empty if there is no model.

    The tools of the monocular data set only support the FOV model, without a name.
    """
    if program == "mono":
        values = scanned(line, "f" * 5)
        return ("FOV", values) if len(values) == 5 else ("", values)
    values = scanned(line, "f" * 8)
    if len(values) == 8:
        return "RadTan", values
    if len(values) >= 5:
        return ("Pinhole" if values[4] == 0 else "FOV"), values[:5]
    for name, count in MODELS.items():
        if line.startswith(name):
            values = scanned(line[len(name) :], "f" * count)
            return (name, values) if len(values) == count else ("", values)
    return "", values


def input_size(text: str) -> ImageSize | None:
    """Return width and height in the second line of a camera.txt, or None."""
    return _size(_lines(text)[1])


def _about_the_mark(text: str, context: Context) -> Iterator[Broken]:
    return mark_before(text, _BAD_LINE[context.program], str)


def _about_the_intrinsics(text: str, context: Context) -> Iterator[Broken]:
    line, program = _lines(text)[0], context.program
    model, values = intrinsics(line, program)
    if not model:
        effect = "does not rectify and does not know the image size"
        if program == "mono" and any(line.startswith(name) for name in MODELS):
            rule = f"line 1 is 'fx fy cx cy omega' without a name; it is {line[:30]!r}"
            yield Broken("error", rule, effect, "remove the name of the model")
            return
        rule = f"line 1 is 'fx fy cx cy omega', or the name of a model ({', '.join(MODELS)}) and its parameters"
        effect = "ends with 'could not read calib file'" if program == "dso" else effect
        yield Broken("error", f"{rule}; it is {line[:30]!r}", effect, "write the intrinsics on the first line")
        return
    fx, fy, cx, cy = values[:4]
    relative = cx < 1 and cy < 1
    too_long = relative and max(fx, fy) > _LONGEST_RELATIVE_FOCAL
    too_short = not relative and min(fx, fy) < _SHORTEST_FOCAL_PX
    if program == "mono" and not relative:
        rule = f"focal length and centre are relative to the image size; the centre is ({cx:g}, {cy:g})"
        yield Broken("error", rule, "multiplies them by the size again", "divide by width and height")
    elif (cx < 1) != (cy < 1) or too_long or too_short:
        rule = f"focal length and centre have the same unit; they are {fx:g} {fy:g} {cx:g} {cy:g}"
        effect = "treats all four as relative to the image size if both centre coordinates are below 1, or as pixels"
        yield Broken("error", rule, effect, "give all four relative to the image size, or all four in pixels")
    if model in ("FOV", "Pinhole") and not 0 <= values[4] < _LARGEST_OMEGA:
        rule = f"omega is an angle in radians; it is {values[4]:g}"
        yield Broken("error", rule, "rectifies with a nonsensical model", "check the fifth number")


def _about_the_input_size(text: str, context: Context) -> Iterator[Broken]:
    size, line = input_size(text), _lines(text)[1][:30]
    if size is None:
        rule = f"line 2 is 'width height' of the input images; it is {line!r}"
        yield Broken("error", rule, _BAD_LINE[context.program], "write the size of the images")
    elif context.size not in (None, size):
        rule = f"line 2 is the size of the input images, {_times(context.size)}; it is {line!r}"
        yield Broken("error", rule, "stops at the first image", "calibrate for this size, or crop to it")


def _about_the_rectification(text: str, context: Context) -> Iterator[Broken]:
    line, program = _lines(text)[2], context.program
    how = line.strip()
    if how in _RECTIFICATIONS and line != how:
        rule = f"line 3 is exactly 'crop', 'full' or 'none'; it is {line!r}, with white space around it"
        yield Broken("error", rule, _BAD_LINE[program], "save the file with Unix line ends", _strip_lines)
    if not _is_rectification(line):
        rule = f"line 3 is 'crop', 'full', 'none' or five numbers; it is {line[:30]!r}"
        yield Broken("error", rule, _BAD_LINE[program], "add a line 'crop'")
    if how == "full" and program == "dso":
        effect = "stops at an assertion because this is not implemented"
        yield Broken("error", "line 3 is not 'full'", effect, "use 'crop', 'none' or five numbers")
    if how == "none" and program == "mono":
        yield Broken("note", "line 3 is 'none'", "delivers images that are not rectified")


def _about_the_output_size(text: str, context: Context) -> Iterator[Broken]:
    _, _, how, line = _lines(text)
    if not _is_rectification(how) or (how.strip(), context.program) == ("none", "mono"):
        return
    before, size = input_size(text), _size(line)
    if size is None:
        rule = f"line 4 is 'width height' of the rectified images; it is {line[:30]!r}"
        yield Broken("error", rule, _BAD_LINE[context.program], "write the size of the rectified images")
    elif how.strip() == "none" and before not in (None, size):
        rule = f"with 'none' input and output size are the same; {_times(before)} becomes {_times(size)}"
        yield Broken("error", rule, "ends", "make lines 2 and 4 equal")
    if context.program != "dso" or size is None:
        return
    levels, (width, height) = 1, size
    while width % 2 == 0 and height % 2 == 0 and width * height > _SMALLEST_PIXELS and levels < _MOST_LEVELS:
        levels, width, height = levels + 1, width // 2, height // 2
    end = f"{_times(size)} ends at {width}×{height} after {counted(levels - 1, 'halving')}"
    rule = f"the rectified size can be halved several times; {end}"
    remedy = "choose a size on line 4 whose sides are multiples of 16 or 32"
    if levels < _FEWEST_LEVELS:
        yield Broken("error", rule, "prints that it will probably crash", remedy)
    elif width > _SMALL_SIDE and height > _SMALL_SIDE:
        yield Broken("warning", rule, "warns about too few pyramid levels and loses track sooner", remedy)


def _strip_lines(text: str, _context: Context) -> tuple[str, str]:
    stripped = "".join(f"{line.strip()}\n" for line in text.rstrip().split("\n"))
    return stripped, "changed to Unix line ends, and removed white space around lines"


def _lines(text: str) -> list[str]:
    """Return the four lines that the programs read; missing lines are empty."""
    return [*text.removeprefix(BYTE_ORDER_MARK).split("\n", 4), "", "", "", ""][:4]


def _is_rectification(line: str) -> bool:
    return line.strip() in _RECTIFICATIONS or len(scanned(line, "f" * 5)) == 5


def _size(line: str) -> ImageSize | None:
    size = scanned(line, "dd")
    return (int(size[0]), int(size[1])) if len(size) == 2 and min(size) > 0 and max(size) < math.inf else None


def _times(size: ImageSize | None) -> str:
    return "" if size is None else f"{size[0]}×{size[1]}"


CAMERA: Format[str] = Format(
    lambda path: read_text(path, keep_mark=True),
    lambda text, path: write_text(path, text),
    (_about_the_mark, _about_the_intrinsics, _about_the_input_size, _about_the_rectification, _about_the_output_size),
)
