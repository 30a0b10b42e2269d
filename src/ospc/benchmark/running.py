"""Runs the methods of a preset over the frames of a recording."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from ospc.arrays import ImageSize
from ospc.benchmark.case import OnProgress
from ospc.calibrator import OnlineCalibrator
from ospc.correspondence.features import Features
from ospc.exposures.lookup import StatedExposures
from ospc.methods.paper import Correspondences, FeatureMatcher, Matcher, PaperMethod
from ospc.photometry.calibration import Calibration
from ospc.recording.frame import Frame
from ospc.settings import PaperSettings, preset

VIGNETTE_SOLVERS = ("l2", "l1", "m-estimator")
"""The solvers the paper compares (paper, section 5)."""

Outcome = Calibration | str
"""What a method found, or the error that ended it."""


def run_preset(
    name: str,
    frames: Iterable[Frame],
    count: int,
    progress: OnProgress,
    *,
    solvers: Sequence[str] | None = VIGNETTE_SOLVERS,
) -> dict[str, Outcome]:
    """Calibrate with every method of a preset.

    Parameters
    ----------
    name
        "default", or "paper", which is run with each of several vignette solvers; features are matched once for all.
    frames
        The recording.
    count
        Number of its frames.
    progress
        Called after every frame.
    solvers
        Vignette solvers of "paper"; None for its own, where the vignette is not looked at.

    Returns
    -------
    dict of str to Outcome
        Keys "default"; or "paper/l2" and so on, "paper" without solvers.
    """
    settings = preset(name)
    frames = _reporting(frames, count, progress)
    if isinstance(settings, PaperSettings):
        variants = (
            {"paper": settings}
            if solvers is None
            else {f"paper/{solver}": replace(settings, vignette_solver=solver) for solver in solvers}
        )
        return _run_sharing(variants, frames)
    return {settings.name: _run_one(OnlineCalibrator(settings), frames)}


def _reporting(frames: Iterable[Frame], count: int, progress: OnProgress) -> Iterator[Frame]:
    for done, frame in enumerate(frames, start=1):
        yield frame
        progress(min(done / count, 1.0))


def _run_one(calibrator: OnlineCalibrator, frames: Iterable[Frame]) -> Outcome:
    try:
        for frame in frames:
            calibrator.push(frame)
        return calibrator.calibration()
    except Exception as error:  # a method that breaks down has lost this case, not the others
        return _failure(error)


def _run_sharing(variants: dict[str, PaperSettings], frames: Iterable[Frame]) -> dict[str, Outcome]:
    """Run variants of the paper's method that differ only in what comes after the matching."""
    shared = SharedMatcher(FeatureMatcher(next(iter(variants.values()))))
    methods: dict[str, PaperMethod] = {}
    found: dict[str, Outcome] = {}
    exposures = StatedExposures()
    for frame in frames:
        exposures.add(frame.index, frame.exposure_ms)
        size = (frame.image.shape[1], frame.image.shape[0])
        methods = methods or {
            name: PaperMethod(settings, size, frame.max_grey, shared) for name, settings in variants.items()
        }
        for name in methods.keys() - found.keys():
            try:
                methods[name].push(frame, exposures)
            except Exception as error:
                found[name] = _failure(error)
    for name in methods.keys() - found.keys():
        try:
            found[name] = methods[name].calibration(exposures)
        except Exception as error:
            found[name] = _failure(error)
    return {name: found[name] for name in methods}


def _failure(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"


class SharedMatcher:
    """Does the matching of several methods that look at the same frames in lock step, once.

    Parameters
    ----------
    matcher
        Does the work; what it found for the present frame is kept until the next frame comes.
    """

    def __init__(self, matcher: Matcher) -> None:
        self._matcher = matcher
        self._frame = -1
        self._features: Features | None = None
        self._pairs: dict[tuple[int, int], Correspondences] = {}

    def features(self, frame: Frame) -> Features:
        """Return the features of a frame."""
        if self._features is None or frame.index != self._frame:
            self._features, self._frame, self._pairs = self._matcher.features(frame), frame.index, {}
        return self._features

    def correspondences(self, left: Features, right: Features, size: ImageSize) -> Correspondences:
        """Return the matches of two frames."""
        key = (left.frame, right.frame)
        if key not in self._pairs:
            self._pairs[key] = self._matcher.correspondences(left, right, size)
        return self._pairs[key]
