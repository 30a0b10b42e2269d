"""The rules for vignette.png, the attenuation of every pixel."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from ospc.arrays import Image
from ospc.formats.findings import UNCORRECTED, Context, Finding
from ospc.formats.png import read_png

_REPAIR = "run with --repair for a mended copy"
_STEEPEST_GAIN = 20


def check_vignette(path: Path, context: Context) -> Iterator[Finding]:
    """Give what is to be said about a vignette.png.

    Raises
    ------
    FormatError
        If the file is no PNG or a damaged one.
    """
    name, program = str(path), context.program
    _, image = read_png(path)
    yield from _about_size(name, image, context)
    if image.ndim != 2:
        channels = f"one channel; there are {image.shape[2]}"
        if program == "dso":
            effect = "reads it once more as 8-bit grey and uses that: 256 steps only"
            yield Finding("warning", name, channels, effect, f"store it as 16-bit grey, or {_REPAIR}")
        else:
            effect = "stops at an assertion, or where those are compiled out divides by memory it never wrote"
            yield Finding("error", name, channels, effect, _REPAIR)
        image = image[..., :3].max(axis=2)
    elif image.dtype == np.uint8:
        effect = "accepts it; 256 steps show as rings in dark corners"
        yield Finding("note", name, "16 bits are better than 8", effect, "write it with 16 bits if you can")
    yield from _about_values(name, image, context)


def _about_size(name: str, image: Image, context: Context) -> Iterator[Finding]:
    height, width = image.shape[:2]
    if context.size is None:
        rule = f"exactly the size of the input image, before rectification; this one has {width}x{height}"
        effect = "was not compared, for the size of the images is unknown"
        yield Finding("note", name, rule, effect, "give --size, or camera.txt with it")
    elif context.size != (width, height):
        wanted = f"{context.size[0]}x{context.size[1]}"
        yield Finding(
            "error",
            name,
            f"exactly the size of the input image, {wanted}, before rectification; this one has {width}x{height}",
            UNCORRECTED[context.program] if context.program == "dso" else "prints one line and corrects no vignette",
            f"run with --repair --size {wanted} for a resized copy"
            if abs(context.size[0] * height - context.size[1] * width) <= 0.01 * context.size[0] * height
            else "cut it to the part of the image that is used: the aspect ratios differ",
        )


def _about_values(name: str, image: Image, context: Context) -> Iterator[Finding]:
    if image.max() == 0:
        effect = "divides zero by zero: every pixel becomes NaN"
        yield Finding("error", name, "not black all over", effect, "calibrate the vignette again")
        return
    zeros = image == 0
    inside = _not_connected_to_the_border(zeros)
    for count, severity, where in (
        (int(np.count_nonzero(inside)), "error", "inside the image"),
        (int(np.count_nonzero(zeros & ~inside)), "warning", "in a surround at the border"),
    ):
        if count:
            effect = "divides by them: infinite brightness"
            if severity == "warning":
                effect += " there, harmless only if the rectification crops all of it"
            rule = f"no pixel is 0; {count} are, {where}"
            yield Finding("error" if severity == "error" else "warning", name, rule, effect, _REPAIR)
    dim = int(np.count_nonzero((image < image.max() / _STEEPEST_GAIN) & ~zeros))
    if dim:
        yield Finding(
            "warning",
            name,
            f"{dim} pixels are below 1/{_STEEPEST_GAIN} of the largest",
            "multiplies them, and their noise, by more than that"
            + (" (it corrects before it rectifies)" if context.program == "dso" else ""),
            "mask or crop that part of the image",
        )


def _not_connected_to_the_border(zeros: np.ndarray) -> np.ndarray:
    """Return which zero pixels do not belong to a patch that touches the border, shape as given."""
    count, labels = cv2.connectedComponents(zeros.astype(np.uint8), connectivity=4)
    at_border = np.zeros(count, dtype=bool)
    for edge in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        at_border[edge] = True
    return np.asarray(zeros & ~at_border[labels])
