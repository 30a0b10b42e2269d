"""Statistics of a recording's grey values: coverage, clipping, unused bits and regions that are always black."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from functools import cache

import cv2
import numpy as np
import numpy.typing as npt

from ospc.arrays import BoolArray, ByValue, Float32Array, FloatArray, Image, ImageSize, IntArray, read_only, size_of
from ospc.correspondence.black_and_white import black_of, scattered_white_of, shared_white_of
from ospc.correspondence.interlacing import row_alternation
from ospc.correspondence.thumbnail import Thumbnail
from ospc.photometry.geometry import normalised, pixel_grid
from ospc.photometry.grey_range import FULL_RANGE, VIDEO_RANGE, GreyRange
from ospc.recording.frame import Frame
from ospc.settings.grey_values import (
    BLACK_PLACE_LEVEL,
    BRIGHTEST_SHARES,
    COUNTED_STRIDE,
    COVERAGE_GREY_CELLS,
    COVERAGE_RADIUS_CELLS,
    INTERLACED_QUANTILE,
    LOG_EXPOSURES_OF_WHITE,
    MAX_COUNTED_FRAMES,
    MAX_GREY_RANGES,
    MAX_LOG_EXPOSURE_BELOW_WHITE,
    MIN_BORDER_SHARE,
    MIN_CELLS_OF_CLIPPED,
    MIN_COMB_RANGE,
    MIN_COVERED_SHARE,
    MIN_INTERLACED_ALTERNATION,
    MIN_MEDIAN_LEVEL,
    MIN_MISSING_LEVELS_SHARE,
    MIN_PILE_SHARE,
    RECTANGLE_FILL,
)

_MAX_COUNTED_BITS = 12
"""Maximum number of bits of counted grey values; for deeper images only the upper bits are counted, which bounds the
histogram."""


@dataclass(frozen=True, eq=False)
class PixelReport(ByValue):
    """Grey values of the observed frames."""

    grey_share: FloatArray
    """Share of each frame's pixels in 32 equal ranges of grey, shape (frames, 32)."""
    log_exposure: FloatArray
    """ln of the exposure in milliseconds of these frames, shape (frames,)."""
    mean_radius_share: FloatArray
    """Mean share of well exposed points in 10 equal ranges of R from 0 to 1 (the corner), shape (10,); NaN for ranges
    without points."""
    saturated_share: float
    """Share of all pixels at the upper end."""
    black_share: float
    """Share of all pixels at the lower end."""
    lowest_grey: int
    """Lowest grey value of all frames."""
    highest_grey: int
    """Highest grey value of all frames."""
    max_grey: int
    """Largest grey value of the sensor."""
    empty_low_bits: int
    """Number of lowest bits that are zero in every grey value."""
    missing_levels_share: float
    """Share of the grey values between the extremes that never occur; 0 unless the images have 8 bits."""
    surround: str
    """Kind of the black surround: ``"none"``, ``"disc"`` (fisheye, all corners black) or ``"border"``."""
    surround_share: float
    """Share of the image that is a black surround."""

    @property
    def covered_grey(self) -> BoolArray:
        """Which of the 32 ranges of grey contain at least a thousandth of all pixels, shape (32,)."""
        return np.asarray(self.grey_share.mean(axis=0) >= MIN_COVERED_SHARE)


