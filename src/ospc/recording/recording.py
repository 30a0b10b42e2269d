"""What every recording offers, and the part that all readers of this package share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, Self, runtime_checkable

from ospc.arrays import FloatArray, Image, ImageSize
from ospc.recording.channel import Channel
from ospc.recording.frame import Frame


@runtime_checkable
class Recording(Protocol):
    """Frames in temporal order, none of them held in memory.

    Iterating twice gives the same frames twice.
    """

    @property
    def path(self) -> Path:
        """Path it was opened from."""
        ...

    @property
    def kind(self) -> str:
        """Name of the kind of recording, as ``--kind`` takes it."""
        ...

    @property
    def size(self) -> ImageSize:
        """Width and height of the frames in pixels."""
        ...

    @property
    def max_grey(self) -> int:
        """Largest grey value the sensor delivers."""
        ...

    @property
    def exposures_ms(self) -> FloatArray:
        """Exposure time in milliseconds times linear gain of every frame, shape (frames,)."""
        ...

    @property
    def stamps_s(self) -> FloatArray:
        """Time stamp of every frame in seconds, shape (frames,)."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know about how it was read: units that were inferred, lines that were ignored."""
        ...

    def __len__(self) -> int:
        """Return the number of frames, unreadable ones included."""
        ...

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames in order, not yet decoded."""
        ...


@runtime_checkable
class HasStoredBytes(Protocol):
    """A recording that returns its images as they are stored, which is cheaper than decoding them."""

    def stored_bytes(self, index: int) -> bytes:
        """Return the stored form of a frame's image; FrameError if it cannot be read."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class StoredRecording(ABC):
    """A recording whose images are decoded when they are asked for: the base class of this package's readers.

    Attributes
    ----------
    path, kind, size, max_grey, exposures_ms, stamps_s, notes
        As in :class:`Recording`.
    channel
        Channel taken from colour images; the default one if None, and the colour images as they are if ``ALL``.
    """

    path: Path
    kind: str
    size: ImageSize
    max_grey: int
    exposures_ms: FloatArray = field(repr=False)
    stamps_s: FloatArray = field(repr=False)
    notes: tuple[str, ...] = ()
    channel: Channel | None = None

    @abstractmethod
    def stored_bytes(self, index: int) -> bytes:
        """Return the stored form of a frame's image, which identifies the recording."""

    @abstractmethod
    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames in order, not yet decoded."""

    def __len__(self) -> int:
        """Return the number of frames, unreadable ones included."""
        return len(self.exposures_ms)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:  # noqa: B027 (most recordings keep no file open)
        """Close open files; images cannot be read afterwards."""

    def _frame(
        self,
        index: int,
        name: str,
        load: Callable[[], Image],
        verify: Callable[[], None] | None = None,
        *,
        threads: bool = False,
    ) -> Frame:
        stamp_s, exposure_ms = float(self.stamps_s[index]), float(self.exposures_ms[index])
        colour = self.channel is Channel.ALL
        return Frame(index, stamp_s, exposure_ms, name, load, self.max_grey, verify, threads=threads, colour=colour)
