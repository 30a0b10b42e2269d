"""The rules for camera.txt, the intrinsics and how the images are rectified."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ospc.arrays import ImageSize
from ospc.formats.files import read_text
from ospc.formats.findings import Context, Finding, Program
from ospc.formats.scanning import scanned

_PREFIXED = {"KannalaBrandt": 8, "RadTan": 8, "EquiDistant": 8, "FOV": 5, "Pinhole": 5}
_CROP_EFFECT = {
    "dso": "prints one line, gives up the camera and crashes",
    "mono": "prints one line and does not rectify",
}
_FEWEST_LEVELS = 3
_MOST_LEVELS = 6


def intrinsics(line: str, program: Program) -> tuple[str, list[float]]:
    """Return the camera model a first line names or implies, and its parameters; an empty name if it is none.

    Parameters
    ----------
    line
        First line of the file.
    program
        The monocular data set's tools know the FOV model without a name only.
    """
    if program == "mono":
        values = scanned(line, "f" * 5)
        return ("FOV", values) if len(values) == 5 else ("", values)
    values = scanned(line, "f" * 8)
    if len(values) == 8:
        return "RadTan", values
    if len(values) >= 5:
        return ("Pinhole" if values[4] == 0 else "FOV"), values[:5]
    for name, count in _PREFIXED.items():
        if line.startswith(name):
            values = scanned(line[len(name) :], "f" * count)
            return (name, values) if len(values) == count else ("", values)
    return "", values


def input_size(text: str) -> ImageSize | None:
    """Return width and height on the second line of a camera.txt, or None."""
    lines = text.split("\n")
    size = scanned(lines[1], "dd") if len(lines) > 1 else []
    return (int(size[0]), int(size[1])) if len(size) == 2 and min(size) > 0 else None


def check_camera(path: Path, context: Context) -> Iterator[Finding]:
    """Give what is to be said about a camera.txt.

    Raises
    ------
    FormatError
        If the file cannot be read.
    """
    name, program = str(path), context.program
    text = read_text(path)
    lines = [*text.split("\n"), "", "", "", ""][:4]
    model, values = intrinsics(lines[0], program)
    if not model:
        yield _bad_model(name, lines[0], program)
    else:
        yield from _about_centre(name, model, values, program)
    size = input_size(text)
    if size is None:
        rule = f"line 2 is 'width height' of the input images; it is {lines[1][:30]!r}"
        yield Finding("error", name, rule, _CROP_EFFECT[program], "write the size of the images")
    elif context.size is not None and size != context.size:
        rule = f"line 2 is the size of the input images, {context.size[0]}x{context.size[1]}; it is {lines[1][:30]!r}"
        yield Finding("error", name, rule, "stops at the first image", "calibrate for, or crop to, this size")
    yield from _about_output(name, lines[2], lines[3], size, program)


def _bad_model(name: str, line: str, program: Program) -> Finding:
    if program == "mono" and any(line.startswith(prefix) for prefix in _PREFIXED):
        rule = f"line 1 is 'fx fy cx cy omega' without a name; it is {line[:30]!r}"
        return Finding("error", name, rule, "does not rectify and knows no image size", "remove the model's name")
    return Finding(
        "error",
        name,
        f"line 1 is 'fx fy cx cy omega', or a model's name ({', '.join(_PREFIXED)}) and its parameters; "
        f"it is {line[:30]!r}",
        "ends with 'could not read calib file'" if program == "dso" else "does not rectify and knows no image size",
        "write the intrinsics on the first line",
    )


def _about_centre(name: str, model: str, values: list[float], program: Program) -> Iterator[Finding]:
    fx, fy, cx, cy = values[:4]
    relative = cx < 1 and cy < 1
    if program == "mono" and not relative:
        rule = f"focal length and centre are relative to the image size; the centre is ({cx:g}, {cy:g})"
        yield Finding("error", name, rule, "multiplies them by the size once more", "divide by width and height")
    elif (cx < 1) != (cy < 1) or (relative and max(fx, fy) > 20) or (not relative and min(fx, fy) < 5):
        rule = f"focal length and centre have the same unit; they are {fx:g} {fy:g} {cx:g} {cy:g}"
        effect = "takes all four as relative to the image size if both centre coordinates are below 1, else as pixels"
        yield Finding("error", name, rule, effect, "give all four relative, or all four in pixels")
    if model in ("FOV", "Pinhole") and not 0 <= values[4] < 3.2:
        rule = f"omega is an angle in radians; it is {values[4]:g}"
        yield Finding("error", name, rule, "rectifies with a nonsensical model", "check the fifth number")


def _about_output(name: str, line_3: str, line_4: str, size: ImageSize | None, program: Program) -> Iterator[Finding]:
    how = line_3
    if how.strip() in ("crop", "full", "none") and how != how.strip():
        rule = f"line 3 is exactly 'crop', 'full' or 'none'; it is {how!r}, with white space after it"
        remedy = "store the file with Unix line ends, or run with --repair for a mended copy"
        yield Finding("error", name, rule, _CROP_EFFECT[program], remedy)
        how = how.strip()
    elif how not in ("crop", "full", "none") and len(scanned(how, "f" * 5)) < 5:
        rule = f"line 3 is 'crop', 'full', 'none' or five numbers; it is {how[:30]!r}"
        yield Finding("error", name, rule, _CROP_EFFECT[program], "add a line 'crop'")
        return
    if how == "full" and program == "dso":
        effect = "stops at an assertion: this is not written"
        yield Finding("error", name, "line 3 is not 'full'", effect, "use 'crop', 'none' or five numbers")
    if how == "none" and program == "mono":
        yield Finding("note", name, "line 3 is 'none'", "delivers images that are not rectified")
        return
    output = scanned(line_4, "dd")
    if len(output) < 2 or min(output) <= 0:
        rule = f"line 4 is 'width height' of the rectified images; it is {line_4[:30]!r}"
        yield Finding("error", name, rule, _CROP_EFFECT[program], "write the size to rectify to")
        return
    width, height = int(output[0]), int(output[1])
    if how == "none" and size is not None and (width, height) != size:
        rule = f"with 'none' input and output size are the same; {size[0]}x{size[1]} becomes {width}x{height}"
        yield Finding("error", name, rule, "ends", "make lines 2 and 4 equal")
    if program == "dso":
        yield from _about_pyramid(name, width, height)


def _about_pyramid(name: str, width: int, height: int) -> Iterator[Finding]:
    levels, w, h = 1, width, height
    while w % 2 == 0 and h % 2 == 0 and w * h > 5000 and levels < _MOST_LEVELS:
        levels, w, h = levels + 1, w // 2, h // 2
    rule = f"the rectified size can be halved several times; {width}x{height} ends at {w}x{h} after {levels - 1}"
    remedy = "choose a size on line 4 whose sides are multiples of 16 or 32"
    if levels < _FEWEST_LEVELS:
        yield Finding("error", name, rule, "says it will probably crash", remedy)
    elif w > 100 and h > 100:
        yield Finding("warning", name, rule, "warns of too few pyramid levels and loses track sooner", remedy)
