"""Selection of the frames that are processed, all at first and then fewer, or compared with their neighbours."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace


@dataclass
class FrameSampler:
    """Decides whether a frame is skipped, compared in brightness with its neighbours, or processed.

    Pauses between processed frames grow with their number. In between, short runs of consecutive frames are compared,
    a cheap way to check that exposures still belong to their frames.
    """

    frames_per_slowdown: int
    """After every n processed frames, one more frame is skipped between two processed frames."""
    dense_frames: int
    """Beyond this many processed frames, pauses grow faster: with the fourth power of their number."""
    longest_pause_frames: int
    """Maximum number of frames skipped between two processed ones."""
    comparison_period_frames: int
    """Number of frames from the start of one run of compared frames to the next."""
    comparison_run_frames: int
    """Number of compared frames at the start of each of these periods."""
    processed: int = 0
    """Number of frames processed so far."""
    number: int = 0
    """Number of the next frame."""
    expects_repeats: bool = False
    """Whether the frame before each processed one is compared too, because frames may repeat the previous image."""
    _pause: int = 0
    _restarted_after: int = 0

    @classmethod
    def every_frame(cls) -> FrameSampler:
        """Return a sampler that processes every frame."""
        return cls(sys.maxsize, sys.maxsize, 0, 1, 1)

    @property
    def processes_next(self) -> bool:
        """Whether the next frame is processed."""
        return self._pause == 0

    @property
    def compares_next(self) -> bool:
        """Whether the brightness of the next frame is compared with that of the previous one."""
        in_run = self.number % self.comparison_period_frames < self.comparison_run_frames
        return self.processes_next or in_run or (self.expects_repeats and self._pause == 1)

    def at(self, number: int) -> FrameSampler:
        """Return the sampler as it will be before a later frame with this number."""
        ahead = replace(self)
        while ahead.number < number:
            ahead.advance()
        return ahead

    def skip(self) -> None:
        """Advance by one frame that could not be processed; the next one is processed in its place."""
        self.number += 1
        self._pause = max(self._pause - 1, 0)

    def advance(self, longest_pause: int = sys.maxsize) -> None:
        """Advance by one frame, which was processed if due; at most ``longest_pause`` frames are skipped now."""
        self.number += 1
        if self._pause == 0:
            self._pause = self._next_pause()
            self.processed += 1
        else:
            self._pause -= 1
        self._pause = min(self._pause, longest_pause)

    def begin_epoch(self) -> None:
        """Process all frames again at first, because the camera changed."""
        self._restarted_after, self._pause = self.processed, 0

    def _next_pause(self) -> int:
        processed = self.processed - self._restarted_after
        pause = processed // self.frames_per_slowdown
        if processed > self.dense_frames:
            pause = pause * processed**3 // self.dense_frames**3
        return min(pause, self.longest_pause_frames)
