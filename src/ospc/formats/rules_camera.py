"""The rules for camera.txt: the intrinsics, and how the images are rectified."""

from __future__ import annotations

from ospc.arrays import ImageSize
from ospc.formats.files import read_text, write_text
from ospc.formats.rules import Context, Finding, Format, Program, Rule
from ospc.formats.scanning import scanned

_MODELS = {"KannalaBrandt": 8, "RadTan": 8, "EquiDistant": 8, "FOV": 5, "Pinhole": 5}
"""Names that DSO and its descendants know, and how many parameters follow each."""

_BAD_LINE = {
    "dso": "prints one line, gives up the camera and crashes",
    "mono": "prints one line and does not rectify",
}
_RECTIFICATIONS = ("crop", "full", "none")

_FEWEST_LEVELS = 3
"""Pyramid levels with fewer than which DSO says that it will probably crash."""

_MOST_LEVELS = 6
"""Pyramid levels that DSO builds at most."""

_SMALLEST_PIXELS = 5000
"""DSO halves no image of fewer pixels than this."""

_SMALL_SIDE = 100
"""DSO warns of too few pyramid levels if both sides of the smallest one are longer than this."""

_LONGEST_RELATIVE_FOCAL = 20
"""Focal lengths above this many image widths are taken to be in pixels."""

_SHORTEST_FOCAL_PX = 5
"""Focal lengths in pixels below this are taken to be relative to the image size."""

_LARGEST_OMEGA = 3.2
"""The angle omega of the FOV model lies between 0 and π."""


def intrinsics(line: str, program: Program) -> tuple[str, list[float]]:
    """Return the camera model that a first line names or implies, and its parameters; an empty name if there is none.

    Parameters
    ----------
    line
        First line of the file.
    program
        The monocular data set's tools know only the FOV model, without a name.
    """
    if program == "mono":
        values = scanned(line, "f" * 5)
        return ("FOV", values) if len(values) == 5 else ("", values)
    values = scanned(line, "f" * 8)
    if len(values) == 8:
        return "RadTan", values
    if len(values) >= 5:
        return ("Pinhole" if values[4] == 0 else "FOV"), values[:5]
    for name, count in _MODELS.items():
        if line.startswith(name):
            values = scanned(line[len(name) :], "f" * count)
            return (name, values) if len(values) == count else ("", values)
    return "", values


def input_size(text: str) -> ImageSize | None:
    """Return width and height on the second line of a camera.txt, or None."""
    return _size(_line(text, 2))


def _model_is_known(text: str, context: Context) -> Finding | None:
    line = _line(text, 1)
    if intrinsics(line, context.program)[0]:
        return None
    effect = "does not rectify and knows no image size"
    if context.program == "mono" and any(line.startswith(name) for name in _MODELS):
        rule = f"line 1 is 'fx fy cx cy omega' without a name; it is {line[:30]!r}"
        return Finding("error", rule, effect, "remove the name of the model")
    return Finding(
        "error",
        f"line 1 is 'fx fy cx cy omega', or the name of a model ({', '.join(_MODELS)}) and its parameters; "
        f"it is {line[:30]!r}",
        "ends with 'could not read calib file'" if context.program == "dso" else effect,
        "write the intrinsics on the first line",
    )


def _units_agree(text: str, context: Context) -> Finding | None:
    model, values = intrinsics(_line(text, 1), context.program)
    if not model:
        return None
    fx, fy, cx, cy = values[:4]
    relative = cx < 1 and cy < 1
    if context.program == "mono" and not relative:
        rule = f"focal length and centre are relative to the image size; the centre is ({cx:g}, {cy:g})"
        return Finding("error", rule, "multiplies them by the size once more", "divide by width and height")
    mixed = (cx < 1) != (cy < 1)
    too_long = relative and max(fx, fy) > _LONGEST_RELATIVE_FOCAL
    too_short = not relative and min(fx, fy) < _SHORTEST_FOCAL_PX
    if not (mixed or too_long or too_short):
        return None
    rule = f"focal length and centre have the same unit; they are {fx:g} {fy:g} {cx:g} {cy:g}"
    effect = "takes all four as relative to the image size if both centre coordinates are below 1, else as pixels"
    return Finding("error", rule, effect, "give all four relative to the image size, or all four in pixels")


def _omega_is_an_angle(text: str, context: Context) -> Finding | None:
    model, values = intrinsics(_line(text, 1), context.program)
    if model not in ("FOV", "Pinhole") or 0 <= values[4] < _LARGEST_OMEGA:
        return None
    rule = f"omega is an angle in radians; it is {values[4]:g}"
    return Finding("error", rule, "rectifies with a nonsensical model", "check the fifth number")


