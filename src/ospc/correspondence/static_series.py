"""Observations of a stationary camera: every pixel is the same scene point in all frames."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ospc.arrays import BoolArray, FloatArray, Image, IntArray, size_of
from ospc.correspondence.flat_sampling import ranks_in_cells
from ospc.observations import MOMENTS, SURROUND_MOMENTS, Observations
from ospc.photometry.geometry import normalised
from ospc.photometry.noise import BRIGHTEST_EXPOSED, DARKEST_EXPOSED
from ospc.recording.frame import Frame
from ospc.settings.sampling import SERIES_BRIGHTNESS_CELLS, SERIES_FRAMES, SERIES_PIXELS


@dataclass
class StaticSeries:
    """Keeps the grey values of a fixed selection of pixels, for a bounded number of frames."""

    points: int
    """Number of pixels, spread evenly over their brightness, that are used for estimation."""
    pixels: int = SERIES_PIXELS
    frames: int = SERIES_FRAMES
    """Number of pixels, and maximum number of frames kept."""
    _places: IntArray | None = field(default=None, repr=False)
    _size: tuple[int, int] = (0, 0)
    _grey: list[Image] = field(default_factory=list, repr=False)
    _index: list[int] = field(default_factory=list, repr=False)
    _stride: int = 1
    _seen: int = 0
    _max_grey: int = 255

    def observe(self, frame: Frame) -> None:
        """Add a frame."""
        self._seen += 1
        if (self._seen - 1) % self._stride:
            return
        image = frame.image
        if self._places is None:
            self._size, self._max_grey = size_of(image), frame.max_grey
            usable = np.arange(image.size) if frame.mask is None else np.flatnonzero(frame.mask)
            count = min(self.pixels, usable.size)
            self._places = np.sort(np.random.default_rng(0).choice(usable, count, replace=False))
        self._grey.append(image.ravel()[self._places])
        self._index.append(frame.index)
        if len(self._grey) > self.frames:
            self._grey, self._index = self._grey[::2], self._index[::2]
            self._stride *= 2

    def __len__(self) -> int:
        """Return the number of frames kept."""
        return len(self._grey)

    @property
    def full(self) -> bool:
        """Whether frames have already been dropped: more would hardly add information."""
        return self._stride > 1

    def observations(self) -> Observations:
        """Return the series, of at least one frame, as scene points seen in every frame; each frame is a group."""
        assert self._places is not None
        grey = np.stack(self._grey, axis=1).astype(np.float64) / self._max_grey
        exposed = (grey > DARKEST_EXPOSED) & (grey < BRIGHTEST_EXPOSED)
        chosen = self._evenly_bright(grey, exposed)
        grey = grey[chosen]
        points, frames = grey.shape
        width, height = self._size
        places = np.stack([self._places[chosen] % width, self._places[chosen] // width], axis=1).astype(np.float64)
        return Observations(
            grey=grey.ravel(),
            position=np.repeat(normalised(places, (width, height)), frames, axis=0),
            gradient=np.zeros(grey.size),
            grey_variance=np.zeros(grey.size),
            grey_third_moment=np.zeros(grey.size),
            # Glare of a stationary scene is part of its radiance.
            frame_moments=np.zeros((grey.size, MOMENTS), np.float32),
            surround_moments=np.zeros((grey.size, *SURROUND_MOMENTS), np.float32),
            frame=np.tile(np.array(self._index, dtype=np.int64), points),
            point=np.repeat(np.arange(points), frames),
            group=np.tile(np.arange(frames), points),
        )

    def _evenly_bright(self, grey: FloatArray, exposed: BoolArray) -> IntArray:
        """Return pixels exposed in at least two frames, spread evenly over the logarithm of their radiance."""
        usable = np.flatnonzero(exposed.sum(axis=1) >= 2)
        if len(usable) <= self.points:
            return usable
        # The sum over all frames increases with radiance for any response, and noise hardly affects it.
        brightness = np.log(grey[usable].sum(axis=1))
        cell = np.digitize(brightness, np.histogram_bin_edges(brightness, SERIES_BRIGHTNESS_CELLS))
        rank = ranks_in_cells(cell, np.argsort(cell, kind="stable"))
        return np.sort(usable[np.lexsort((cell, rank))[: self.points]])