@dataclass
class PixelStatistics:
    """Accumulates the grey values of an epoch's frames, and the grey range known at each frame."""

    _histogram: IntArray | None = None
    _grey_share: list[FloatArray] = field(default_factory=list)
    _radius_share: list[FloatArray] = field(default_factory=list)
    _log_exposure: list[float] = field(default_factory=list)
    _row_alternation: list[float] = field(default_factory=list)
    _observed: int = 0
    _stride: int = 1
    _brightest: Float32Array | None = None
    _bits: int = 0
    _max_grey: int = 255
    _ranges: list[tuple[int, float, float]] = field(default_factory=list)
    _inherited: GreyRange = FULL_RANGE

    def observe(self, frame: Frame, small: Thumbnail) -> None:
        """Add a frame, whose image is already decoded, with its thumbnail."""
        image = np.ascontiguousarray(frame.image[::COUNTED_STRIDE, ::COUNTED_STRIDE])
        if frame.mask is not None:
            image = frame.image[frame.mask][:: COUNTED_STRIDE**2]
        self._max_grey = frame.max_grey
        counts = _counts(image, frame.max_grey)
        self._histogram = counts if self._histogram is None else self._histogram + counts
        self._bits |= int(np.bitwise_or.reduce(image, axis=None))
        self._brightest = small.grey if self._brightest is None else np.maximum(self._brightest, small.grey)
        if self._observed % self._stride == 0:
            self._keep(frame, small, counts)
        self._observed += 1
        found = self._found_range()
        if found != self.grey_range:
            self._ranges = [*self._ranges, (frame.index, found.black, found.white)][-MAX_GREY_RANGES:]

    def _keep(self, frame: Frame, small: Thumbnail, counts: IntArray) -> None:
        """Keep the statistics of a single frame, given the number of pixels of each grey value."""
        level = np.arange(len(counts)) * COVERAGE_GREY_CELLS // len(counts)
        self._grey_share.append(np.bincount(level, weights=counts, minlength=COVERAGE_GREY_CELLS) / counts.sum())
        cell = _radius_cells(size_of(small.grey))
        places = np.bincount(cell, minlength=COVERAGE_RADIUS_CELLS)
        exposed = np.bincount(cell[small.exposed.ravel()], minlength=COVERAGE_RADIUS_CELLS)
        unknown = np.full(COVERAGE_RADIUS_CELLS, np.nan)
        self._radius_share.append(np.divide(exposed, places, out=unknown, where=places > 0))
        self._log_exposure.append(float(np.log(frame.exposure_ms)))
        self._row_alternation.append(row_alternation(frame.image, frame.max_grey))
        if len(self._grey_share) > MAX_COUNTED_FRAMES:
            self._grey_share, self._radius_share = self._grey_share[::2], self._radius_share[::2]
            self._log_exposure, self._row_alternation = self._log_exposure[::2], self._row_alternation[::2]
            self._stride *= 2

    @property
    def grey_range(self) -> GreyRange:
        """The currently known grey range."""
        return self.grey_range_before(sys.maxsize)

    def grey_range_before(self, number: int) -> GreyRange:
        """Return the grey range that was known from the frames before a given one."""
        known = [(black, white) for frame, black, white in self._ranges if frame < number]
        return GreyRange(*known[-1]) if known else FULL_RANGE

    @property
    def interlaced(self) -> bool:
        """Whether odd and even rows of the images show different moments."""
        alternations = self._row_alternation
        return bool(alternations) and bool(
            np.quantile(alternations, INTERLACED_QUANTILE) > MIN_INTERLACED_ALTERNATION
        )

    def of_next_epoch(self) -> PixelStatistics:
        """Return the statistics to continue with after a camera change, with the grey range determined anew."""
        return PixelStatistics(_max_grey=self._max_grey, _ranges=self._ranges, _inherited=self.grey_range)

    def _found_range(self) -> GreyRange:
        """Return black and white if many pixels have them, else the ends of the scale."""
        # If values pile up at one end of the limited range of video and stay within it, both ends are used. If none
        # does, the range of the previous epoch is kept as long as all values lie within it.
        assert self._histogram is not None
        last = len(self._histogram) - 1
        lowest, highest = (end / last for end in np.flatnonzero(self._histogram)[[0, -1]].tolist())
        black, white = (None if end is None else end / last for end in self._piles)
        inside = lowest >= VIDEO_RANGE.black and highest <= VIDEO_RANGE.white
        if inside and (black == VIDEO_RANGE.black or white == VIDEO_RANGE.white):
            return VIDEO_RANGE
        found = GreyRange(black or 0.0, white or 1.0)
        usual = self._inherited
        return usual if found.is_full and usual.black <= lowest and highest <= usual.white else found

    @property
    def _piles(self) -> tuple[int | None, int | None]:
        """Indices of black and white in the histogram, None for the ends of the scale."""
        assert self._histogram is not None
        white = shared_white_of(self._histogram)
        if white is None:
            white = scattered_white_of(self._histogram)
            white = white if white is not None and self._clips_at(white / len(self._histogram)) else None
        return black_of(self._histogram), white

    def _clips_at(self, white: float) -> bool:
        """Return whether a peak of the histogram is white, and not a uniform object at its brightest."""
        # Clipped pixels have the same value at different exposures. In frames with shorter exposures, where they are
        # not clipped, their values differ widely.
        share, log_exposure = np.array(self._grey_share), np.array(self._log_exposure)
        bright = share[:, int(white * COVERAGE_GREY_CELLS) :].sum(axis=1)
        there = bright > MIN_PILE_SHARE
        if not there.any():
            return False
        if np.ptp(log_exposure[there]) > LOG_EXPOSURES_OF_WHITE:
            return True
        shorter = log_exposure.min(where=there, initial=np.inf) - log_exposure
        brightest = bright[there].mean() * np.array(BRIGHTEST_SHARES)
        reaching = np.cumsum(share[(shorter > 0) & (shorter < MAX_LOG_EXPOSURE_BELOW_WHITE), ::-1], axis=1)
        if not len(reaching):
            return False
        first, last = ((reaching < limit).sum(axis=1) for limit in brightest)
        return bool(np.median(last - first) >= MIN_CELLS_OF_CLIPPED)

    def report(self) -> PixelReport | None:
        """Return the report; None if no frame was observed."""
        if self._histogram is None or self._brightest is None:
            return None
        counts, white = self._histogram, self._max_grey
        share = counts / counts.sum()
        ends = np.arange(len(counts) + 1) * (white + 1) // len(counts)
        level = ends[:-1]
        margin = white // 255
        low, high = (int(end) for end in np.flatnonzero(counts)[[0, -1]])
        gaps = float(np.mean(counts[low : high + 1] == 0)) if white == 255 and high - low > MIN_COMB_RANGE else 0.0
        lit, surround = _lit_places(self._brightest)
        clipped = self._piles[1]
        return PixelReport(
            grey_share=np.array(self._grey_share),
            log_exposure=np.array(self._log_exposure),
            mean_radius_share=np.mean(self._radius_share, axis=0),
            saturated_share=float(share[level >= (white if clipped is None else level[clipped]) - margin].sum()),
            black_share=float(share[level <= margin].sum()),
            lowest_grey=int(level[low]),
            highest_grey=int(ends[high + 1]) - 1,
            max_grey=white,
            empty_low_bits=(self._bits & -self._bits).bit_length() - 1 if self._bits else 0,
            missing_levels_share=gaps if gaps >= MIN_MISSING_LEVELS_SHARE else 0.0,
            surround=surround,
            surround_share=float(1 - lit.mean()),
        )


