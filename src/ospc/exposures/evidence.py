"""Evidence on exposures, as it streams: how brightness changes between consecutive frames."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ospc.arrays import FloatArray, ImageSize, IntArray
from ospc.correspondence.thumbnail import Thumbnail
from ospc.exposures.brightness import BrightnessChange, BrightnessComparer, PixelSamples
from ospc.settings.exposures import MAX_CHANGES, MAX_CHANGES_WITH_SAMPLES, MAX_REPEATED_FRAMES


@dataclass(frozen=True)
class EvidenceState:
    """What :class:`ExposureEvidence` has collected, n changes of brightness in b grey bins, as arrays.

    The first six are as in :class:`~ospc.exposures.brightness.BrightnessChange`, with the shapes (n,), (n, b), (n,
    b), (n, b, 4), (n,) and (n,). ``samples`` is the number of place samples of each change, shape (n,); then come
    those of all changes, shapes (m,), (m,), (m, 2) and (m, 2). ``previous`` is the number of the last frame
    processed, -1 before the first; the rest is as in the evidence.
    """

    frame0: IntArray
    log_ratio: FloatArray
    weight: FloatArray
    moved: FloatArray
    found: FloatArray
    motion_px: FloatArray
    previous: int
    compared: int
    repeated: list[int]
    observed: int
    samples: IntArray
    place_log_ratio: FloatArray
    place_log_grey: FloatArray
    position0: FloatArray
    position1: FloatArray


@dataclass(frozen=True)
class ComparedAhead:
    """What comparing two frames gave, made before the second was observed."""

    first: Thumbnail
    second: Thumbnail
    change: BrightnessChange


@dataclass
class ExposureEvidence:
    """Collects the changes of brightness from each processed frame to the next; bounded in memory.

    ``compared`` frames were compared with the one before, and ``repeated`` holds the numbers of the first ones whose
    image is the same. ``observed`` counts the changes of brightness in this epoch, kept or not.
    """

    size: ImageSize
    _changes: list[BrightnessChange] = field(default_factory=list, repr=False)
    _previous: Thumbnail | None = field(default=None, repr=False)
    _last: int = -1
    compared: int = 0
    repeated: list[int] = field(default_factory=list)
    observed: int = 0

    def __post_init__(self) -> None:
        """Prepare the comparison of frames of this size."""
        self._compare = BrightnessComparer(self.size)

    def observe(self, frame: Thumbnail, ahead: ComparedAhead | None = None) -> BrightnessChange | None:
        """Compare a frame with the one before, and return what that gave; None if the one before was not observed.

        A comparison of just these two that was made ahead is taken as it is.
        """
        previous, self._previous = self._previous, frame
        if previous is None or frame.frame != previous.frame + 1:
            return None
        self.compared += 1
        # A repeated image says that a frame was lost, not that the light stayed.
        if np.array_equal(previous.grey, frame.grey) and np.ptp(frame.grey) > 0:
            self.repeated = [*self.repeated, frame.frame][:MAX_REPEATED_FRAMES]
            return None
        if ahead is not None and ahead.first is previous and ahead.second is frame:
            change = ahead.change
        else:
            change = self._compare(previous, frame)
        kept = (
            change if len(self._changes) < MAX_CHANGES_WITH_SAMPLES else replace(change, samples=PixelSamples.none())
        )
        self._changes.append(kept)
        self.observed += 1
        if len(self._changes) > MAX_CHANGES:
            self._thin_out()
        return change

    @property
    def changes(self) -> tuple[BrightnessChange, ...]:
        """The changes of brightness, in the order of frames."""
        return tuple(self._changes)

    def __len__(self) -> int:
        """Return the number of changes."""
        return len(self._changes)

    def recall(self, frame: Thumbnail) -> None:
        """Take the last frame processed before a state was saved, so that the next is compared with it."""
        if frame.frame == self._last:
            self._previous = frame

    @property
    def wanted(self) -> frozenset[int]:
        """Number of the frame that is to be given to :meth:`recall` after a state was restored."""
        return frozenset() if self._previous is not None or self._last < 0 else frozenset([self._last])

    def state(self) -> EvidenceState:
        """Return all that was collected."""
        places = [change.samples for change in self._changes]
        bins = len(self._changes[0].weight) if self._changes else 0

        def stacked(name: str, *shape: int) -> FloatArray:
            values = np.array([getattr(c, name) for c in self._changes], dtype=np.float64)
            return values.reshape(len(self._changes), *shape)

        def joined(name: str, *shape: int) -> FloatArray:
            return np.concatenate([np.empty((0, *shape)), *(getattr(p, name) for p in places)])

        return EvidenceState(
            np.array([c.frame0 for c in self._changes], dtype=np.int64),
            stacked("log_ratio", bins),
            stacked("weight", bins),
            stacked("moved", bins, 4),
            stacked("found"),
            stacked("motion_px"),
            self._last if self._previous is None else self._previous.frame,
            self.compared,
            self.repeated,
            self.observed,
            np.array([len(p.log_ratio) for p in places], dtype=np.int64),
            joined("log_ratio"),
            joined("log_grey"),
            joined("position0", 2),
            joined("position1", 2),
        )

    @classmethod
    def from_state(cls, size: ImageSize, state: EvidenceState) -> ExposureEvidence:
        """Go on from a state."""
        columns = state.place_log_ratio, state.place_log_grey, state.position0, state.position1
        cuts = np.cumsum(state.samples)[:-1]
        places = [PixelSamples(*part) for part in zip(*(np.split(column, cuts) for column in columns), strict=True)]
        numbers, found, motion_px = (values.tolist() for values in (state.frame0, state.found, state.motion_px))
        # Nothing at all is split into one part that is empty.
        rows = zip(numbers, state.log_ratio, state.weight, state.moved, found, motion_px, places, strict=False)
        changes = [BrightnessChange(frame0, frame0 + 1, *row) for frame0, *row in rows]
        return cls(size, changes, None, state.previous, state.compared, state.repeated, state.observed)

    def split(self, number: int) -> ExposureEvidence:
        """Return the evidence that goes on from a frame; this one keeps the changes before it."""
        changes = [change for change in self._changes if change.frame0 >= number]
        later = replace(self, _changes=changes, observed=len(changes))
        self._changes = [change for change in self._changes if change.frame1 < number]
        return later

    def _thin_out(self) -> None:
        """Drop every second run of consecutive changes; of a single run, its older half."""
        frames = np.array([change.frame0 for change in self._changes])
        run = np.cumsum(np.diff(frames, prepend=frames[0]) > 1)
        if run[-1] == 0:
            self._changes = self._changes[len(self._changes) // 2 :]
        else:
            # The latest run is still growing: it stays.
            self._changes = [c for c, r in zip(self._changes, run, strict=True) if (run[-1] - r) % 2 == 0]
