"""The interface of recordings, the base class of readers, the identity of recordings, and a recording in memory."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from hashlib import sha256
from itertools import islice
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from ospc.arrays import FloatArray, Image, ImageSize, numbers_of, size_of
from ospc.errors import ExposureError, FrameError, RecordingError, escaped, listed
from ospc.photometry.grey_range import checked_max_grey
from ospc.recording.channel import Channel
from ospc.recording.frame import Frame, check_image, check_size
from ospc.recording.frame_table import checked_exposures, checked_stamps
from ospc.recording.pixel_layout import PixelLayout, detect_bit_depth


@runtime_checkable
class Recording(Protocol):
    """Frames in temporal order, which are not kept in memory.

    It can be iterated over repeatedly.
    """

    @property
    def path(self) -> Path:
        """Path from which it was opened."""

    @property
    def kind(self) -> str:
        """Name of the kind of recording, as for ``--kind``."""

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
        """Notes for the user about how it was read, such as inferred units and ignored lines."""

    def __len__(self) -> int:
        """Return the number of frames, including unreadable ones."""

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames in order, not yet decoded."""


def stored_bytes(recording: Recording, index: int) -> bytes:
    """Return bytes that identify the image of a frame: its stored form, which avoids decoding, or its pixels.

    Raises
    ------
    FrameError
        If the image cannot be read.
    """
    stored: Callable[[int], bytes] | None = getattr(recording, "stored_bytes", None)
    if stored is not None:
        return stored(index)
    frame = next(islice(recording, index, None), None)
    if frame is None:
        raise FrameError(f"{recording.path}: ends before frame {index}")
    return frame.image.tobytes()