def level_count(max_grey: int) -> int:
    """Return the number of grey values, or ranges of them, that are counted."""
    return (max_grey >> max(0, max_grey.bit_length() - _MAX_COUNTED_BITS)) + 1


@cache
def _radius_cells(size: ImageSize) -> IntArray:
    """Return the index of the range of R of each pixel of a small image, shape (h · w,)."""
    radius = np.linalg.norm(normalised(pixel_grid(size), size), axis=-1)
    cell = np.minimum((radius * COVERAGE_RADIUS_CELLS).astype(np.int64), COVERAGE_RADIUS_CELLS - 1)
    return read_only(np.asarray(cell).ravel())


def _counts(image: Image, max_grey: int) -> npt.NDArray[np.int64]:
    """Return the number of pixels of each grey value; above 12 bits, of each value of the upper 12."""
    levels, dropped_bits = level_count(max_grey), max(0, max_grey.bit_length() - _MAX_COUNTED_BITS)
    values = image >> dropped_bits if dropped_bits else image
    if levels <= np.iinfo(image.dtype).max:
        values = np.minimum(values, levels - 1)
    counts = cv2.calcHist([values], [0], None, [levels], [0, levels])
    return np.asarray(counts.ravel(), dtype=np.int64)


def _lit_places(brightest: Float32Array) -> tuple[BoolArray, str]:
    """Return the pixels that are bright at least once, and the kind of the dark border."""
    everything = np.ones(brightest.shape, bool)
    dark = (brightest < BLACK_PLACE_LEVEL).astype(np.uint8)
    if np.median(brightest) < MIN_MEDIAN_LEVEL or not dark.any():
        return everything, "none"
    _, label = cv2.connectedComponents(dark, connectivity=4)
    edge = np.concatenate([label[0], label[-1], label[:, 0], label[:, -1]])
    surround = np.isin(label, np.setdiff1d(edge, [0]))
    if surround.mean() < MIN_BORDER_SHARE:
        return everything, "none"
    lit = ~surround
    corners = surround[[0, 0, -1, -1], [0, -1, 0, -1]]
    rows, columns = np.flatnonzero(lit.any(axis=1)), np.flatnonzero(lit.any(axis=0))
    filled = lit[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].mean()
    return lit, "disc" if corners.all() and filled < RECTANGLE_FILL else "border"
