"""Faults of the sequence: images lost, repeated, shuffled or resized, and inconsistent files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import compress

import cv2
import numpy as np

from ospc.arrays import BoolArray, Image, IntArray
from ospc.photometry.vignette import RasterVignette
from ospc.research.faults.footage import Fault, Footage


def _renumbered(footage: Footage, kept: BoolArray) -> Footage:
    """Lose images while numbering and exposures continue, so that every later image gets a wrong exposure."""
    first = footage.chosen(np.arange(len(footage)) < np.count_nonzero(kept))
    return first.with_images(footage.chosen(kept).images)


def _reordered(footage: Footage, order: IntArray) -> Footage:
    """Show images in another order, possibly repeated, without their exposures."""
    return footage.with_images(footage.images[i] for i in order)


def _moved(footage: Footage, order: IntArray) -> Footage:
    """Show images in another order, together with their exposures."""
    return _reordered(footage, order).with_exposures(footage.exposures_ms[order])


def _repeated(footage: Footage, share: float) -> Footage:
    """Replace frames by a repetition of the frame before them, with its exposure."""
    repeats = footage.some(share)
    return _moved(footage, np.maximum.accumulate(np.where(repeats, 0, np.arange(len(footage)))))


def _from_a_third(footage: Footage, count: float) -> BoolArray:
    """Return a mask of ``count`` frames from a third of the recording on, shape (frames,)."""
    numbers = np.arange(len(footage)) - len(footage) // 3
    return (numbers >= 0) & (numbers < count)


def _frozen(footage: Footage, share: float) -> Footage:
    """Freeze the picture from a third of the recording on while exposures continue."""
    frozen = _from_a_third(footage, round(share * len(footage)))
    return _reordered(footage, np.where(frozen, len(footage) // 3, np.arange(len(footage))))


def _cuts(footage: Footage, length: float) -> Footage:
    """Shuffle pieces of ``length`` frames, with their exposures."""
    pieces = np.array_split(np.arange(len(footage)), max(2, len(footage) // int(length)))
    return _moved(footage, np.concatenate([pieces[i] for i in footage.random.permutation(len(pieces))]))


def _changed(footage: Footage, chosen: BoolArray, change: Callable[[Image], Image]) -> Footage:
    return footage.with_images(change(image) if chosen[i] else image for i, image in enumerate(footage.images))


def _since_midway(footage: Footage, change: Callable[[Image], Image]) -> Footage:
    return _changed(footage, np.arange(len(footage)) >= footage.half, change)


def _cut_off(image: Image) -> Image:
    torn = image.copy()
    torn[image.shape[0] // 2 :] = 128
    return torn


def _interlaced(footage: Footage, frames: float) -> Footage:
    def woven(i: int) -> Image:
        image = footage.images[i].copy()
        image[1::2] = footage.images[min(i + int(frames), len(footage) - 1)][1::2]
        return image

    return footage.with_images(woven(i) for i in range(len(footage)))


def _warped(image: Image, view: list[list[float]]) -> Image:
    size = image.shape[::-1]
    return np.asarray(cv2.warpAffine(image, np.array(view), size, borderMode=cv2.BORDER_REPLICATE))


def _zoomed_in(image: Image, factor: float, shift: tuple[float, float] = (0.0, 0.0)) -> Image:
    height, width = image.shape
    x, y = ((1 - factor) * (width - 1) / 2 + shift[0], (1 - factor) * (height - 1) / 2 + shift[1])
    return _warped(image, [[factor, 0.0, x], [0.0, factor, y]])


def _stabilised(footage: Footage, shift_px: float) -> Footage:
    """Shift a crop of the images about the middle; the true vignette is that of the central crop."""
    factor = 1 + 4 * shift_px / footage.images[0].shape[1]
    moves = shift_px * np.clip(footage.random.standard_normal((len(footage), 2)), -2, 2)
    images = (_zoomed_in(image, factor, tuple(moves[i])) for i, image in enumerate(footage.images))
    known = None if footage.vignette is None else RasterVignette(_zoomed_in(footage.vignette.image(), factor))
    return replace(footage.with_images(images), vignette=known)


def _sheared(footage: Footage, shear_px: float) -> Footage:
    """Shear the images as a rolling shutter does when the camera turns."""
    height = footage.images[0].shape[0]
    slopes = (shear_px * footage.random.standard_normal(len(footage)) / height).tolist()
    return footage.with_images(
        _warped(image, [[1.0, slope, -slope * height / 2], [0.0, 1.0, 0.0]])
        for image, slope in zip(footage.images, slopes, strict=True)
    )


def _time_going_back(footage: Footage, share: float) -> Footage:
    stamps = footage.stamps_s.copy()
    stamps[footage.some(share)] -= 5 * float(np.median(np.diff(footage.stamps_s)))
    return replace(footage, stamps_s=stamps)


def _listed(footage: Footage) -> list[list[str]]:
    """Return the columns of every line of times.txt: id, stamp and exposure."""
    columns = zip(footage.names, footage.stamps_s, footage.exposures_ms, strict=True)
    return [[name, f"{stamp:.6f}", f"{exposure:.6f}"] for name, stamp, exposure in columns]


def _with_lines(footage: Footage, lines: list[list[str]]) -> Footage:
    return replace(footage, times=tuple(" ".join(line) for line in lines))


def _rewritten(footage: Footage, share: float, change: Callable[[list[str]], list[str]]) -> Footage:
    wrong = footage.some(share)
    return _with_lines(footage, [change(line) if wrong[i] else line for i, line in enumerate(_listed(footage))])


def _duplicate_ids(footage: Footage, share: float) -> Footage:
    lines, repeats = _listed(footage), footage.some(share)
    names = [lines[i - repeats[i]][0] for i in range(len(lines))]
    return _with_lines(footage, [[name, *line[1:]] for name, line in zip(names, lines, strict=True)])


FAULTS = (
    Fault("lost-images", "a fraction of {} of images lost, numbering continues", (0.005, 0.02, 0.1),
        lambda f, x: _renumbered(f, ~f.some(x))),
    Fault("lost-block", "{} images lost at once, numbering continues", (3, 10, 40),
        lambda f, x: _renumbered(f, ~_from_a_third(f, x))),
    Fault("stutter", "a fraction of {} of images repeated, exposures continue", (0.005, 0.02, 0.1),
        # All later images are late relative to their exposures.
        lambda f, x: _reordered(f, np.cumsum(~f.some(x)) - 1)),
    Fault("repeated", "a fraction of {} of frames repeated with their exposures", (0.05, 0.2, 0.5), _repeated),
    Fault("frozen", "the image frozen for a fraction of {} of frames", (0.05, 0.15, 0.5), _frozen),
    Fault("dropped", "a fraction of {} of frames dropped", (0.05, 0.2, 0.6), lambda f, x: f.chosen(~f.some(x))),
    Fault("time-lapse", "only one frame in {}", (2, 4, 10), lambda f, x: f.chosen(np.arange(len(f)) % int(x) == 0)),
    Fault("short", "only a fraction of {} of the recording", (0.5, 0.2, 0.08),
        lambda f, x: f.chosen(np.arange(len(f)) < max(2, x * len(f)))),
    Fault("cuts", "pieces of {} frames in random order", (50, 10, 1), _cuts),
    Fault("covered", "a fraction of {} of images black", (0.02, 0.1, 0.3),
        lambda f, x: _changed(f, f.some(x), np.zeros_like)),
    Fault("torn", "the lower half missing in a fraction of {} of images", (0.01, 0.05, 0.2),
        lambda f, x: _changed(f, f.some(x), _cut_off)),
    Fault("interlaced", "every other row from {} frames later", (1, 2, 4), _interlaced),
    Fault("resized", "{} times the size in the second half", (0.9, 0.75, 0.5),
        lambda f, x: _since_midway(f, lambda image: np.asarray(cv2.resize(image, None, fx=x, fy=x)))),
    Fault("zoom", "a digital zoom of {} in the second half", (1.05, 1.2, 1.5),
        lambda f, x: _since_midway(f, lambda image: _zoomed_in(image, x))),
    Fault("stabilised", "digital stabilisation that moves images by {} pixels", (1, 3, 8), _stabilised),
    Fault("rolling-shutter", "images sheared by {} pixels", (2, 5, 12), _sheared),
    Fault("mirrored", "the first {} of images mirrored", (0.1, 0.3, 0.5),
        lambda f, x: _changed(f, np.arange(len(f)) < round(x * len(f)), lambda image: image[:, ::-1].copy())),
    Fault("time-going-back", "time goes backwards in a fraction of {} of frames", (0.01, 0.1, 0.5), _time_going_back),
    Fault("missing-lines", "a fraction of {} of lines missing in times.txt", (0.01, 0.1, 0.5),
        lambda f, x: _with_lines(f, list(compress(_listed(f), ~f.some(x))))),
    Fault("missing-files", "a fraction of {} of image files missing", (0.01, 0.1, 0.5),
        lambda f, x: replace(f.chosen(~f.some(x)), times=_with_lines(f, _listed(f)).times)),
    Fault("duplicate-ids", "the previous id in a fraction of {} of lines", (0.01, 0.1, 0.5), _duplicate_ids),
    Fault("decimal-commas", "decimal commas in a fraction of {} of lines", (0.01, 0.3, 1),
        lambda f, x: _rewritten(f, x, lambda line: [part.replace(".", ",") for part in line])),
    Fault("swapped-columns", "stamp and exposure swapped in a fraction of {} of lines", (0.01, 0.3, 1),
        lambda f, x: _rewritten(f, x, lambda line: [line[0], line[2], line[1]])),
    Fault("cut-lines", "no exposure in a fraction of {} of lines", (0.01, 0.1, 0.5),
        lambda f, x: _rewritten(f, x, lambda line: line[:2])),
)  # fmt: skip
