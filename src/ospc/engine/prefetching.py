"""Prefetching: the decoding thread also preprocesses frames while the engine is busy with earlier ones."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ospc.arrays import Image, ImageSize
from ospc.correspondence.frame_sampling import FrameSampler
from ospc.correspondence.preprocessing import PreprocessedFrame, Preprocessor
from ospc.correspondence.thumbnail import Thumbnail
from ospc.exposures.brightness import BrightnessComparer
from ospc.exposures.brightness_history import Precomputed
from ospc.photometry.grey_range import FULL_RANGE, GreyRange
from ospc.recording.frame import Frame


@dataclass(frozen=True)
class _Prepared:
    """A frame, or only its thumbnail, preprocessed for a certain black and white."""

    image: Image
    grey_range: GreyRange
    frame: PreprocessedFrame | None
    thumbnail: Thumbnail
    compared: Precomputed | None


class Prefetcher:
    """Predicts which frames will be needed, and preprocesses them ahead of time.

    A prefetched frame is only used if computing it now would give the same, so results do not depend on
    prefetching.
    """

    def __init__(self, preprocess: Preprocessor, sampler: FrameSampler) -> None:
        self._preprocess = preprocess
        self._prepared: dict[int, _Prepared] = {}
        self._latest: Thumbnail | None = None
        self._expected = (False, replace(sampler), FULL_RANGE)
        self._size: ImageSize = (0, 0)
        self._compare = BrightnessComparer()

    def update(self, sampler: FrameSampler, size: ImageSize, grey_range: GreyRange, *, every: bool) -> None:
        """Predict with a copy of this sampler from now on, or predict that every frame of this size is needed.

        Frames are preprocessed for this black and white.
        """
        self._expected, self._size = (every, replace(sampler), grey_range), size

    def needs(self, number: int) -> bool:
        """Whether the image of the frame with this number will probably be needed; never waits for other threads."""
        every, sampler, _ = self._expected
        return every or sampler.at(number).compares_next

    def prepare(self, number: int, frame: Frame) -> None:
        """Prefetch a frame that will be pushed with this number.

        Only one thread at a time may call this; it never waits for others.
        """
        every, sampler, grey_range = self._expected
        if number < sampler.number:  # already pushed, because the engine does not wait for invalid exposures
            return
        shape = self._size[::-1]
        if frame.image.shape != shape or (frame.mask is not None and frame.mask.shape != shape):
            return
        numbered = replace(frame, index=number)
        needed = every or sampler.at(number).processes_next
        prepared = self._preprocess(numbered, grey_range) if needed else None
        thumbnail = self._preprocess.thumbnail(numbered, grey_range) if prepared is None else prepared.thumbnail
        previous, compared = self._latest, None
        if previous is not None and previous.frame == number - 1:
            compared = Precomputed(previous, thumbnail, self._compare(previous, thumbnail))
        self._prepared[number] = _Prepared(frame.image, grey_range, prepared, thumbnail, compared)
        self._latest = thumbnail

    def preprocessed(self, frame: Frame, grey_range: GreyRange) -> tuple[PreprocessedFrame, Precomputed | None]:
        """Return a preprocessed frame, and the change of brightness from the previous frame if it was prefetched."""
        made = self._of(frame, grey_range)
        if made is not None and made.frame:
            return made.frame, made.compared
        return self._preprocess(frame, grey_range), None

    def thumbnail(self, frame: Frame, grey_range: GreyRange) -> tuple[Thumbnail, Precomputed | None]:
        """Return the thumbnail of a frame, and the change of brightness if it was prefetched."""
        made = self._of(frame, grey_range)
        if made is not None:
            return made.thumbnail, made.compared
        return self._preprocess.thumbnail(frame, grey_range), None

    def _of(self, frame: Frame, grey_range: GreyRange) -> _Prepared | None:
        """Return the prefetched frame, unless it was preprocessed for another black and white."""
        made = self._prepared.get(frame.index)
        return made if made and made.image is frame.image and made.grey_range == grey_range else None

    def drop_until(self, number: int) -> None:
        """Drop prefetched frames up to this one."""
        for old in [known for known in tuple(self._prepared) if known <= number]:
            del self._prepared[old]
