"""The rules for vignette.png: the attenuation of every pixel."""

from __future__ import annotations

import math

import cv2
import numpy as np

from ospc.arrays import BoolArray, Image, ImageSize
from ospc.errors import FormatError
from ospc.formats.png import read_png, write_png
from ospc.formats.rules import UNCORRECTED, Context, Finding, Format, Rule

_STEEPEST_GAIN = 20
"""Corrections that multiply a pixel, and its noise, by more than this deserve a warning."""

_ASPECT_TOLERANCE = 0.01
"""Aspect ratios whose logarithms differ by more belong to different fields of view; less is rounding to pixels."""

_8_TO_16_BITS = 257
"""65535 / 255."""


def _size_is_known(image: Image, context: Context) -> Finding | None:
    if context.size is not None:
        return None
    width, height = _size_of(image)
    return Finding(
        "note",
        f"exactly the size of the input image, before rectification; this one has {width}x{height}",
        "was not compared, because the size of the images is unknown",
        "give --size, or check camera.txt with it",
    )


def _has_size_of_images(image: Image, context: Context) -> Finding | None:
    size = _size_of(image)
    if context.size is None or context.size == size:
        return None
    wanted = f"{context.size[0]}x{context.size[1]}"
    return Finding(
        "error",
        f"exactly the size of the input image, {wanted}, before rectification; this one has {size[0]}x{size[1]}",
        UNCORRECTED["dso"] if context.program == "dso" else "prints one line and corrects no vignette",
        "calibrate at this size"
        if _same_aspect(size, context.size)
        else "cut it to the part of the image that is used: the aspect ratios differ",
    )


def _resize(image: Image, context: Context) -> tuple[Image, str]:
    size, wanted = _size_of(image), context.size or _size_of(image)
    before, after = f"{size[0]}x{size[1]}", f"{wanted[0]}x{wanted[1]}"
    if not _same_aspect(size, wanted):
        raise FormatError(
            f"{before} and {after} differ in aspect ratio, so one is a crop of the other; cut the vignette to the "
            f"part of the image that is used"
        )
    how = cv2.INTER_AREA if wanted[0] < size[0] else cv2.INTER_LINEAR
    resized = cv2.resize(image, wanted, interpolation=how)
    return np.asarray(resized), f"resized from {before} to {after}, which keeps the field of view"


def _has_one_channel(image: Image, context: Context) -> Finding | None:
    if image.ndim == 2:
        return None
    rule = f"one channel; there are {image.shape[2]}"
    if context.program == "dso":
        effect = "reads it again as 8-bit grey and uses that: 256 steps only"
        return Finding("warning", rule, effect, "store it as 16-bit grey")
    effect = "stops at an assertion, or reads memory it never wrote if assertions are compiled out"
    return Finding("error", rule, effect, "store it as 16-bit grey")


def _turn_grey(image: Image, _context: Context) -> tuple[Image, str]:
    grey = cv2.cvtColor(np.ascontiguousarray(image[..., :3]), cv2.COLOR_BGR2GRAY)
    return np.asarray(grey), f"{image.shape[2]} channels turned to grey"


def _has_16_bits(image: Image, _context: Context) -> Finding | None:
    if image.dtype != np.uint8:
        return None
    effect = "accepts it; 256 steps show as rings in dark corners"
    return Finding("note", "16 bits are better than 8", effect, "write it with 16 bits if you can")


def _widen(image: Image, _context: Context) -> tuple[Image, str]:
    return image.astype(np.uint16) * _8_TO_16_BITS, "8 bits widened to 16"


def _is_not_black(image: Image, _context: Context) -> Finding | None:
    if image.max() > 0:
        return None
    effect = "divides zero by zero: every pixel becomes NaN"
    return Finding("error", "not black all over", effect, "calibrate the vignette again")


def _has_no_zero_inside(image: Image, _context: Context) -> Finding | None:
    zeros = _brightest_channel(image) == 0
    count = int(np.count_nonzero(zeros & ~_connected_to_border(zeros)))
    if not count or not image.max():
        return None
    rule = f"no pixel is 0; {count} are, inside the image"
    return Finding("error", rule, "divides by them: infinite brightness", "calibrate the vignette again")


def _has_no_zero_at_border(image: Image, _context: Context) -> Finding | None:
    count = int(np.count_nonzero(_connected_to_border(_brightest_channel(image) == 0)))
    if not count or not image.max():
        return None
    effect = "divides by them: infinite brightness there, harmless only if the rectification crops all of it"
    return Finding("warning", f"no pixel is 0; {count} are, in a surround at the border", effect, "crop the images")


def _raise_zeros(image: Image, _context: Context) -> tuple[Image, str]:
    return np.maximum(image, 1), f"{np.count_nonzero(image == 0)} pixels of 0 set to 1"


def _is_nowhere_dim(image: Image, context: Context) -> Finding | None:
    values = _brightest_channel(image)
    dim = int(np.count_nonzero((values < values.max() / _STEEPEST_GAIN) & (values > 0)))
    if not dim:
        return None
    rectified = " (it corrects before it rectifies)" if context.program == "dso" else ""
    return Finding(
        "warning",
        f"{dim} pixels are below 1/{_STEEPEST_GAIN} of the largest",
        f"multiplies them, and their noise, by more than that{rectified}",
        "mask or crop that part of the image",
    )


def _size_of(image: Image) -> ImageSize:
    return image.shape[1], image.shape[0]


def _same_aspect(a: ImageSize, b: ImageSize) -> bool:
    return abs(math.log((a[0] / a[1]) / (b[0] / b[1]))) <= _ASPECT_TOLERANCE


def _brightest_channel(image: Image) -> Image:
    return image if image.ndim == 2 else image[..., :3].max(axis=2)


def _connected_to_border(zeros: BoolArray) -> BoolArray:
    """Return the zero pixels in patches that touch the border, shape (height, width)."""
    count, labels = cv2.connectedComponents(zeros.astype(np.uint8), connectivity=4)
    at_border = np.zeros(count, dtype=bool)
    for edge in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        at_border[edge] = True
    return np.asarray(zeros & at_border[labels])


VIGNETTE: Format[Image] = Format(
    read=read_png,
    write=lambda image, path: write_png(path, image),
    rules=(
        Rule(_size_is_known),
        Rule(_has_size_of_images, _resize),
        Rule(_has_one_channel, _turn_grey),
        Rule(_has_16_bits, _widen),
        Rule(_is_not_black),
        Rule(_has_no_zero_inside, _raise_zeros),
        Rule(_has_no_zero_at_border, _raise_zeros),
        Rule(_is_nowhere_dim),
    ),
)