@dataclass(frozen=True, eq=False, kw_only=True)
class StoredRecording(ABC):
    """Base class of the readers in this package: a recording whose images are decoded on demand.

    ``channel`` is the channel of colour images to use, None for the default; ``ALL`` keeps them in colour.
    ``exposures_estimated`` is whether exposures were estimated from the images, up to one exponent. ``layout`` is how
    grey values are read from stored images; None if those are used unchanged.
    """

    path: Path
    kind: str
    size: ImageSize
    max_grey: int
    exposures_ms: FloatArray = field(repr=False)
    stamps_s: FloatArray = field(repr=False)
    notes: tuple[str, ...] = ()
    channel: Channel | None = None
    exposures_estimated: bool = False
    layout: PixelLayout | None = None

    @abstractmethod
    def stored_bytes(self, index: int) -> bytes:
        """Return the stored form of the image of a frame, which identifies the recording."""

    @abstractmethod
    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames in order, not yet decoded."""

    def __len__(self) -> int:
        return len(self.exposures_ms)

    def _frame(self, index: int, name: str, load: Callable[[], Image], **more: Any) -> Frame:
        """Return a frame; ``more`` are further fields of it."""
        stamp_s, exposure_ms = float(self.stamps_s[index]), float(self.exposures_ms[index])
        colour = self.channel is Channel.ALL
        return Frame(index, stamp_s, exposure_ms, name, load, self.max_grey, colour=colour, **more)


_SAMPLES = 5
"""Number of evenly spread images to hash: enough to distinguish recordings, and fast."""


def identity(recording: Recording) -> dict[str, Any]:
    """Return a description by which a recording can be recognised, also after it is moved.

    The description is JSON-compatible: kind, name of the folder or file, number of frames, size, largest grey value,
    range of the exposures, SHA-256 of stamps and exposures, and SHA-256 of a few stored images with their masks.
    ``scene_sha256`` is the same for all exposures and masks that the recording may be opened with.
    """
    exposures_ms = recording.exposures_ms
    indices = sorted({int(i) for i in np.linspace(0, max(len(recording) - 1, 0), _SAMPLES)})
    return {
        "kind": recording.kind,
        "name": escaped(recording.path.name or recording.path.resolve().name),
        "frames": len(recording),
        "size": list(recording.size),
        "max_grey": recording.max_grey,
        "exposure_range_ms": [float(np.nanmin(exposures_ms)), float(np.nanmax(exposures_ms))],
        "frames_sha256": frames_sha256(recording),
        "images_sha256": (images := _images_sha256(recording, indices)),
        "images_hashed": indices,
        "scene_sha256": _scene_sha256(recording, indices, images),
    }


def frames_sha256(recording: Recording) -> str:
    """Return the SHA-256 of the stamps and exposures of all frames as recorded."""
    stamps_s, exposures_ms = (np.asarray(each, "<f8") for each in (recording.stamps_s, recording.exposures_ms))
    return sha256(stamps_s.tobytes() + exposures_ms.tobytes()).hexdigest()


def _scene_sha256(recording: Recording, indices: list[int], images: str) -> str:
    """Hash the stamps and a few images without masks; ``images`` is the hash of the images with masks."""
    unmasked = getattr(recording, "unmasked", recording)
    if unmasked is not recording:
        images = _images_sha256(unmasked, indices)
    return sha256(np.asarray(recording.stamps_s, "<f8").tobytes() + images.encode()).hexdigest()


def _images_sha256(recording: Recording, indices: list[int]) -> str:
    """Hash a few images; one that cannot be read counts as empty."""
    channel = getattr(recording, "channel", None)
    total = sha256(b"" if channel is None else channel.value.encode())
    # Without stored forms, one pass over the frames finds all images.
    stored = hasattr(recording, "stored_bytes")
    with suppress(RecordingError):  # the images before a damaged end are enough
        for item in indices if stored else (frame for frame in recording if frame.index in indices):
            try:
                content = item.image.tobytes() if isinstance(item, Frame) else stored_bytes(recording, item)
            except (FrameError, OSError):
                content = b""
            total.update(sha256(content).digest())
    return total.hexdigest()


class ArrayRecording(StoredRecording):
    """Images in memory with their exposures.

    Parameters
    ----------
    images
        Grey images, uint8 or uint16: an array of shape (frames, height, width), or a sequence of arrays of shape
        (height, width). They are not copied.
    exposures_ms
        Exposure time in milliseconds times linear gain of every frame, NaN if unknown, shape (frames,).
    stamps_s
        Time stamps in seconds, strictly increasing, shape (frames,); by default one frame per second.
    name
        Name of the recording in messages.
    max_grey
        Largest grey value the sensor delivers; by default 255 for uint8, and inferred from the values for uint16.

    Raises
    ------
    ExposureError
        If known exposures are not finite and positive, all are unknown, or there is not one per image.
    RecordingError
        If there are no images, the first is not a grey image, ``max_grey`` is invalid, or stamps do not increase.

    Examples
    --------
    >>> import numpy as np
    >>> images = np.full((2, 4, 6), 100, dtype=np.uint8)
    >>> recording = ArrayRecording(images, [1.0, 2.0])
    >>> len(recording), recording.size, recording.max_grey
    (2, (6, 4), 255)
    """

    def __init__(
        self,
        images: npt.NDArray[np.generic] | Sequence[Image],
        exposures_ms: npt.ArrayLike,
        stamps_s: npt.ArrayLike | None = None,
        *,
        name: str = "array",
        max_grey: int | None = None,
    ) -> None:
        if len(images) == 0:
            raise RecordingError(f"{name}: has no images; give at least one")
        first = check_image(images[0], f"{name}[0]")
        notes: tuple[str, ...] = ()
        if max_grey is None:
            # Arrays are used unchanged, so unused low bits of left-aligned data remain.
            pixels = (np.asarray(image) for image in images)
            alike = (image for image in pixels if image.dtype.newbyteorder("=") == first.dtype)
            depth = detect_bit_depth(image.astype(first.dtype, copy=False) for image in alike)
            max_grey = depth.max_grey << depth.shift
            notes = () if depth.note is None else (f"{name}: largest grey value assumed to be {max_grey}",)
        stamps = np.arange(len(images)) if stamps_s is None else stamps_s

        def where(frames: Sequence[int]) -> str:
            return f"{name}[{listed(frames)}]"

        super().__init__(
            path=Path(name),
            kind="array",
            size=size_of(first),
            max_grey=checked_max_grey(max_grey, name),
            exposures_ms=checked_exposures(_column(exposures_ms, len(images), "exposures", name), where),
            stamps_s=checked_stamps(_column(stamps, len(images), "time stamps", name), where),
            notes=notes,
        )
        self._images = images
        self._name = name

    def __iter__(self) -> Iterator[Frame]:
        for index in range(len(self)):
            yield self._frame(index, f"{self._name}[{index}]", partial(self._load, index))

    def stored_bytes(self, index: int) -> bytes:
        """Return the pixels of a frame."""
        return np.ascontiguousarray(self._images[index]).tobytes()

    def _load(self, index: int) -> Image:
        name = f"{self._name}[{index}]"
        image = check_image(self._images[index], name)
        check_size(size_of(image), self.size, name)
        return image


def _column(values: npt.ArrayLike, count: int, what: str, name: str) -> FloatArray:
    """Return one number per frame."""
    column = numbers_of(values)
    if column is None:
        raise ExposureError(f"{name}: {what} must be numbers, one per frame")
    if column.shape != (count,):
        raise ExposureError(f"{name}: {what} have shape {column.shape}; give one per frame, {count} in all")
    return column
