"""A real hand-held video with a true exposure for each frame: some frames for fitting, the others for judging."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import islice

import numpy as np

from ospc.formats.dso import read_pcalib
from ospc.recording import Frame, open_recording
from ospc.research.accuracy.flat_matches import SampledFrame, flat_pair
from ospc.research.held_out import HeldOut, HeldOutPair
from ospc.research.scoring import Truth
from ospc.research.source import PCALIB, GivenSource

FOLDER = "borealhdr_left"
"""Name of the recording in the folder of real data."""

_FITTED_FRAMES = 40
_FARTHEST = 3
"""Most frames between the two of a pair."""

_FEWEST_PLACES = 50
_FACTOR, _FACTOR_TOLERANCE = 8.0, 0.05
"""The exposure factor whose prediction is reported, and the largest difference of ln that counts as this factor."""

_LABORATORY_GREYS = (5, 215)
"""Where the makers' response is valid; above, it bends the wrong way."""

_MAX_RADIAL_DISPLACEMENT = 0.01
"""This video does not show the camera's vignette; pairs that depend on it would judge the motion."""


@dataclass(frozen=True)
class VideoSource(GivenSource):
    """The video with its makers' ``pcalib.txt``. Methods get its first frames; pairs of the others judge them."""

    most_frames: int | None = _FITTED_FRAMES
    group: str = field(default="video", kw_only=True)

    def truth(self) -> Truth:
        """Return the makers' own laboratory calibration."""
        return Truth(read_pcalib(self.path / PCALIB), greys=_LABORATORY_GREYS)

    def held_out(self) -> HeldOut:
        """Return pairs of the frames for judging; the factor is that of pairs that differ eightfold."""
        pairs = held_out_pairs(list(islice(open_recording(self.path), _FITTED_FRAMES, None)))
        eightfold = [p for p in pairs if abs(abs(np.log(p.exposure_ratio)) - np.log(_FACTOR)) < _FACTOR_TOLERANCE]
        return HeldOut(pairs, eightfold)


def held_out_pairs(frames: list[Frame]) -> list[HeldOutPair]:
    """Return the flat places of every two frames of different exposure that are at most three apart."""
    sampled = [SampledFrame.of(frame) for frame in frames]
    greys = (_LABORATORY_GREYS[0] / 255, _LABORATORY_GREYS[1] / 255)
    pairs = (
        flat_pair(first, second, greys, _MAX_RADIAL_DISPLACEMENT)
        for place, first in enumerate(sampled)
        for second in sampled[place + 1 : place + 1 + _FARTHEST]
        if first.exposure_ms != second.exposure_ms
    )
    return [pair for pair in pairs if pair is not None and len(pair.grey0) >= _FEWEST_PLACES]
