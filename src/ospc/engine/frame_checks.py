"""Checks that a frame can be used: its image, exposure and mask must be consistent with the first frame."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ospc.arrays import Image, ImageSize, size_of
from ospc.correspondence.pixel_statistics import PixelReport
from ospc.errors import FrameError, counted
from ospc.recording.frame import Frame, check_exposure, check_size
from ospc.settings.grey_values import MOST_CLIPPED_SHARE, USED_SHARE

FIRST_REASONS, LATEST_REASONS = 3, 20
"""How many of the first and of the latest reasons for skipping a frame are kept."""


@dataclass(frozen=True)
class SkippedFrames:
    """The number of frames that could not be used, and why the first and the latest of them were skipped."""

    count: int = 0
    first: tuple[str, ...] = ()
    latest: tuple[str, ...] = ()

    def with_another(self, reason: str) -> SkippedFrames:
        """Return these and one more frame."""
        first, latest = (*self.first, reason)[:FIRST_REASONS], (*self.latest, reason)[-LATEST_REASONS:]
        return SkippedFrames(self.count + 1, first, latest)

    def why_most_of(self, frames: int) -> str:
        """Return how many of the frames these are and the first reason, or "" unless these are most of them."""
        if 2 * self.count <= frames:
            return ""
        return ": ".join([f"{self.count} of {frames} frames could not be used", *self.first[:1]])


def check_is_frame(pushed: object, number: int) -> None:
    """Raise a FrameError if the pushed object is not a frame."""
    if not isinstance(pushed, Frame):
        raise FrameError(
            f"frame {number}: expected a Frame, not {type(pushed).__name__}; create one with "
            "Frame.of_array(image, exposure_ms)"
        )


def checked_frame(frame: Frame, number: int, size: ImageSize | None, max_grey: int) -> Frame:
    """Return a checked frame with its number in the run as index.

    If the frame can verify its file without decoding it, the image and its size are checked when it is loaded.

    Parameters
    ----------
    size, max_grey
        Those of the first frame; None and 0 for the first frame itself.

    Raises
    ------
    FrameError, ExposureError
        If the frame cannot be used.
    """
    if frame.colour and frame.image.ndim != 2:
        raise FrameError(f"{frame.name}: is in colour; open the recording with one of its channels")
    check_exposure(frame.exposure_ms, frame.name)
    if frame.verify is not None:
        frame.verify()
    expected = size_of(frame.image) if size is None else size
    checked = replace(frame, index=number, load=partial(image_of_size, frame, expected))
    if frame.verify is None:
        checked.load()
    if size is not None and frame.max_grey != max_grey:
        raise FrameError(
            f"{frame.name}: its largest grey value is {frame.max_grey}, but that of the first frame is "
            f"{max_grey}; calibrate each bit depth separately"
        )
    if frame.mask is not None and size_of(frame.mask) != expected:
        width, height = size_of(frame.mask)
        raise FrameError(
            f"{frame.name}: its mask has {width}×{height} pixels, but the frames have {expected[0]}×{expected[1]}; "
            "use a mask of the same size"
        )
    if frame.mask is not None and not frame.mask.any():
        raise FrameError(f"{frame.name}: its mask excludes every pixel; True marks pixels that may be used")
    return checked


def image_of_size(frame: Frame, size: ImageSize) -> Image:
    """Return a frame's image; FrameError if its size differs from the first."""
    check_size(size_of(frame.image), size, frame.name)
    return frame.image


def skipped_in_words(skipped: int, frames: int, reasons: Sequence[str]) -> str:
    """Return how many frames were skipped, and the first reasons."""
    return f"{skipped} of {counted(frames, 'frame')} skipped: {'; '.join(reasons)}" + "; …" * (skipped > len(reasons))


def why_greys_are_useless(pixels: PixelReport | None) -> str:
    """Return that nearly all pixels are clipped or most grey values are unused, and why; "" if they are not."""
    if pixels is None:
        return ""
    for clipped in clipped_in_words(pixels, MOST_CLIPPED_SHARE):
        return clipped
    if pixels.max_grey <= np.iinfo(np.uint8).max or pixels.highest_grey > USED_SHARE * pixels.max_grey:
        return ""
    return (
        f"no grey value is above {pixels.highest_grey} of {pixels.max_grey}: give the largest one that the sensor "
        "delivers (max_grey), or film with longer exposures"
    )


def clipped_in_words(pixels: PixelReport, most: float) -> Iterator[str]:
    """Yield that more than a share of all pixels are saturated or black, and what to do."""
    if pixels.saturated_share > most:
        yield f"{pixels.saturated_share:.0%} of all pixels are saturated; use shorter exposures or less light"
    black = pixels.black_share - pixels.surround_share
    if black > most:
        yield f"{black:.0%} of all pixels are black; use longer exposures or more light"
