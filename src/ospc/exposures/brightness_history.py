"""Collect the brightness changes between consecutive frames as they arrive."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ospc.correspondence.thumbnail import Thumbnail
from ospc.exposures.brightness import BrightnessChange, BrightnessComparer, ComparedFrames
from ospc.settings.brightness import MAX_BRIGHTNESS_CHANGES, MAX_REPEATED_FRAMES


@dataclass
class BrightnessHistory:
    """Compares each frame with the previous one and stores the brightness changes in bounded memory."""

    changes: list[BrightnessChange] = field(default_factory=list, repr=False)
    """The stored brightness changes between consecutive frames, in frame order."""
    last_frame: int = -1
    """Number of the latest frame, -1 before the first."""
    compared: int = 0
    """Number of frames that were compared with their predecessor."""
    repeats: int = 0
    """Number of frames whose image equals that of the previous frame."""
    repeated: list[int] = field(default_factory=list)
    """Numbers of the first of these frames."""
    image_since: int = -1
    """Number of the first of the latest frames that all have the same image, -1 before the first frame."""
    observed: int = 0
    """Number of brightness changes in this epoch, stored or not."""

    def __post_init__(self) -> None:
        self._compare = BrightnessComparer()
        self._previous: Thumbnail | None = None

    def __len__(self) -> int:
        """Return the number of stored changes."""
        return len(self.changes)

    def observe(self, frame: Thumbnail) -> ComparedFrames | None:
        """Compare a frame with the previous one; None if that one is missing or has the same image."""
        if not self._repeats(frame):
            self.image_since = frame.frame
        previous, self._previous, self.last_frame = self._previous, frame, frame.frame
        if previous is None or frame.frame != previous.frame + 1:
            return None
        self.compared += 1
        # A repeated image means that a frame was lost, not that the light was constant.
        if self.image_since < frame.frame:
            self.repeats += 1
            self.repeated = [*self.repeated, frame.frame][:MAX_REPEATED_FRAMES]
            return None
        compared = self._compare(previous, frame)
        self.changes.append(compared.change)
        self.observed += 1
        if len(self.changes) > MAX_BRIGHTNESS_CHANGES:
            self._thin_out()
        return compared

    def first_with_image_of(self, frame: Thumbnail) -> int:
        """Return the number of the next frame, or of the first of the latest frames with the same image."""
        return self.image_since if self._repeats(frame) else frame.frame

    @property
    def frames_to_replay(self) -> frozenset[int]:
        """Number of the frame that a restored history needs for :meth:`replay` before it can continue."""
        return frozenset() if self._previous is not None or self.last_frame < 0 else frozenset([self.last_frame])

    def replay(self, frame: Thumbnail) -> None:
        """Supply the last frame before the history was saved, to compare the next one with it."""
        if frame.frame == self.last_frame:
            self._previous = frame

    def before(self, number: int) -> list[BrightnessChange]:
        """Return the changes between the frames before a given one."""
        return [change for change in self.changes if change.frame1 < number]

    def since(self, number: int) -> BrightnessHistory:
        """Return a history that continues with the changes from a frame on."""
        later = replace(self, changes=[change for change in self.changes if change.frame0 >= number])
        later.observed = len(later.changes)
        later._previous = self._previous
        return later

    def _repeats(self, frame: Thumbnail) -> bool:
        """Return whether the image of the next frame equals that of the latest one and is not uniform."""
        # Unless a recorder repeats an image, their noise differs.
        previous = self._previous
        if previous is None or frame.frame != previous.frame + 1:
            return False
        return bool(np.array_equal(previous.grey, frame.grey) and np.ptp(frame.grey) > 0)

    def _thin_out(self) -> None:
        """Drop every second run of consecutive changes, or the older half of a single run."""
        frames = np.array([change.frame0 for change in self.changes])
        run = np.cumsum(np.diff(frames, prepend=frames[0]) > 1)
        if run[-1] == 0:
            self.changes = self.changes[len(self.changes) // 2 :]
        else:
            # Keep the latest run: it is still growing.
            self.changes = [c for c, r in zip(self.changes, run, strict=True) if (run[-1] - r) % 2 == 0]
