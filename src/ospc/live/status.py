"""Where a live calibration stands."""

from __future__ import annotations

from dataclasses import dataclass

from ospc.engine_state import Epoch
from ospc.live.advice import Instruction
from ospc.methods.method import Progress


@dataclass(frozen=True)
class LiveStatus:
    """Where a live calibration stands; taken without waiting.

    Attributes
    ----------
    frames
        Frames pushed so far.
    processed
        Frames that the background has processed.
    dropped
        Frames that should have been processed, but too many images were waiting.
    unusable
        Frames that could not be used.
    reasons
        Why frames could not be used, the latest last.
    converged
        Whether response and vignette were identifiable at the latest estimate.
    converged_after
        Frames pushed when they first were; None before.
    notes
        When they became known, and whether and how the camera changed since.
    epochs
        The epochs of the camera, one more than it changed. Those that ended hold their calibration.
    progress
        The method's own figures.
    instruction
        What to film next, and why.
    """

    frames: int
    processed: int
    dropped: int
    unusable: int
    reasons: tuple[str, ...]
    converged: bool
    converged_after: int | None
    notes: tuple[str, ...]
    epochs: tuple[Epoch, ...]
    progress: Progress
    instruction: Instruction

    @property
    def advice(self) -> str:
        """What to film next, as text: one instruction at a time, until it says that it is done."""
        return self.instruction.text
