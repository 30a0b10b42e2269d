"""The part of the image that shows the scene: without a fisheye's dark surround, overlays and masked parts."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from ospc.arrays import BoolArray, Float32Array, FloatArray, IntArray, size_of
from ospc.correspondence.preprocessing import PreprocessedFrame, ReducedFrame
from ospc.photometry.geometry import half_diagonal, normalised, pixel_grid, pixels_of
from ospc.settings.grey_values import (
    LIT_QUANTILE,
    MAX_ENCLOSED_SHARE,
    MAX_FINE_STRUCTURE_8_BIT,
    MAX_OVERLAY_SHARE,
    MAX_SURROUND_SHARE,
    MIN_CIRCLE_FILL,
    MIN_CIRCLE_FRAMES,
    MIN_COUNTED_PAIRS,
    MIN_EDGE_RATIO,
    MIN_FINE_STRUCTURE_8_BIT,
    MIN_LIT_8_BIT,
    MIN_LIT_PX,
    MIN_OVERLAY_AGREEMENT,
    MIN_OVERLAY_PX,
    MIN_SHARP_EDGE_RATIO,
    MIN_SURROUND_AREA,
    MIN_SURROUND_CORNERS,
    OVERLAY_LINE_PX,
    SOFT_SURROUND_MARGIN_PX,
    SURROUND_MARGIN_PX,
    WHOLE_IMAGE_RADIUS,
)


@dataclass(frozen=True)
class _Surround:
    """The part of the image that never receives light."""

    dark: BoolArray
    """Its pixels without its margin, in the small size, shape (h, w)."""
    hidden: BoolArray
    """The same with its margin."""
    soft_circle: FloatArray | None
    """Centre of the image circle that it leaves, in half diagonals, shape (2,), if its edge is soft."""


@dataclass
class SceneArea:
    """Finds the pixels that do not show the scene.

    A pixel that shows a dark part of the scene becomes bright sooner or later; one outside the image circle never
    does. A region that stays dark and reaches the corners is treated as the surround of a fisheye image.

    Fine structure of the scene moves with the view. What stays at the same pixels is an overlay, such as a clock or a
    watermark, or a part of the vehicle. Dekel and others (2017) find the edges of watermarks in this way. When a
    camera zooms or moves forward, edges that point towards the centre of expansion, and objects near it, stay, too:
    a pixel counts in a pair of frames only if the motion of the view would have changed what it shows.
    """

    brightest: npt.NDArray[np.uint8] | None = None
    """Largest grey level of each pixel at the size used for registration, 8 bit, shape (h, w)."""
    frames: int = 0
    """Number of frames observed."""
    allowed: BoolArray | None = None
    """Which pixels may be used, in the same size; None for all."""
    fine: Float32Array | None = None
    contrast: Float32Array | None = None
    """Sums over the pairs in which a pixel counts, shape (h, w): of its deviation from its surroundings in the second
    frame, in grey levels of 8 bit, if it has the same sign in the first, and of its magnitude."""
    pairs: Float32Array | None = None
    """Number of pairs in which each pixel counts, shape (h, w)."""

    def __post_init__(self) -> None:
        self._latest: tuple[int, _Surround | None] = (-1, None)  # the surround after so many frames

    def observe(self, frame: PreprocessedFrame, mask: BoolArray | None) -> None:
        """Add a frame; the mask marks its usable pixels, shape (height, width), None for all."""
        self.frames += 1
        # The small image of a frame never changes, so it need not be copied.
        self.brightest = frame.small if self.brightest is None else np.maximum(self.brightest, frame.small)
        if mask is not None and self.allowed is None:
            height, width = frame.small.shape
            self.allowed = cv2.resize(mask.view(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0

    def compare(self, frame0: ReducedFrame, frame1: ReducedFrame, motion: FloatArray) -> None:
        """Add a pair of frames, given the homography from most of the first view to the second, in small pixels."""
        before, after = _fine_structure(frame0.small), _fine_structure(frame1.small)
        unseen = cv2.BORDER_CONSTANT, (np.nan, 0, 0, 0)
        moved = cv2.warpPerspective(before, motion, before.shape[::-1], None, cv2.INTER_LINEAR, *unseen)
        counts = np.abs(before) > MIN_FINE_STRUCTURE_8_BIT
        # Otherwise, the scene might look the same there.
        counts &= before * moved < MIN_FINE_STRUCTURE_8_BIT / 2 * np.abs(before)
        if self.fine is None or self.contrast is None or self.pairs is None:
            self.fine, self.contrast, self.pairs = (np.zeros_like(before) for _ in range(3))
        shown = cv2.patchNaNs(after)  # OpenCV multiplies by the mask
        cv2.accumulate(shown, self.fine, (counts & (before * shown > 0)).view(np.uint8))
        cv2.accumulate(np.abs(shown), self.contrast, counts.view(np.uint8))
        self.pairs += counts

    def surround(self) -> BoolArray | None:
        """Return which pixels never receive light, with a margin, in the small size, shape (h, w); None if all do."""
        return None if self._surround is None else self._surround.hidden

    def shown(self) -> BoolArray | None:
        """Return which pixels show the scene and may be used, in the small size, shape (h, w); None if all do."""
        hidden = _together(None if self.allowed is None else ~self.allowed, self.surround(), self.overlay())
        return None if hidden is None else ~hidden

    def extended(self, frame0: ReducedFrame, frame1: ReducedFrame) -> tuple[ReducedFrame, ReducedFrame]:
        """Return two frames for registration, in which the scene extends into the surround.

        The edge of a surround does not move with the scene: up to 20 pixels from it, registration found too little
        motion, so that V was wrong.
        """
        surround = self.surround()
        if surround is None:
            return frame0, frame1
        nearest = _nearest(~surround)
        return replace(frame0, small=frame0.small.take(nearest)), replace(frame1, small=frame1.small.take(nearest))

    def soft_circle(self) -> FloatArray | None:
        """Return the centre of an image circle with a soft edge, in half diagonals, shape (2,), or None.

        V falls steeply at such an edge, and no scene points show where: it is known only as far as they reach.
        """
        return None if self._surround is None else self._surround.soft_circle

    @property
    def _surround(self) -> _Surround | None:
        """The surround, None if there is none; it is needed several times per frame."""
        if self._latest[0] != self.frames:
            self._latest = self.frames, self._found_surround()
        return self._latest[1]

    def _found_surround(self) -> _Surround | None:
        if self.brightest is None or self.frames < MIN_CIRCLE_FRAMES:
            return None
        # Most cameras have lit corners, which is seen at once; the rest takes a millisecond.
        side = math.ceil(math.sqrt(MIN_LIT_PX))
        ends = np.s_[:side], np.s_[-side:]
        darkest = np.array([self.brightest[rows, columns].min() for rows in ends for columns in ends])
        if np.count_nonzero(darkest <= MAX_SURROUND_SHARE * np.iinfo(np.uint8).max) < MIN_SURROUND_CORNERS:
            return None
        lit = float(np.quantile(self.brightest, LIT_QUANTILE))
        if lit < MIN_LIT_8_BIT:
            return None
        dark = ~_large_parts(self.brightest > MAX_SURROUND_SHARE * lit, MIN_LIT_PX, connectivity=4)
        _, label = cv2.connectedComponents(dark.view(np.uint8))
        corners = label[[0, 0, -1, -1], [0, -1, 0, -1]]
        outside = np.isin(label, corners[corners > 0])
        if np.count_nonzero(corners) < MIN_SURROUND_CORNERS or outside.mean() < MIN_SURROUND_AREA:
            return None
        return _surround_with_edge(outside, self.brightest)

    def overlay(self) -> BoolArray | None:
        """Return which pixels show something fixed to the camera, in the small size, shape (h, w); None if none."""
        if self.fine is None or self.contrast is None or self.pairs is None:
            return None
        visible = (self.pairs >= MIN_COUNTED_PAIRS) & (self.contrast > self.pairs * MIN_FINE_STRUCTURE_8_BIT)
        surround = self.surround()
        hidden = (None if self.allowed is None else ~self.allowed, surround)
        for part in (one for one in hidden if one is not None):
            visible &= ~_widened(part, OVERLAY_LINE_PX)  # close to its edge, every pixel deviates from it
        fixed = visible & (np.abs(self.fine) > MIN_OVERLAY_AGREEMENT * self.contrast)
        if surround is not None:
            # The edge of an image circle may be soft: what is close to it belongs to it.
            edge = _widened(surround, OVERLAY_LINE_PX)
            _, label = cv2.connectedComponents((_widened(fixed, OVERLAY_LINE_PX) | edge).view(np.uint8))
            fixed &= ~np.isin(label, np.unique(label[edge]))
        lines = _large_parts(fixed, MIN_OVERLAY_PX, connectivity=8)
        if not lines.any():
            return None
        line = np.ones((OVERLAY_LINE_PX, OVERLAY_LINE_PX), np.uint8)
        outside = cv2.morphologyEx(lines.astype(np.uint8), cv2.MORPH_CLOSE, line) == 0
        # Lines enclose the inside of a letter or a box, possibly together with the border of the image.
        found = _widened(~_large_parts(outside, MAX_ENCLOSED_SHARE * lines.size, connectivity=4))
        return found if found.mean() <= MAX_OVERLAY_SHARE else None

    @property
    def overlay_share(self) -> float:
        """Share of the image that shows something fixed to the camera."""
        found = self.overlay()
        return 0.0 if found is None else float(found.mean())

    def usable_radius(self) -> float:
        """Return the radius of the usable part, in half diagonals; at most 1.

        That of an image circle is about its own centre, as the vignette is; others are about the image centre.
        """
        # The margin has no observations, but its pixels show the scene: V is needed there, too.
        reached = 1.0 if self._surround is None else _lit_radius(~self._surround.dark)
        if self.allowed is not None:
            reached = min(reached, _farthest(self.allowed))
        return reached if 0 < reached < 1 else 1.0

    def shows_scene(self, position: FloatArray) -> BoolArray | None:
        """Return which positions, in half diagonals, show the scene, (n, 2) -> (n,); None if all do."""
        hidden = _together(self.surround(), self.overlay())
        if hidden is None:
            return None
        size = size_of(hidden)
        x, y = np.clip(np.rint(pixels_of(position, size)).astype(np.int64), 0, np.array(size) - 1).T
        return np.asarray(~hidden[y, x])


def _together(*parts: BoolArray | None) -> BoolArray | None:
    """Return the union of the parts that there are, shape (h, w); None if there are none."""
    present = [part for part in parts if part is not None]
    return np.asarray(np.logical_or.reduce(present)) if present else None


def _surround_with_edge(outside: BoolArray, brightest: npt.NDArray[np.uint8]) -> _Surround | None:
    """Return a dark part as a surround; None if its edge is not that of a surround."""
    # An image circle has an edge. The dark corners of a wide lens do not, and they show the scene.
    inside = _widened(outside, 2 * SURROUND_MARGIN_PX) & ~_widened(outside)
    within, beyond = np.median(brightest[inside]), np.median(brightest[outside])
    if within <= MIN_EDGE_RATIO * beyond:
        return None
    if _has_sharp_edge(outside, brightest):
        return _Surround(outside, _widened(outside), None)
    # Only optics make a soft edge, and theirs is round: any other one is that of a dark part of the scene.
    circle = _image_circle(~outside)
    return None if circle is None else _Surround(outside, _widened(outside, SOFT_SURROUND_MARGIN_PX), circle[0])


def _has_sharp_edge(dark: BoolArray, brightest: npt.NDArray[np.uint8]) -> bool:
    """Return whether the edge of a surround, given without its margin, is sharp."""
    margin = _widened(dark)
    inside = _widened(margin) & ~margin
    margin_level, inner_level = np.median(brightest[margin & ~dark]), np.median(brightest[inside])
    return bool(margin_level >= MIN_SHARP_EDGE_RATIO * inner_level)


def _fine_structure(image: npt.NDArray[np.uint8]) -> Float32Array:
    """Return the deviation of each pixel from its surroundings, limited for outliers; NaN at the border."""
    level = cv2.medianBlur(image, 3).astype(np.float32)  # without defective pixels and columns
    deviation = level - cv2.blur(level, (OVERLAY_LINE_PX, OVERLAY_LINE_PX))
    found = np.clip(deviation, -MAX_FINE_STRUCTURE_8_BIT, MAX_FINE_STRUCTURE_8_BIT)
    inside = np.full_like(found, np.nan)  # where the surroundings extend beyond the border
    margin = OVERLAY_LINE_PX // 2
    inside[margin:-margin, margin:-margin] = found[margin:-margin, margin:-margin]
    return np.asarray(inside)


def _nearest(mask: BoolArray) -> IntArray:
    """Return the flat index of the pixel of a mask that is nearest to each pixel, shape (h, w)."""
    outside = (~mask).view(np.uint8)
    _, label = cv2.distanceTransformWithLabels(outside, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL)
    inside = np.flatnonzero(mask)
    index = np.zeros(label.max() + 1, np.int64)
    index[label.ravel()[inside]] = inside
    return np.asarray(index[label])


def _lit_radius(lit: BoolArray) -> float:
    """Return the radius of an image circle, or how far from the image centre a part of another shape reaches."""
    circle = _image_circle(lit)
    return _farthest(_without_specks(lit)) if circle is None else circle[1]


def _image_circle(lit: BoolArray) -> tuple[FloatArray, float] | None:
    """Return centre and radius of the circle that a lit part fills, in half diagonals; None if it fills none."""
    lit, size = _without_specks(lit), size_of(lit)
    if not lit.any():
        return None
    centre_px, radius_px = cv2.minEnclosingCircle(cv2.convexHull(cv2.findNonZero(lit.view(np.uint8))))
    centre, radius = normalised(np.array(centre_px), size), radius_px / half_diagonal(size)
    inside = np.count_nonzero(np.linalg.norm(normalised(pixel_grid(size), size) - centre, axis=-1) <= radius)
    return (centre, radius) if np.count_nonzero(lit) >= MIN_CIRCLE_FILL * inside else None


def _without_specks(lit: BoolArray) -> BoolArray:
    """Return the lit part without specks at its edge."""
    return _widened(~_widened(~lit))


def _farthest(part: BoolArray) -> float:
    """Return the largest distance of a pixel from the image centre, in half diagonals; 1 if a corner is near it."""
    size = size_of(part)
    distance = float(np.linalg.norm(normalised(pixel_grid(size), size)[part], axis=-1).max(initial=0.0))
    return distance if distance < WHOLE_IMAGE_RADIUS else 1.0


def _large_parts(mask: BoolArray, min_px: float, *, connectivity: int) -> BoolArray:
    """Return the connected parts of a mask with at least this many pixels."""
    _, label, statistics, _ = cv2.connectedComponentsWithStats(mask.view(np.uint8), connectivity=connectivity)
    large = statistics[:, cv2.CC_STAT_AREA] >= min_px
    large[0] = False  # the background
    return np.asarray(large[label])


def _widened(mask: BoolArray, margin_px: int = SURROUND_MARGIN_PX) -> BoolArray:
    """Return a mask with a margin around it."""
    side = 2 * margin_px + 1
    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8)) > 0)
