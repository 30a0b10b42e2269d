"""Which pairs of frames the paper's method compares (paper, sections 3.2 and 4.1)."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from ospc.correspondence.features import Features


@dataclass
class ExposureChangePairs:
    """Pairs with enough change of exposure, for the response.

    Each frame of a window is paired with the first later one of the same window whose exposure ratio to it leaves
    the open interval between ``low`` and ``high``.

    Attributes
    ----------
    window
        Number of frames after which the pairs make one estimate.
    low, high
        Largest exposure ratio below one, and smallest above one, that qualify.
    """

    window: int
    low: float
    high: float
    _waiting: list[Features] = field(default_factory=list, repr=False)
    _seen: int = field(default=0, repr=False)

    def push(self, features: Features) -> list[tuple[Features, Features]]:
        """Take the next frame and return the pairs that it completes."""
        if self._seen == self.window:
            self._waiting, self._seen = [], 0
        pairs, waiting = [], []
        for left in self._waiting:
            ratio = left.exposure_ms / features.exposure_ms
            if ratio <= self.low or ratio >= self.high:
                pairs.append((left, features))
            else:
                waiting.append(left)
        self._waiting = [*waiting, features]
        self._seen += 1
        return pairs

    @property
    def window_full(self) -> bool:
        """Whether the last frame pushed was the last of its window."""
        return self._seen == self.window


@dataclass
class OffsetPairs:
    """Pairs a fixed number of frames apart, for the vignette.

    Attributes
    ----------
    window
        Number of frames after which the pairs make one estimate.
    offset
        Frames between the two of a pair.
    """

    window: int
    offset: int
    _recent: deque[Features] = field(default_factory=deque, repr=False)
    _seen: int = field(default=0, repr=False)

    def push(self, features: Features) -> list[tuple[Features, Features]]:
        """Take the next frame and return the pair that it completes, if any."""
        if self._seen == self.window:
            self._seen = 0
        self._recent.append(features)
        self._seen += 1
        if len(self._recent) <= self.offset:
            return []
        return [(self._recent.popleft(), features)]

    @property
    def window_full(self) -> bool:
        """Whether the last frame pushed was the last of its window."""
        return self._seen == self.window
