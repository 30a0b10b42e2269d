"""Which matches agree with the motion around them (paper, section 3.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ospc.arrays import BoolArray, FloatArray, ImageSize


@dataclass(frozen=True)
class DirectionFilter:
    """Keeps the matches whose displacement points the way most of their block's do.

    Displacements longer than mean + ``length_sigmas`` standard deviations go first. The image is then cut into
    blocks; in each with more than ``min_matches`` matches, only the fullest bin of the histogram of directions
    survives. The bins are laid about the block's mean direction, so that no direction (±180° as little as 0°) is
    torn apart by a bin's edge. Blocks with fewer matches tell nothing and stay as they are.

    Attributes
    ----------
    blocks
        Number of blocks along each side.
    bins
        Number of bins of the full circle.
    min_matches
        Most matches a block may have and still be left alone.
    length_sigmas
        Standard deviations above the mean at which a displacement is too long.
    """

    blocks: int = 15
    bins: int = 10
    min_matches: int = 5
    length_sigmas: float = 2.0

    def __call__(self, points0: FloatArray, points1: FloatArray, size: ImageSize) -> BoolArray:
        """Return which matches survive.

        Parameters
        ----------
        points0, points1
            Pixel coordinates in the two frames, shape (n, 2).
        size
            Width and height in pixels.

        Returns
        -------
        BoolArray
            Shape (n,).
        """
        displacement = points1 - points0
        length = np.linalg.norm(displacement, axis=1)
        if not len(length):
            return np.zeros(0, dtype=np.bool_)
        # Of equal displacements none is too long, whatever rounding makes of their mean and spread.
        longest = length.mean() + self.length_sigmas * length.std() + 1e-9 * length.max()
        kept = np.asarray(length <= longest)
        index = np.flatnonzero(kept)
        kept[index] = self._in_fullest_bin(points0[index], displacement[index], size)
        return kept

    def _in_fullest_bin(self, points: FloatArray, displacement: FloatArray, size: ImageSize) -> BoolArray:
        cell = np.clip((points / np.array(size) * self.blocks).astype(np.int64), 0, self.blocks - 1)
        block = cell[:, 1] * self.blocks + cell[:, 0]
        count = self.blocks**2
        length = np.linalg.norm(displacement, axis=1)
        unit = displacement / np.where(length > 0, length, 1)[:, None]
        mean_x, mean_y = (np.bincount(block, unit[:, i], minlength=count)[block] for i in (0, 1))
        # Angle to the block's mean direction, from sine and cosine: nothing happens at ±180°.
        angle = np.arctan2(mean_x * unit[:, 1] - mean_y * unit[:, 0], mean_x * unit[:, 0] + mean_y * unit[:, 1])
        width = 2 * np.pi / self.bins
        direction = np.floor(angle / width + 0.5).astype(np.int64) % self.bins
        histogram = np.zeros((count, self.bins), np.int64)
        np.add.at(histogram, (block, direction), 1)
        crowded = histogram.sum(axis=1)[block] > self.min_matches
        return np.asarray(~crowded | (direction == histogram.argmax(axis=1)[block]))
