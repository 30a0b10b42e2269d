"""A real hand-held video with a true exposure for each frame, as a case: part for fitting, part for judging."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from ospc.benchmark.case import Group, OnProgress, Row
from ospc.benchmark.flat_matches import SampledFrame, flat_pair
from ospc.benchmark.held_out import HeldOutPair, predicted_ratio
from ospc.benchmark.running import run_preset
from ospc.benchmark.scoring import score, with_figures
from ospc.formats.dso import read_pcalib
from ospc.photometry.calibration import Calibration
from ospc.photometry.response import Response
from ospc.recording import open_recording
from ospc.recording.frame import Frame
from ospc.recording.identity import identity

FOLDER = "borealhdr_left"
_FITTED_FRAMES = 40
_FARTHEST = 3
_FEWEST_PLACES = 50
_FACTOR = 8.0
_LABORATORY_GREYS = (5, 215)
"""Where the makers' response is valid; it bends wrongly above."""
_MAX_RADIAL_DISPLACEMENT = 0.01
"""The vignette of this camera cannot be known from this video; pairs that show it would judge the motion."""


@dataclass(frozen=True)
class VideoCase:
    """The video: fitted to its first frames, judged by pairs of the others.

    Attributes
    ----------
    path
        Its folder, in the layout of the TUM monocular dataset with the makers' ``pcalib.txt``.
    """

    path: Path

    @property
    def name(self) -> str:
        """Name of the folder."""
        return self.path.name

    @property
    def group(self) -> Group:
        """``video``."""
        return "video"

    @property
    def factors(self) -> dict[str, str]:
        """Nothing varies."""
        return {}

    def describe(self) -> dict[str, Any]:
        """Return what identifies the recording, and how it is split."""
        return {"kind": "video", **identity(open_recording(self.path)), "fitted": _FITTED_FRAMES}

    def rows(self, preset: str, progress: OnProgress) -> list[Row]:
        """Run every method of a preset; with "default" comes a row of the makers' own laboratory calibration."""
        recording = open_recording(self.path)
        laboratory = read_pcalib(self.path / "pcalib.txt")
        found = run_preset(preset, islice(recording, _FITTED_FRAMES), _FITTED_FRAMES, progress, solvers=None)
        pairs = held_out_pairs(list(islice(recording, _FITTED_FRAMES, None)))
        rows = [
            self._judged(method, outcome, laboratory, pairs)
            if isinstance(outcome, Calibration)
            else Row(method, failure=outcome)
            for method, outcome in found.items()
        ]
        if preset == "default":
            makers = Calibration(size=recording.size, response=laboratory)
            row = self._judged("makers' laboratory", makers, laboratory, pairs)
            rows.append(replace(row, figures=replace(row.figures, response_shape_rmse=None)))
        return rows

    def _judged(self, method: str, found: Calibration, truth: Response, pairs: list[HeldOutPair]) -> Row:
        row = score(method, found, truth, None, pairs=pairs, greys=_LABORATORY_GREYS)
        if found.response is None:
            return row
        eightfold = [p for p in pairs if abs(abs(np.log(p.exposure_ratio)) - np.log(_FACTOR)) < 0.05]
        errors = [
            abs(predicted_ratio(p, found.response, found.vignette) / p.exposure_ratio - 1) * 100 for p in eightfold
        ]
        return with_figures(row, factor_error_percent=float(np.median(errors))) if errors else row


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


def video_cases(data: Path | None) -> tuple[list[VideoCase], str]:
    """Return the video of the folder of real data, or a note on why there is none."""
    if data is None:
        return [], "--data is not given: no real video"
    place = data / FOLDER
    if not place.is_dir():
        return [], f"{place} is not there: no real video"
    return [VideoCase(place)], ""
