"""The changes of brightness from frame to frame, collected while the frames come in."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ospc.correspondence.thumbnail import Thumbnail
from ospc.exposures.brightness import BrightnessChange, BrightnessComparer, PixelSamples
from ospc.settings.exposures import MAX_BRIGHTNESS_CHANGES, MAX_CHANGES_WITH_SAMPLES, MAX_REPEATED_FRAMES


@dataclass(frozen=True)
class PrecomputedChange:
    """The change of brightness between two frames, computed before the second one was observed."""

    first: Thumbnail
    second: Thumbnail
    change: BrightnessChange


@dataclass
class BrightnessHistory:
    """Compares each observed frame with the one before, and keeps the changes of brightness; bounded in memory.

    Attributes
    ----------
    changes
        The changes of brightness between consecutive frames that are kept, in the order of frames.
    last_frame
        Number of the frame observed last, -1 before the first.
    compared
        Number of frames that were compared with the one before.
    repeated
        Numbers of the first frames whose image is that of the frame before.
    observed
        Number of changes of brightness in this epoch, kept or not.
    """

    changes: list[BrightnessChange] = field(default_factory=list, repr=False)
    last_frame: int = -1
    compared: int = 0
    repeated: list[int] = field(default_factory=list)
    observed: int = 0

    def __post_init__(self) -> None:
        """Prepare the comparison of frames."""
        self._compare = BrightnessComparer()
        self._previous: Thumbnail | None = None

    def __len__(self) -> int:
        """Return the number of changes kept."""
        return len(self.changes)

    def observe(self, frame: Thumbnail, precomputed: PrecomputedChange | None = None) -> BrightnessChange | None:
        """Compare a frame with the one before; None if that was not observed, or if it is the same image.

        A change that was computed from just these two is taken instead.
        """
        previous, self._previous, self.last_frame = self._previous, frame, frame.frame
        if previous is None or frame.frame != previous.frame + 1:
            return None
        self.compared += 1
        # A repeated image says that a frame was lost, not that the light stayed.
        if np.array_equal(previous.grey, frame.grey) and np.ptp(frame.grey) > 0:
            self.repeated = [*self.repeated, frame.frame][:MAX_REPEATED_FRAMES]
            return None
        if precomputed is not None and precomputed.first is previous and precomputed.second is frame:
            change = precomputed.change
        else:
            change = self._compare(previous, frame)
        with_samples = len(self.changes) < MAX_CHANGES_WITH_SAMPLES
        self.changes.append(change if with_samples else replace(change, samples=PixelSamples.none()))
        self.observed += 1
        if len(self.changes) > MAX_BRIGHTNESS_CHANGES:
            self._thin_out()
        return change

    @property
    def frames_to_replay(self) -> frozenset[int]:
        """Number of the frame that :meth:`replay` needs before a restored history can go on."""
        return frozenset() if self._previous is not None or self.last_frame < 0 else frozenset([self.last_frame])

    def replay(self, frame: Thumbnail) -> None:
        """Take the frame observed last before the history was saved, so that the next is compared with it."""
        if frame.frame == self.last_frame:
            self._previous = frame

    def split(self, number: int) -> BrightnessHistory:
        """Return a history that goes on from the frame with this number; this one keeps the changes before it."""
        later = replace(self, changes=[change for change in self.changes if change.frame0 >= number])
        later.observed, later._previous = len(later.changes), self._previous
        self.changes = [change for change in self.changes if change.frame1 < number]
        return later

    def _thin_out(self) -> None:
        """Drop every second run of consecutive changes; of a single run, its older half."""
        frames = np.array([change.frame0 for change in self.changes])
        run = np.cumsum(np.diff(frames, prepend=frames[0]) > 1)
        if run[-1] == 0:
            self.changes = self.changes[len(self.changes) // 2 :]
        else:
            # The latest run is still growing: it stays.
            self.changes = [c for c, r in zip(self.changes, run, strict=True) if (run[-1] - r) % 2 == 0]
