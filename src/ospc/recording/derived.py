"""A recording that is another one, changed: what it does not change it passes on."""

from __future__ import annotations

from pathlib import Path

from ospc.arrays import ImageSize
from ospc.recording.recording import Recording


class DerivedRecording:
    """What a recording made of another has in common with it; frames, exposures and notes are its own.

    Attributes
    ----------
    inner
        The other recording.
    """

    inner: Recording

    @property
    def path(self) -> Path:
        """Where the inner recording was opened from."""
        return self.inner.path

    @property
    def kind(self) -> str:
        """Kind of the inner recording."""
        return self.inner.kind

    @property
    def size(self) -> ImageSize:
        """Width and height of its frames in pixels."""
        return self.inner.size

    @property
    def max_grey(self) -> int:
        """Largest grey value the sensor delivers."""
        return self.inner.max_grey
