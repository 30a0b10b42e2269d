"""What every recording offers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Protocol, runtime_checkable

from ospc.arrays import FloatArray, ImageSize
from ospc.recording.frame import Frame


@runtime_checkable
class Recording(Protocol):
    """Frames in temporal order, none of them held in memory.

    Iterating twice gives the same frames twice.
    """

    @property
    def path(self) -> Path:
        """Where it was opened from."""
        ...

    @property
    def kind(self) -> str:
        """Name of the kind of recording, as ``--kind`` takes it."""
        ...

    @property
    def size(self) -> ImageSize:
        """Width and height of its frames in pixels."""
        ...

    @property
    def max_grey(self) -> int:
        """Largest grey value the sensor delivers."""
        ...

    @property
    def exposures_ms(self) -> FloatArray:
        """Exposure of every frame in milliseconds times linear gain, shape (frames,)."""
        ...

    @property
    def stamps_s(self) -> FloatArray:
        """Time stamp of every frame in seconds, shape (frames,)."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know about how it was read: units inferred, lines ignored."""
        ...

    def __len__(self) -> int:
        """Return the number of frames, unreadable ones included."""
        ...

    def __iter__(self) -> Iterator[Frame]:
        """Give the frames one by one."""
        ...
