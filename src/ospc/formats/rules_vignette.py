"""The rules for vignette.png: the attenuation of every pixel."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from ospc.arrays import BoolArray, Image, size_of
from ospc.errors import FormatError, counted
from ospc.formats.image_files import read_png, write_png
from ospc.formats.resize import resampled
from ospc.formats.rules import UNCORRECTED, Broken, Context, Format
from ospc.photometry.geometry import same_aspect

_STEEPEST_GAIN = 20
"""Factor above which the correction of a pixel, which also amplifies its noise, causes a warning."""

_CENTRE, _BORDER = 1 / 8, 1 / 16
"""Width of the centre and of the border, as fractions of the image."""

_BRIGHTER_BORDER = 1.03
"""Ratio of border to centre above which the file is probably the correction and not the attenuation: no lens makes
the border brighter, and estimates of flat vignettes differ less."""


def _about_the_size(image: Image, context: Context) -> Iterator[Broken]:
    size, wanted = size_of(image), context.size
    if wanted is None:
        rule = f"exactly the size of the input image, before rectification; this one is {size[0]}×{size[1]}"
        effect = "was not compared, because the size of the images is unknown"
        yield Broken("note", rule, effect, "give --size, or check camera.txt with it")
    elif wanted != size:
        both = f"{wanted[0]}×{wanted[1]}, before rectification; this one is {size[0]}×{size[1]}"
        effect = UNCORRECTED["dso"] if context.program == "dso" else "prints one line and corrects no vignette"
        cut = "crop it to the part of the image that is used, because the aspect ratios differ"
        remedy = "calibrate at this size" if same_aspect(size, wanted) else cut
        yield Broken("error", f"exactly the size of the input image, {both}", effect, remedy, _resize)


def _about_the_type(image: Image, context: Context) -> Iterator[Broken]:
    if image.ndim > 2:
        rule, remedy = f"one channel; there are {image.shape[2]}", "save it as 16-bit grey"
        if context.program == "dso":
            effect = "reads it again as 8-bit grey, with only 256 steps"
            yield Broken("warning", rule, effect, remedy, _turn_grey)
        else:
            effect = "stops at an assertion, or reads uninitialised memory if assertions are compiled out"
            yield Broken("error", rule, effect, remedy, _turn_grey)
    if image.dtype == np.uint8:
        effect = "accepts it; its 256 steps are visible as rings in dark corners"
        yield Broken("note", "16 bits are better than 8", effect, "save it with 16 bits if possible", _widen)


def _about_the_values(image: Image, context: Context) -> Iterator[Broken]:
    values = image if image.ndim == 2 else image[..., :3].max(axis=2)
    if values.max() == 0:
        effect = "divides zero by zero, so that every pixel becomes NaN"
        yield Broken("error", "not entirely black", effect, "calibrate the vignette again")
        return
    zeros = values == 0
    at_border = _connected_to_border(zeros)
    if inside := np.count_nonzero(zeros & ~at_border):
        rule = f"no pixel is 0; {counted(inside, 'pixel')} of 0 inside the image"
        effect = "divides by them, which gives infinite brightness"
        yield Broken("error", rule, effect, "calibrate the vignette again", _raise_zeros)
    if surround := np.count_nonzero(at_border):
        rule = f"no pixel is 0; {counted(surround, 'pixel')} of 0 in a surround at the border"
        effect = "divides by them, which gives infinite brightness there, harmless only if rectification crops it"
        yield Broken("warning", rule, effect, "crop the images", _raise_zeros)
    if dim := np.count_nonzero((values < values.max() / _STEEPEST_GAIN) & (values > 0)):
        rule = f"{counted(dim, 'pixel')} below 1/{_STEEPEST_GAIN} of the largest"
        rectified = " (it corrects before it rectifies)" if context.program == "dso" else ""
        effect = f"multiplies them, and their noise, by more than {_STEEPEST_GAIN}{rectified}"
        yield Broken("warning", rule, effect, "mask or crop this part of the image")


def _about_the_direction(image: Image, _context: Context) -> Iterator[Broken]:
    values = image if image.ndim == 2 else image[..., :3].max(axis=2)
    if _border_mean(values) > _BRIGHTER_BORDER * _centre_mean(values) > 0:
        rule = "the attenuation V, which is largest near the centre; this looks like 1/V, largest at the border"
        effect = "divides by it, which doubles the vignette instead of removing it"
        yield Broken("warning", rule, effect, "save the attenuation, 1 divided by these values")


def _centre_mean(values: Image) -> float:
    height, width = (max(1, round(side * _CENTRE)) for side in values.shape)
    top, left = (values.shape[0] - height) // 2, (values.shape[1] - width) // 2
    return float(values[top : top + height, left : left + width].mean())


def _border_mean(values: Image) -> float:
    rows, columns = (max(1, round(side * _BORDER)) for side in values.shape)
    border = np.ones(values.shape, dtype=bool)
    border[rows:-rows, columns:-columns] = False
    return float(values[border].mean())


def _resize(image: Image, context: Context) -> tuple[Image, str]:
    size = size_of(image)
    wanted = context.size or size
    before, after = f"{size[0]}×{size[1]}", f"{wanted[0]}×{wanted[1]}"
    if not same_aspect(size, wanted):
        raise FormatError(
            f"{before} and {after} differ in aspect ratio, so one is a crop of the other; crop the vignette to the "
            f"part of the image that is used"
        )
    return resampled(image, wanted), f"resized from {before} to {after}, with the same field of view"


def _turn_grey(image: Image, _context: Context) -> tuple[Image, str]:
    grey = cv2.cvtColor(np.ascontiguousarray(image[..., :3]), cv2.COLOR_BGR2GRAY)
    return np.asarray(grey), f"converted {image.shape[2]} channels to grey"


def _widen(image: Image, _context: Context) -> tuple[Image, str]:
    return image.astype(np.uint16) * (65535 // 255), "converted 8 bits to 16"


def _raise_zeros(image: Image, _context: Context) -> tuple[Image, str]:
    return np.maximum(image, 1), f"set {counted(np.count_nonzero(image == 0), 'pixel')} of 0 to 1"


def _connected_to_border(zeros: BoolArray) -> BoolArray:
    """Return the zero pixels in regions that touch the border, shape (height, width)."""
    _, labels = cv2.connectedComponents(np.pad(zeros, 1, constant_values=True).astype(np.uint8), connectivity=4)
    return np.asarray(zeros & (labels == labels[0, 0])[1:-1, 1:-1])


VIGNETTE: Format[Image] = Format(
    read_png,
    lambda image, path: write_png(path, image),
    (_about_the_size, _about_the_type, _about_the_values, _about_the_direction),
)
