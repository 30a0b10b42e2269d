"""A recording whose exposures are moved to the frames they belong to."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from ospc.arrays import FloatArray
from ospc.errors import SettingError
from ospc.recording.derived import DerivedRecording
from ospc.recording.frame import Frame
from ospc.recording.image_sequence import ImageSequence
from ospc.recording.recording import Recording


class ShiftedRecording(DerivedRecording):
    """Frames of another recording, each with the exposure written beside a later or earlier one.

    Parameters
    ----------
    inner
        The recording.
    lag
        The exposure written beside frame i is the one that frame i − lag was taken with. Frames whose exposure is
        written nowhere, at one of the ends, are left out.
    """

    def __init__(self, inner: Recording, lag: int) -> None:
        count = len(inner)
        if abs(lag) >= count:
            raise SettingError(
                f"a lag of {lag} frames leaves nothing of the {count} frames of {inner.path}; give a smaller one"
            )
        self.inner = inner
        self._lag = lag
        self.frames = range(max(0, -lag), count - max(0, lag))
        first, last = self.frames[0], self.frames[-1]
        self._exposures_ms = inner.exposures_ms[first + lag : last + lag + 1]
        self._stamps_s = inner.stamps_s[first : last + 1]

    @property
    def exposures_ms(self) -> FloatArray:
        """Exposure of every frame in milliseconds times linear gain, shape (frames,)."""
        return self._exposures_ms

    @property
    def stamps_s(self) -> FloatArray:
        """Time stamp of every frame in seconds, shape (frames,)."""
        return self._stamps_s

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes of the inner recording, and the shift."""
        end = "last" if self._lag > 0 else "first"
        count = abs(self._lag)
        return (
            *self.inner.notes,
            f"exposures are corrected for a lag of {self._lag} frames; the {end} {count} frames are left out",
        )

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.frames)

    def __iter__(self) -> Iterator[Frame]:
        """Give the frames one by one, counted anew from 0."""
        for frame in self.inner:
            if frame.index in self.frames:
                index = frame.index - self.frames[0]
                yield replace(frame, index=index, exposure_ms=float(self._exposures_ms[index]))


def with_exposure_lag(recording: Recording, lag: int) -> Recording:
    """Return a recording with exposures moved to the frames they belong to.

    Parameters
    ----------
    recording
        The recording.
    lag
        By how many frames its metadata come late, as :class:`~ospc.diagnosis.lag.LagEstimate` gives it.

    Returns
    -------
    Recording
        Shorter by as many frames as the lag has; the recording itself where the lag is 0.

    Raises
    ------
    SettingError
        If the lag leaves no frames.
    """
    if lag == 0:
        return recording
    shifted = ShiftedRecording(recording, lag)
    if not isinstance(recording, ImageSequence):
        return shifted
    # A sequence stays one, so that its files can still be had as they are.
    kept = slice(shifted.frames.start, shifted.frames.stop)
    return replace(
        recording,
        names=recording.names[kept],
        exposures_ms=shifted.exposures_ms,
        stamps_s=shifted.stamps_s,
        notes=shifted.notes,
    )
