"""From frames to features, and from two frames' features to correspondences that agree with their neighbours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from ospc.arrays import ImageSize
from ospc.correspondence.correspondences import Correspondences
from ospc.correspondence.features import FeatureExtractor, Features, extract, match
from ospc.correspondence.match_filter import DirectionFilter
from ospc.recording.frame import Frame


class Matcher(Protocol):
    """Finds features and matches them: by far the most expensive steps of the paper's method."""

    def features(self, frame: Frame) -> Features:
        """Return the features of a frame."""
        ...

    def correspondences(self, left: Features, right: Features, size: ImageSize) -> Correspondences:
        """Return the matches of two frames of a size that agree with their neighbours."""
        ...


@dataclass(frozen=True)
class FeatureMatcher:
    """Matches by descriptors and filters by direction (paper, section 3.1).

    Attributes
    ----------
    extractor
        Finds and describes features.
    direction_filter
        Says which matches survive.
    ratio
        Lowe's ratio test (Lowe 2004).
    """

    extractor: FeatureExtractor
    direction_filter: DirectionFilter
    ratio: float

    def features(self, frame: Frame) -> Features:
        """Return the features of a frame.

        Raises
        ------
        FrameError
            If its image cannot be read.
        """
        return extract(frame, self.extractor)

    def correspondences(self, left: Features, right: Features, size: ImageSize) -> Correspondences:
        """Return the matches of two frames that pass the filter.

        Parameters
        ----------
        left, right
            Features of the two frames.
        size
            Width and height of the frames in pixels.
        """
        index0, index1 = match(left, right, self.extractor.norm, self.ratio)
        points0, points1 = left.points[index0], right.points[index1]
        ratio = left.exposure_ms / right.exposure_ms
        frames = (left.frame, right.frame)
        found = Correspondences(frames, ratio, size, points0, points1, left.grey[index0], right.grey[index1])
        return found.select(self.direction_filter(points0, points1, size))
