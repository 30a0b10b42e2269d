"""A recording made from another one: fewer frames, other exposures, or a mask."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Self

import numpy as np

from ospc.arrays import BoolArray, FloatArray, IntArray
from ospc.errors import SettingError, counted
from ospc.recording.frame import Frame
from ospc.recording.recording import HasStoredBytes, Recording, StoredRecording


@dataclass(frozen=True, eq=False, kw_only=True)
class DerivedRecording(StoredRecording):
    """Some frames of another recording, with exposures and a mask of its own; the images are unchanged.

    Attributes
    ----------
    inner
        The other recording.
    frames
        Indices of the frames that are kept, increasing, shape (frames,).
    mask
        True where pixels may be used, shape (height, width); None to keep the masks of the inner recording.
    """

    inner: Recording
    frames: IntArray = field(repr=False)
    mask: BoolArray | None = field(default=None, repr=False)

    @classmethod
    def of(
        cls, inner: Recording, frames: IntArray, exposures_ms: FloatArray, *, mask: BoolArray | None = None, note: str
    ) -> Self:
        """Return some frames of a recording, with other exposures or a mask, and a note that says so."""
        return cls(
            path=inner.path,
            kind=inner.kind,
            size=inner.size,
            max_grey=inner.max_grey,
            exposures_ms=exposures_ms,
            stamps_s=inner.stamps_s[frames],
            notes=(*inner.notes, note),
            channel=getattr(inner, "channel", None),
            inner=inner,
            frames=frames,
            mask=mask,
        )

    def __iter__(self) -> Iterator[Frame]:
        """Yield the kept frames, numbered from 0."""
        kept = {int(frame): index for index, frame in enumerate(self.frames)}
        for frame in self.inner if kept else ():
            index = kept.pop(frame.index, None)
            if index is not None:
                mask = frame.mask if self.mask is None else self.mask
                yield replace(frame, index=index, exposure_ms=float(self.exposures_ms[index]), mask=mask)
            if not kept:
                return  # the rest of a video need not be decoded

    def stored_bytes(self, index: int) -> bytes:
        """Return the stored form of a frame's image and the mask: with another mask it is another recording."""
        inner_index = int(self.frames[index])
        if isinstance(self.inner, HasStoredBytes):
            data = self.inner.stored_bytes(inner_index)
        else:
            data = next(islice(self.inner, inner_index, None)).image.tobytes()
        return data if self.mask is None else data + np.packbits(self.mask).tobytes()


def with_exposure_lag(recording: Recording, lag: int) -> Recording:
    """Return a recording with every exposure moved to the frame it was taken with.

    It is shorter by abs(lag) frames, those whose exposure is not listed; the recording itself if the lag is 0.

    Parameters
    ----------
    recording
        The recording.
    lag
        Number of frames by which the metadata come late: the exposure listed for frame i belongs to frame i − lag.

    Raises
    ------
    SettingError
        If no frames are left.
    """
    if lag == 0:
        return recording
    count, missing = len(recording), abs(lag)
    if missing >= count:
        raise SettingError(
            f"{recording.path}: a lag of {counted(lag, 'frame')} leaves none of its {counted(count, 'frame')}; "
            f"give a smaller lag"
        )
    frames = np.arange(max(0, -lag), count - max(0, lag))
    end = "end" if lag > 0 else "beginning"
    note = f"exposures are corrected for a lag of {counted(lag, 'frame')}, leaving out {missing} at the {end}"
    return DerivedRecording.of(recording, frames, recording.exposures_ms[frames + lag], note=note)


def innermost(recording: Recording, index: int) -> tuple[Recording, int]:
    """Return the recording that a derived one is made from in the end, and the index of a frame in it."""
    if isinstance(recording, DerivedRecording):
        return innermost(recording.inner, int(recording.frames[index]))
    return recording, index
