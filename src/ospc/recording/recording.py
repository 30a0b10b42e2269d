"""What every recording offers, the part that all readers of this package share, and what tells recordings apart."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from hashlib import sha256
from itertools import islice
from pathlib import Path
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np

from ospc.arrays import FloatArray, Image, ImageSize
from ospc.errors import FrameError, escaped
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

    @property
    def kind(self) -> str:
        """Name of the kind of recording, as ``--kind`` takes it."""

    @property
    def size(self) -> ImageSize:
        """Width and height of the frames in pixels."""

    @property
    def max_grey(self) -> int:
        """Largest grey value the sensor delivers."""

    @property
    def exposures_ms(self) -> FloatArray:
        """Exposure time in milliseconds times linear gain of every frame, shape (frames,)."""

    @property
    def stamps_s(self) -> FloatArray:
        """Time stamp of every frame in seconds, shape (frames,)."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know about how it was read: units that were inferred, lines that were ignored."""

    def __len__(self) -> int:
        """Return the number of frames, unreadable ones included."""

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames in order, not yet decoded."""


def stored_bytes(recording: Recording, index: int) -> bytes:
    """Return what identifies the image of a frame: its stored form, cheaper than decoding, or else its pixels.

    FrameError if it cannot be read.
    """
    stored: Callable[[int], bytes] | None = getattr(recording, "stored_bytes", None)
    if stored is not None:
        return stored(index)
    return next(islice(recording, index, None)).image.tobytes()


@dataclass(frozen=True, eq=False, kw_only=True)
class StoredRecording(ABC):
    """A recording whose images are decoded when they are asked for: the base class of this package's readers.

    ``channel`` is taken from colour images: the default one if None, and the colour images as they are if ``ALL``.
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


_SAMPLES = 5
"""Images hashed, evenly spread: enough to tell recordings apart, few enough to cost nothing."""


def identity(recording: Recording) -> dict[str, Any]:
    """Describe a recording so that it can be recognised again, wherever it is moved to.

    The description is JSON-compatible: kind, name of the folder or file, number of frames, size, largest grey value,
    range of the exposures, SHA-256 over stamps and exposures, and SHA-256 over a few images as they are stored.
    """
    exposures_ms = np.asarray(recording.exposures_ms, dtype="<f8")
    stamps_s = np.asarray(recording.stamps_s, dtype="<f8")
    indices = sorted({int(i) for i in np.linspace(0, max(len(recording) - 1, 0), _SAMPLES)})
    return {
        "kind": recording.kind,
        "name": escaped(recording.path.name or recording.path.resolve().name),
        "frames": len(recording),
        "size": list(recording.size),
        "max_grey": recording.max_grey,
        "exposure_range_ms": [float(exposures_ms.min()), float(exposures_ms.max())],
        "frames_sha256": sha256(stamps_s.tobytes() + exposures_ms.tobytes()).hexdigest(),
        "images_sha256": _images_sha256(recording, indices),
        "images_hashed": indices,
    }


def _images_sha256(recording: Recording, indices: list[int]) -> str:
    """Hash a few images; an unreadable one counts as empty."""
    channel = getattr(recording, "channel", None)
    total = sha256(b"" if channel is None else channel.value.encode())
    for load in _stored(recording, indices):
        try:
            stored = load()
        except FrameError:
            stored = b""
        total.update(sha256(stored).digest())
    return total.hexdigest()


def _stored(recording: Recording, indices: list[int]) -> Iterator[Callable[[], bytes]]:
    """Give what loads the stored form of some frames, or their pixels, in one pass over the frames at most."""
    stored: Callable[[int], bytes] | None = getattr(recording, "stored_bytes", None)
    if stored is not None:
        yield from (partial(stored, index) for index in indices)
        return
    for frame in recording:
        if frame.index in indices:
            yield partial(_pixels, frame)


def _pixels(frame: Frame) -> bytes:
    return frame.image.tobytes()