def _input_size_is_given(text: str, context: Context) -> Finding | None:
    size, line = input_size(text), _line(text, 2)[:30]
    if size is None:
        rule = f"line 2 is 'width height' of the input images; it is {line!r}"
        return Finding("error", rule, _BAD_LINE[context.program], "write the size of the images")
    if context.size is None or size == context.size:
        return None
    rule = f"line 2 is the size of the input images, {context.size[0]}x{context.size[1]}; it is {line!r}"
    return Finding("error", rule, "stops at the first image", "calibrate for this size, or crop to it")


def _no_trailing_space(text: str, context: Context) -> Finding | None:
    line = _line(text, 3)
    if line == line.strip() or line.strip() not in _RECTIFICATIONS:
        return None
    rule = f"line 3 is exactly 'crop', 'full' or 'none'; it is {line!r}, with white space around it"
    return Finding("error", rule, _BAD_LINE[context.program], "store the file with Unix line ends")


def _strip_lines(text: str, _context: Context) -> tuple[str, str]:
    stripped = "".join(f"{line.strip()}\n" for line in text.rstrip().split("\n"))
    return stripped, "line ends changed to those of Unix, and white space around lines dropped"


def _rectification_is_known(text: str, context: Context) -> Finding | None:
    how = _line(text, 3)
    if _rectification(text) or len(scanned(how, "f" * 5)) == 5:
        return None
    rule = f"line 3 is 'crop', 'full', 'none' or five numbers; it is {how[:30]!r}"
    return Finding("error", rule, _BAD_LINE[context.program], "add a line 'crop'")


def _rectification_is_implemented(text: str, context: Context) -> Finding | None:
    how = _rectification(text)
    if how == "full" and context.program == "dso":
        effect = "stops at an assertion: this is not implemented"
        return Finding("error", "line 3 is not 'full'", effect, "use 'crop', 'none' or five numbers")
    if how == "none" and context.program == "mono":
        return Finding("note", "line 3 is 'none'", "delivers images that are not rectified")
    return None


def _output_size_is_given(text: str, context: Context) -> Finding | None:
    if not _needs_output_size(text, context):
        return None
    size = _output_size(text)
    if size is None:
        rule = f"line 4 is 'width height' of the rectified images; it is {_line(text, 4)[:30]!r}"
        return Finding("error", rule, _BAD_LINE[context.program], "write the size of the rectified images")
    before = input_size(text)
    if _rectification(text) != "none" or before in (None, size):
        return None
    rule = f"with 'none' input and output size are the same; {_times(before)} becomes {_times(size)}"
    return Finding("error", rule, "ends", "make lines 2 and 4 equal")


def _output_can_be_halved(text: str, context: Context) -> Finding | None:
    size = _output_size(text)
    if context.program != "dso" or size is None or not _needs_output_size(text, context):
        return None
    levels, (width, height) = 1, size
    while width % 2 == 0 and height % 2 == 0 and width * height > _SMALLEST_PIXELS and levels < _MOST_LEVELS:
        levels, width, height = levels + 1, width // 2, height // 2
    rule = (
        f"the rectified size can be halved several times; {_times(size)} ends at {width}x{height} after {levels - 1}"
    )
    remedy = "choose a size on line 4 whose sides are multiples of 16 or 32"
    if levels < _FEWEST_LEVELS:
        return Finding("error", rule, "says it will probably crash", remedy)
    if width > _SMALL_SIDE and height > _SMALL_SIDE:
        return Finding("warning", rule, "warns of too few pyramid levels and loses track sooner", remedy)
    return None


def _line(text: str, number: int) -> str:
    return [*text.split("\n"), "", "", "", ""][number - 1]


def _rectification(text: str) -> str:
    """Return 'crop', 'full' or 'none'; empty if line 3 is none of these."""
    how = _line(text, 3).strip()
    return how if how in _RECTIFICATIONS else ""


def _needs_output_size(text: str, context: Context) -> bool:
    how = _rectification(text)
    return bool(how or len(scanned(_line(text, 3), "f" * 5)) == 5) and (how, context.program) != ("none", "mono")


def _output_size(text: str) -> ImageSize | None:
    return _size(_line(text, 4))


def _size(line: str) -> ImageSize | None:
    size = scanned(line, "dd")
    return (int(size[0]), int(size[1])) if len(size) == 2 and min(size) > 0 else None


def _times(size: ImageSize | None) -> str:
    return "" if size is None else f"{size[0]}x{size[1]}"


CAMERA: Format[str] = Format(
    read=read_text,
    write=lambda text, path: write_text(path, text),
    rules=(
        Rule(_model_is_known),
        Rule(_units_agree),
        Rule(_omega_is_an_angle),
        Rule(_input_size_is_given),
        Rule(_no_trailing_space, _strip_lines),
        Rule(_rectification_is_known),
        Rule(_rectification_is_implemented),
        Rule(_output_size_is_given),
        Rule(_output_can_be_halved),
    ),
)
