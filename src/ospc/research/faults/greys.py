"""Faults of the grey values: processing after the sensor by a camera, a codec or a program."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np

from ospc.arrays import BoolArray, FloatArray, Image
from ospc.photometry.geometry import normalised, pixel_grid
from ospc.photometry.response import Response
from ospc.research.faults.footage import Fault, Footage

_GREYS = np.arange(256.0)
_LEAST_STEP = 1e-9
"""Step of g where a curve is flat, because a response must increase strictly."""
_WHITE, _RANGE = 255.0, 219.0
"""Largest grey value, and that of limited range (16 to 235) above its black."""

_SCATTERED_WHITE = 245.0
"""White of the fault whose white scatters: like that of a real camera, it leaves room for the scatter above it."""


def _filtered(footage: Footage, change: Callable[[FloatArray], FloatArray]) -> Footage:
    """Change every image as floats, then round and clip it."""
    return footage.with_images(_bytes(change(image.astype(np.float64))) for image in footage.images)


def _each(footage: Footage, change: Callable[[Image], Image]) -> Footage:
    return footage.with_images(change(image) for image in footage.images)


def _bytes(image: FloatArray) -> Image:
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def _curved(footage: Footage, curve: FloatArray) -> Footage:
    """Apply a curve, 256 increasing grey values, to every image; the camera with the curve has another response."""
    rising = (curve > 0) & (curve < _WHITE)
    before = np.interp(_GREYS, curve[rising], _GREYS[rising])
    table = footage.responses[0].inverse(before / _WHITE)
    table[0] = 0.0
    known = (*footage.responses, Response.from_values(np.maximum.accumulate(table) + _LEAST_STEP * _GREYS))
    return replace(_looked_up(footage, lambda _i: curve), responses=known)


def _quantised(footage: Footage, step: float) -> Footage:
    """Keep every ``step``-th level; the middle of merged levels is half a level below the level they become."""
    known = _curved(footage, _GREYS + 0.5).responses
    return replace(_looked_up(footage, lambda _i: (_GREYS // step + 0.5) * step), responses=known)


def _looked_up(footage: Footage, curve_of: Callable[[int], FloatArray]) -> Footage:
    """Apply a different curve to every image, by frame number."""
    return footage.with_images(_bytes(curve_of(i))[image] for i, image in enumerate(footage.images))


def _limited_scale(black: float) -> float:
    """Return the ratio of limited-range to full-range grey levels for black at this level."""
    return 1 - (1 - _RANGE / _WHITE) * black / 16


def _gammas(footage: Footage, exponents: FloatArray) -> Footage:
    """Apply a different exponent to every image, shape (frames,)."""
    return _looked_up(footage, lambda i: _WHITE * (_GREYS / _WHITE) ** exponents[i])


def _gamma_by_brightness(footage: Footage, exponent: float) -> Footage:
    grey = np.array([image.mean() for image in footage.images])
    return _gammas(footage, exponent ** (2 * (grey / grey.mean() - 1)))


def _auto_contrast(footage: Footage, share: float) -> Footage:
    def stretched(image: FloatArray) -> FloatArray:
        low, high = np.percentile(image, (1, 99))
        return np.asarray((1 - share) * image + share * (image - low) * _WHITE / max(high - low, 1.0))

    return _filtered(footage, stretched)


def _tone_mapped(footage: Footage, share: float) -> Footage:
    """Pull the local mean around every pixel, over an eighth of the width, towards the middle of the scale."""

    def mapped(image: FloatArray) -> FloatArray:
        small = cv2.resize(image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
        around = cv2.resize(cv2.GaussianBlur(small, (0, 0), small.shape[1] / 8), image.shape[::-1])
        return np.asarray(image * (128 / np.maximum(around, 1.0)) ** share)

    # In a bracket of one view, surroundings brighten with the exposure, so tone mapping looks like a power of it.
    return replace(_filtered(footage, mapped), power=1 / (1 - share))


def _temporal(footage: Footage, share: float) -> Footage:
    images = []
    before = footage.images[0].astype(np.float64)
    for image in footage.images:
        before = share * before + (1 - share) * image
        images.append(_bytes(before))
    return footage.with_images(images)


def _compressed(image: Image, quality: float) -> Image:
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, int(quality)])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE))


def _enlarged(image: Image, factor: float) -> Image:
    small = cv2.resize(image, None, fx=1 / factor, fy=1 / factor, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(small, image.shape[::-1], interpolation=cv2.INTER_LINEAR))


def _impulses(footage: Footage, share: float) -> Footage:
    def hit(image: FloatArray) -> FloatArray:
        drawn = footage.random.random(image.shape)
        return np.where(drawn < share / 2, 0.0, np.where(drawn > 1 - share / 2, _WHITE, image))

    return _filtered(footage, hit)


def _dead_pixels(footage: Footage, share: float) -> Footage:
    shape = footage.images[0].shape
    dead, value = footage.random.random(shape) < share, footage.random.choice([0.0, _WHITE], shape)
    return _filtered(footage, lambda image: np.where(dead, value, image))


def _fixed_columns(footage: Footage, greys: float) -> Footage:
    offset = greys * footage.random.standard_normal(footage.images[0].shape[1])
    return _filtered(footage, lambda image: image + offset)


def _overlay(footage: Footage, share: float) -> Footage:
    height, width = footage.images[0].shape
    bottom = round(2 * share * height)

    def marked(image: Image, i: int) -> Image:
        result = image.copy()
        result[:bottom, : width // 2] = 0
        cv2.putText(result, f"{i:05d}", (4, bottom - 2), cv2.FONT_HERSHEY_PLAIN, bottom / 12, 255)
        return result

    return footage.with_images(marked(image, i) for i, image in enumerate(footage.images))


def _watermark(footage: Footage, opacity: float) -> Footage:
    height, width = footage.images[0].shape
    mark = np.zeros((height, width), np.uint8)
    cv2.putText(mark, "SAMPLE", (width // 8, height // 2), cv2.FONT_HERSHEY_PLAIN, width / 80, 255, 4)
    return _filtered(footage, lambda image: image + opacity * mark / _WHITE * (_WHITE - image))


def _masked(footage: Footage, inside: BoolArray) -> Footage:
    """Make everything outside a mask black, shape (height, width)."""
    height, width = inside.shape
    radius = np.linalg.norm(normalised(pixel_grid((width, height)), (width, height)), axis=-1)
    return replace(_filtered(footage, lambda image: image * inside), max_radius=float(radius[inside].max()))


def _pedestal_by_exposure(footage: Footage, grey_levels: float) -> Footage:
    """Raise the black level with ln exposure, like an analogue gain that is part of the stated exposures."""
    log_exposure = np.log(footage.exposures_ms)
    rise = grey_levels * (log_exposure - log_exposure.min()) / np.ptp(log_exposure)
    return _looked_up(footage, lambda i: _GREYS + rise[i])


def _white_scattered(footage: Footage, grey_levels: float) -> Footage:
    """Lower white, and add noise after clipping."""
    lowered = _curved(footage, _GREYS * (_SCATTERED_WHITE / _WHITE))
    return _filtered(lowered, lambda image: image + footage.random.normal(0, grey_levels, image.shape))


FAULTS = (
    Fault("limited-range", "limited-range video that is not expanded, black at {}", (8, 16, 32),
        lambda f, black: _curved(f, black + _GREYS * _limited_scale(black))),
    Fault("expanded-twice", "full range expanded as if its black were at {}", (8, 16, 32),
        lambda f, black: _curved(f, (_GREYS - black) / _limited_scale(black))),
    Fault("pedestal", "{} grey levels added", (5, 10, 20), lambda f, x: _curved(f, _GREYS + x)),
    Fault("pedestal-drift", "a pedestal that grows to {} grey levels", (5, 10, 20),
        lambda f, x: _looked_up(f, lambda i: _GREYS + x * i / len(f))),
    Fault("pedestal-by-exposure", "a pedestal of {} grey levels at the longest exposure, none at the shortest",
        (5, 10, 20), _pedestal_by_exposure),
    Fault("white-clipped", "grey values end at {}", (250, 235, 200),
        lambda f, x: replace(_looked_up(f, lambda _i: np.minimum(_GREYS, x)), brightest=x / _WHITE)),
    Fault("white-scattered", "white at 245 that scatters by {} of 255", (0.5, 1, 2), _white_scattered),
    Fault("gamma-midway", "an exponent of {} in the second half", (1.1, 1.2, 1.5),
        lambda f, x: _gammas(f, np.where(np.arange(len(f)) >= f.half, x, 1.0))),
    Fault("gamma-drift", "an exponent that drifts to {}", (1.1, 1.2, 1.5),
        lambda f, x: _gammas(f, x ** (np.arange(len(f)) / len(f)))),
    Fault("gamma-by-brightness", "an exponent that follows brightness, base {}", (1.1, 1.3, 1.6),
        _gamma_by_brightness),
    Fault("two-gammas", "an exponent of {} in three frames of ten", (1.1, 1.2, 1.5),
        lambda f, x: _gammas(f, np.where(f.some(0.3), x, 1.0))),
    Fault("auto-contrast", "frames stretched to the full scale, with a weight of {}", (0.25, 0.5, 1), _auto_contrast),
    Fault("equalised", "histograms equalised, with a weight of {}", (0.1, 0.3, 1),
        lambda f, x: _each(f, lambda image: cv2.addWeighted(image, 1 - x, cv2.equalizeHist(image), x, 0))),
    Fault("clahe", "local histogram equalisation with clip limit {}", (1, 2, 4),
        lambda f, x: _each(f, cv2.createCLAHE(clipLimit=x, tileGridSize=(8, 8)).apply)),
    Fault("tone-mapping", "surroundings compressed by an exponent of {}", (0.05, 0.1, 0.25), _tone_mapped),
    Fault("bilateral", "bilateral filter, {} grey levels", (10, 25, 60),
        lambda f, x: _each(f, lambda image: cv2.bilateralFilter(image, 7, x, 3))),
    Fault("temporal-denoising", "average with earlier frames, with a weight of {}", (0.3, 0.5, 0.7), _temporal),
    Fault("median-filter", "median filter of {} pixels a side", (3, 5, 7),
        lambda f, x: _each(f, lambda image: cv2.medianBlur(image, int(x)))),
    Fault("blur", "Gaussian blur of {} pixels", (1, 2, 4),
        lambda f, x: _filtered(f, lambda image: np.asarray(cv2.GaussianBlur(image, (0, 0), x)))),
    Fault("sharpening", "unsharp mask of strength {}", (0.5, 1, 2),
        lambda f, x: _filtered(f, lambda image: image + x * (image - cv2.GaussianBlur(image, (0, 0), 1.5)))),
    Fault("jpeg", "JPEG of quality {}", (60, 30, 10), lambda f, x: _each(f, lambda image: _compressed(image, x))),
    Fault("upscaled", "enlarged from images {} times smaller", (1.5, 2, 4),
        lambda f, x: _each(f, lambda image: _enlarged(image, x))),
    Fault("fewer-levels", "only one grey level in {}", (2, 4, 16), _quantised),
    Fault("noise", "Gaussian noise of {} grey levels", (3, 6, 12),
        lambda f, x: _filtered(f, lambda image: image + x * f.random.standard_normal(image.shape))),
    Fault("impulses", "random pixels, a fraction of {}, black or white", (0.001, 0.01, 0.05), _impulses),
    Fault("dead-pixels", "a fraction of {} of pixels always black or white", (0.0001, 0.001, 0.01), _dead_pixels),
    Fault("fixed-columns", "fixed column offsets of {} grey levels", (1, 2, 4), _fixed_columns),
    Fault("row-noise", "row offsets of {} grey levels, different in every frame", (1, 2, 4),
        lambda f, x: _filtered(f, lambda image: image + x * f.random.standard_normal((len(image), 1)))),
    Fault("overlay", "a clock in a box over a fraction of {} of the image", (0.02, 0.05, 0.1), _overlay),
    Fault("watermark", "a watermark of opacity {}", (0.1, 0.3, 0.6), _watermark),
    Fault("letterbox", "black bars over a fraction of {} of the image", (0.05, 0.15, 0.3),
        lambda f, x: _masked(f, np.abs(f.from_centre()[..., 1]) < len(f.images[0]) * (1 - x) / 2)),
    Fault("disc", "black outside a disc with a diameter of {} times the height", (1.2, 1.0, 0.8),
        lambda f, x: _masked(f, np.linalg.norm(f.from_centre(), axis=-1) < x * len(f.images[0]) / 2)),
)  # fmt: skip
