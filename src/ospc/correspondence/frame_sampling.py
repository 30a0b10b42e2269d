"""Which frames are processed: all at first, then ever fewer; and which are compared with their neighbours."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace


@dataclass
class FrameSampler:
    """Decides what is done with a frame: nothing, comparing its brightness with its neighbours', or processing it.

    Pauses between processed frames grow with their number. In between, short runs of consecutive frames are compared:
    they tell whether exposures still belong to their frames, and cost little.
    """

    frames_per_slowdown: int
    """After so many processed frames, one more frame is skipped between two of them."""
    dense_frames: int
    """Beyond so many processed frames, pauses grow faster: with the fourth power of their number."""
    longest_pause_frames: int
    """Most frames skipped between two processed ones."""
    comparison_period_frames: int
    """Frames from the beginning of one run of compared frames to that of the next."""
    comparison_run_frames: int
    """Frames that are compared in each of these periods, the first ones."""
    processed: int = 0
    """Frames processed so far."""
    number: int = 0
    """Number of the next frame."""
    _pause: int = 0
    _restarted_after: int = 0

    @classmethod
    def every_frame(cls) -> FrameSampler:
        """Return a sampler that processes every frame."""
        return cls(sys.maxsize, sys.maxsize, 0, 1, 1)

    @property
    def processes_next(self) -> bool:
        """Whether the next frame is to be processed."""
        return self._pause == 0

    @property
    def compares_next(self) -> bool:
        """Whether the brightness of the next frame is to be compared with that of the one before."""
        return self.processes_next or self.number % self.comparison_period_frames < self.comparison_run_frames

    def at(self, number: int) -> FrameSampler:
        """Return the sampler as it will be before the frame with this number, a later one."""
        ahead = replace(self)
        while ahead.number < number:
            ahead.advance()
        return ahead

    def skip(self) -> None:
        """Go on by one frame that could not be processed: where it was to be, the next one is."""
        self.number += 1
        self._pause = max(self._pause - 1, 0)

    def advance(self, longest_pause: int = sys.maxsize) -> None:
        """Go on by one frame, which was processed if it was to be; no more than ``longest_pause`` are skipped now."""
        self.number += 1
        if self._pause == 0:
            self._pause = self._next_pause()
            self.processed += 1
        else:
            self._pause -= 1
        self._pause = min(self._pause, longest_pause)

    def restart(self) -> None:
        """Begin with all frames again: nothing is known of the camera any more."""
        self._restarted_after, self._pause = self.processed, 0

    def _next_pause(self) -> int:
        processed = self.processed - self._restarted_after
        pause = processed // self.frames_per_slowdown
        if processed > self.dense_frames:
            pause = pause * processed**3 // self.dense_frames**3
        return min(pause, self.longest_pause_frames)
