"""Preprocessing: reduces a frame to the data that is compared with other frames."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from ospc.arrays import BoolArray, Float32Array, FloatArray, Image, ImageSize, IntArray, size_of
from ospc.correspondence.thumbnail import Thumbnail, gradient_magnitude, thumbnail_of
from ospc.correspondence.thumbnail_registration import rescaled, values_at
from ospc.photometry.grey_range import FULL_RANGE, GreyRange
from ospc.photometry.noise import BRIGHTEST_EXPOSED
from ospc.recording.frame import Frame
from ospc.settings.registration import (
    BLACK_MARGIN_PX,
    COMPARED_QUANTILES,
    FLATNESS_PX,
    IMPULSE_CONTRAST,
    IMPULSE_DEVIATIONS,
    IMPULSE_LIKENESS,
    IMPULSE_SURROUND_PX,
    MAX_BLACK_SHARE,
    MAX_WHITE_SHARE,
    MIN_FLAT_AREA_RATIO,
    MIN_REGISTERED_SIDE_PX,
    MIN_SMOOTHING_VARIANCE,
    REGISTRATION_SIDE_PX,
    SURROUND_SIGMA_PX,
    SURROUND_SIGMAS,
    WHITE_MARGIN_PX,
)
from ospc.settings.sampling import GREY_POWERS


@dataclass(frozen=True)
class ReducedFrame:
    """The small images of a frame, used for registration."""

    number: int
    size: ImageSize
    reduction: int
    """Pixels of the frame, along each side, per pixel of the reduced size, at which grey levels are sampled."""
    small: npt.NDArray[np.uint8]
    """Grey levels at the size used for registration, 8 bit, shape (h', w')."""
    thumbnail: Thumbnail
    """An even smaller image, for the comparison of brightness with neighbouring frames."""
    grey_quantiles: FloatArray
    """Quantiles of the small image's grey levels, in 0 … 255, shape (19,)."""
    moments: FloatArray
    """Means of M … M⁵ over the small image, and the share of white pixels, shape (6,)."""
    surround_moments: tuple[Float32Array, ...]
    """Weighted sums of 1, M … M⁵ and white pixels around each pixel of a coarse image, shape (h'', w'', 7), for each
    of the distances over which light is scattered."""
    grey_range: GreyRange
    """Black and white as they were known then."""
    shown: BoolArray | None = field(default=None, kw_only=True)
    """Which pixels of the small image show the scene; None if all do. Only these reveal the motion of the view."""

    @property
    def reduced_size(self) -> ImageSize:
        """Width and height at which grey levels are sampled."""
        return self.size[0] // self.reduction, self.size[1] // self.reduction

    @property
    def further_reduction(self) -> int:
        """Pixels of the reduced size, along each side, per pixel of the small image."""
        return int(self.reduced_size[0] // self.small.shape[1])

    def values_at(self, image: Float32Array | npt.NDArray[np.uint8], places: FloatArray) -> FloatArray:
        """Interpolate an image of this frame, of the reduced size or derived from the small one, at reduced points.

        Shapes (h, w) or (h, w, c) and (..., 2) -> (...) or (..., c).
        """
        # The small image covers slightly less, because a remainder at the edge is cut off.
        size, small_size = np.array(image.shape[1::-1]), np.array(self.small.shape[::-1])
        covered = size if image.shape[1::-1] == self.reduced_size else small_size * self.further_reduction
        return values_at(image, rescaled(places, size / covered)).astype(np.float64)

    def shows_scene(self, places: FloatArray) -> BoolArray:
        """Return which points of the reduced size show the scene, (n, 2) -> (n,)."""
        if self.shown is None:
            return np.ones(len(places), bool)
        return self.values_at(self.shown.view(np.uint8) * np.uint8(255), places) > 127

    def to_frame(self, points: FloatArray) -> FloatArray:
        """Convert points (x, y) in the reduced size to pixel coordinates in the frame, shape (..., 2)."""
        return np.asarray((points + 0.5) * self.reduction - 0.5, dtype=np.float64)


@dataclass(frozen=True)
class PreprocessedFrame(ReducedFrame):
    """A frame with all data used from it."""

    grey: Float32Array
    squares: Float32Array
    cubes: Float32Array
    """Grey levels in [0, 1], their squares and their cubes, smoothed, shape (h, w)."""
    smoothing_px: float
    """Standard deviation of this smoothing, in reduced pixels."""
    gradient: Float32Array
    """Magnitude of the grey gradient in the neighbourhood, per reduced pixel, shape (h', w')."""
    clipped: BoolArray
    """Whether too many pixels in the neighbourhood are black or white, or any is masked, shape (h, w)."""


@dataclass(frozen=True)
class Preprocessor:
    """Preprocesses frames; raises a FrameError if a frame's image cannot be read."""

    longest_side: int
    """Maximum side length of reduced frames, unless they would be too narrow to be registered."""
    smoothing_px: float
    """Standard deviation of the smoothing of the grey levels, in reduced pixels."""
    registration_side: int = REGISTRATION_SIDE_PX

    def __call__(self, frame: Frame, grey_range: GreyRange = FULL_RANGE) -> PreprocessedFrame:
        """Preprocess a frame, given the currently known grey range."""
        image, white = frame.image, frame.max_grey
        size = size_of(image)
        reduction = self._reduction(size)
        reduced = _reduced(image, reduction)
        # Not used for registration, which needs fine lines that look like defects.
        averaged = _without_impulses(image, white)
        # In place, because each of these images takes a megabyte or more.
        grey = cv2.GaussianBlur(_reduced(averaged, reduction), (0, 0), self.smoothing_px)
        grey /= np.float32(white)
        squared = cv2.multiply(averaged, averaged, dtype=cv2.CV_32F)
        squares = cv2.GaussianBlur(_reduced(squared, reduction), (0, 0), self.smoothing_px)
        squares /= np.float32(white) ** 2
        cubed = cv2.multiply(squared, averaged, dst=squared, dtype=cv2.CV_32F)
        cubes = cv2.GaussianBlur(_reduced(cubed, reduction), (0, 0), self.smoothing_px)
        cubes /= np.float32(white) ** 3
        further = self._further_reduction(size_of(reduced))
        small = _reduced(reduced, further)
        levels = cv2.convertScaleAbs(small, alpha=255.0 / white)
        counts = cv2.calcHist([levels], [0], None, [256], [0, 256]).ravel().astype(np.int64)
        brightest = float(grey_range.grey(BRIGHTEST_EXPOSED))
        return PreprocessedFrame(
            number=frame.index,
            size=size,
            reduction=reduction,
            small=levels,
            thumbnail=thumbnail_of(frame, reduced, size, grey_range),
            grey_quantiles=_quantiles(counts),
            moments=_moments(counts, brightest),
            surround_moments=tuple(_surround_moments(levels, brightest, sigma) for sigma in SURROUND_SIGMAS),
            grey_range=grey_range,
            grey=grey,
            squares=squares,
            cubes=cubes,
            smoothing_px=self.smoothing_px,
            gradient=self._gradient(small, further, white),
            clipped=self._clipped_nearby(averaged, frame, reduction, grey_range),
        )

    def thumbnail(self, frame: Frame, grey_range: GreyRange = FULL_RANGE) -> Thumbnail:
        """Reduce a frame to its thumbnail only, given the currently known grey range."""
        size = size_of(frame.image)
        reduced = _reduced(frame.image, self._reduction(size))
        return thumbnail_of(frame, reduced, size, grey_range)

    def small_size(self, size: ImageSize) -> ImageSize:
        """Return the width and height used for registration, for frames of a size."""
        reduction = self._reduction(size)
        width, height = size[0] // reduction, size[1] // reduction
        further = self._further_reduction((width, height))
        return width // further, height // further

    def _reduction(self, size: ImageSize) -> int:
        return min(-(-max(size) // self.longest_side), _largest_reduction(size))

    def _further_reduction(self, size: ImageSize) -> int:
        halvings = np.ceil(np.log2(max(size) / self.registration_side))
        return int(2 ** np.clip(halvings, 0, np.floor(np.log2(_largest_reduction(size)))))

    def _gradient(self, small: Float32Array, further: int, white: int) -> Float32Array:
        # Variances of successive smoothings add up, including that of the reduction to the small image.
        flat = max(FLATNESS_PX**2, MIN_FLAT_AREA_RATIO * self.smoothing_px**2)
        further_px = np.sqrt(max(flat - (further**2 - 1) / 12, MIN_SMOOTHING_VARIANCE)) / further
        return gradient_magnitude(cv2.GaussianBlur(small, (0, 0), further_px)) / np.float32(white * further)

    def _clipped_nearby(self, image: Image, frame: Frame, reduction: int, grey_range: GreyRange) -> BoolArray:
        white = frame.max_grey
        low, high = (round(level * white) for level in (grey_range.black, grey_range.white))
        at_black = cv2.compare(image, low + white // 255, cv2.CMP_LE)
        at_white = cv2.compare(image, high - white // 255, cv2.CMP_GE)
        # In bytes for speed: these shares need no higher resolution.
        black_share = _mean_nearby(_means(at_black, reduction), BLACK_MARGIN_PX)
        white_share = _mean_nearby(_means(at_white, reduction), WHITE_MARGIN_PX)
        # Compared with whole numbers: with others, NumPy would convert the images to floats.
        most_black, most_white = int(255 * MAX_BLACK_SHARE), int(255 * MAX_WHITE_SHARE)
        clipped = np.asarray((black_share > most_black) | (white_share > most_white))
        if frame.mask is None:
            return clipped
        # Not in bytes, where a single masked pixel could be rounded to zero.
        masked = _mean_nearby(_reduced((~frame.mask).view(np.uint8), reduction), BLACK_MARGIN_PX)
        return np.asarray(clipped | (masked > 0))


def _largest_reduction(size: ImageSize) -> int:
    """Return the largest reduction after which an image can be registered."""
    return max(1, min(size) // MIN_REGISTERED_SIDE_PX)


def _mean_nearby(image: Image, margin_px: int) -> Image:
    """Return the mean over the square around each pixel, of the same type."""
    side = 2 * margin_px + 1
    return np.asarray(cv2.blur(image, (side, side)))


def _without_impulses(image: Image, white: int) -> Image:
    """Return the image with single pixels far from the median of their surroundings replaced by that median."""
    median = cv2.medianBlur(image, 3)
    deviation = cv2.absdiff(image, median)
    suspects = np.flatnonzero(deviation > int(IMPULSE_CONTRAST * white))
    if not len(suspects):
        return image
    # Allow for more in noisy or textured surroundings.
    usual = _medians_around(deviation, suspects)
    allowed = cv2.addWeighted(usual, IMPULSE_DEVIATIONS, usual, 0.0, IMPULSE_CONTRAST * white).ravel()
    suspects = suspects[deviation.take(suspects) > allowed]
    impulses = suspects[_stand_alone(image, median, suspects)]
    cleaned = image.copy()
    np.put(cleaned, impulses, median.take(impulses))
    return cleaned


def _stand_alone(image: Image, median: Image, places: IntArray) -> BoolArray:
    """Return whether at most one neighbour of each pixel, (n,), deviates from the median there in the same way."""
    level = median.take(places).astype(np.float32)
    own = image.take(places) - level
    nearby = (_windows(image, places, 3) - level[:, None, None]) * np.sign(own)[:, None, None]
    alike = np.count_nonzero(nearby > IMPULSE_LIKENESS * np.abs(own)[:, None, None], axis=(1, 2))
    return np.asarray(alike <= 2)  # the pixel itself and one neighbour


def _medians_around(image: Image, places: IntArray) -> Image:
    """Return the medians over the square around some pixels, given by their indices in the flat image, (n,)."""
    side = IMPULSE_SURROUND_PX
    if len(places) * side**2 > image.size:
        return np.asarray(cv2.medianBlur(image, side).take(places))
    # A row of windows: filtering the whole image takes many times as long if there are few places.
    windows = np.moveaxis(_windows(image, places, side), 1, 0).reshape(side, len(places) * side)
    return np.asarray(cv2.medianBlur(windows, side)[side // 2, side // 2 :: side])


def _windows(image: Image, places: IntArray, side: int) -> Image:
    """Return the square around each pixel, given by its index in the flat image, (n,) -> (n, side, side)."""
    height, width = image.shape
    offset = np.arange(side) - side // 2
    rows = np.clip(places[:, None] // width + offset, 0, height - 1)
    columns = np.clip(places[:, None] % width + offset, 0, width - 1)
    return np.asarray(image[rows[:, :, None], columns[:, None, :]])


def _reduced(image: Image, factor: int) -> Float32Array:
    return np.asarray(_means(image.astype(np.float32, copy=False), factor), dtype=np.float32)


def _means(image: Image, factor: int) -> Image:
    """Return the means over squares of ``factor`` × ``factor`` pixels; a remainder at the edge is cut off."""
    if factor == 1:
        return image
    height, width = (side // factor for side in image.shape)
    cut = image[: height * factor, : width * factor]
    return np.asarray(cv2.resize(cut, (width, height), interpolation=cv2.INTER_AREA))


def _quantiles(counts: IntArray) -> FloatArray:
    """Return the quantiles of the grey levels, from the number of pixels of each level, shape (256,)."""
    total = np.cumsum(counts)
    return np.asarray(np.interp(COMPARED_QUANTILES * total[-1], total, np.arange(256)))


def _moments(counts: IntArray, brightest: float) -> FloatArray:
    """Return the mean powers and the share of white pixels, from the number of pixels of each level, shape (256,)."""
    # Pixels are white beyond the ``brightest`` exposed grey level.
    white = counts[int(255 * brightest) + 1 :].sum()
    powers = np.linspace(0, 1, 256)[:, None] ** np.arange(1, GREY_POWERS + 1)
    return np.asarray(np.append(counts @ powers, white) / counts.sum())


def _surround_moments(small: npt.NDArray[np.uint8], brightest: float, sigma: float) -> Float32Array:
    """Return the sums of powers and of white pixels around each pixel, (h', w') -> (h'', w'', 7)."""
    height, width = small.shape
    coarse_px = SURROUND_SIGMA_PX / sigma / max(width, height)  # pixels of the coarse image per small pixel
    size = max(1, round(coarse_px * width)), max(1, round(coarse_px * height))
    coarse = cv2.resize(small, size, interpolation=cv2.INTER_AREA).astype(np.float32) / np.float32(255)
    white = (small > 255 * brightest).astype(np.float32)
    white = cv2.resize(white, size, interpolation=cv2.INTER_AREA)
    powers = np.stack([*(coarse**power for power in range(1 + GREY_POWERS)), white], axis=-1)
    sigma_px = sigma * max(size)
    # Light from beyond the frame is unknown and is not counted.
    return np.asarray(cv2.GaussianBlur(powers, (0, 0), sigma_px, borderType=cv2.BORDER_CONSTANT))
