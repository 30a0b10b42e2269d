"""The methods that studies compare: they take frames and return estimates. Includes this project's methods."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from typing import Protocol, TypeAlias, TypeVar

import numpy as np

from ospc.arrays import FloatArray, ImageSize, size_of
from ospc.calibrator import OnlineCalibrator
from ospc.correspondence.features import Features
from ospc.errors import one_line
from ospc.exposures.table import ExposureTable
from ospc.methods.paper import Correspondences, FeatureMatcher, Matcher, PaperMethod, solve_vignette, vignette_rows
from ospc.photometry.calibration import Calibration
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette, Vignette
from ospc.recording.frame import Frame
from ospc.research.runner import OnProgress
from ospc.settings import PaperSettings


@dataclass(frozen=True)
class Estimate:
    """The result of a method; None for what it did not find.

    Methods of this project also return a ``calibration`` with uncertainties and verdicts. Exposures are by frame
    index and known up to a factor.
    """

    response: Response | None = None
    vignette: Vignette | None = None
    calibration: Calibration | None = None
    exposures: Mapping[int, float] | None = None

    @classmethod
    def of(cls, calibration: Calibration) -> Estimate:
        """Return a calibration as an estimate."""
        return cls(calibration.response, calibration.vignette, calibration)


Outcome: TypeAlias = Estimate | str
"""An estimate or the reason why there is none."""

_Found = TypeVar("_Found")


class Method(Protocol):
    """One method on one recording. It may have several variants that share work."""

    def push(self, frame: Frame) -> None:
        """Take the next frame."""

    def found(self) -> dict[str, Outcome]:
        """Return the outcome of every variant by name."""


def run_methods(
    methods: dict[str, Method], frames: Iterable[Frame], count: int, progress: OnProgress
) -> dict[str, Outcome]:
    """Run new methods over a recording of ``count`` frames in one pass, and return the outcome of every variant.

    An exception in a method is its outcome; the method's name then stands for all of its variants. ``progress`` is
    called after each frame.
    """
    broken: dict[str, Outcome] = {}
    for done, frame in enumerate(frames, start=1):
        for name, method in methods.items():
            if name not in broken and (failure := _attempted(partial(method.push, frame))) is not None:
                broken[name] = failure
        progress(min(done / count, 1.0))
    outcomes: dict[str, Outcome] = {}
    for name, method in methods.items():
        found = broken[name] if name in broken else _attempted(method.found)
        outcomes |= found if isinstance(found, dict) else {name: found}
    return outcomes


def outcomes_of(variants: Mapping[str, Callable[[], Estimate]]) -> dict[str, Outcome]:
    """Return the outcome of every variant by name; the failure of one does not affect the others."""
    return {name: _attempted(estimate) for name, estimate in variants.items()}


def _attempted(step: Callable[[], _Found]) -> _Found | str:
    """Return the result of a step of a method, or the reason for its failure, which must not end the others."""
    try:
        return step()
    except Exception as error:
        return one_line(error)


VIGNETTE_SOLVERS = ("l2", "l1", "m-estimator")
"""The solvers that the paper compares (section 5)."""


class OwnMethod:
    """The method of this project with a preset; ``variant`` names the outcome, by default the preset's name."""

    def __init__(self, preset_name: str = "default", variant: str | None = None) -> None:
        self._variant = variant or preset_name
        self._calibrator = OnlineCalibrator(preset_name)

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        self._calibrator.push(frame)

    def found(self) -> dict[str, Outcome]:
        """Return the calibration."""
        return {self._variant: Estimate.of(self._calibrator.calibration())}


class PaperVariant:
    """The paper's method with some settings and the name of its outcome; make them with :func:`paper_variants`."""

    def __init__(self, name: str, settings: PaperSettings, matcher: Matcher) -> None:
        self._name, self._settings, self._matcher = name, settings, matcher
        self._method: PaperMethod | None = None
        self._exposures = ExposureTable()

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        if self._method is None:
            self._method = PaperMethod(self._settings, size_of(frame.image), frame.max_grey, self._matcher)
        self._exposures.append(frame.exposure_ms)
        self._method.push(frame, None, self._exposures)

    def found(self) -> dict[str, Outcome]:
        """Return the calibration."""
        return {} if self._method is None else {self._name: Estimate.of(self._method.calibration(self._exposures))}


def paper_variants(variants: Mapping[str, PaperSettings]) -> dict[str, Method]:
    """Return the paper's method with several settings, by name; those with the same features match them only once."""
    matchers = {settings.features: SharedMatcher(settings) for settings in variants.values()}
    return {name: PaperVariant(name, settings, matchers[settings.features]) for name, settings in variants.items()}


class SharedMatcher:
    """Caches features and matches until the next frame, for methods that process the same frames together."""

    def __init__(self, settings: PaperSettings) -> None:
        self._matcher = cache(partial(FeatureMatcher, settings))  # made by the methods: its failure is their outcome
        self._features: dict[int, Features] = {}
        self._pairs: dict[tuple[int, int], Correspondences] = {}

    def features(self, frame: Frame) -> Features:
        """Return the features of a frame."""
        if frame.index not in self._features:
            self._features, self._pairs = {frame.index: self._matcher().features(frame)}, {}
        return self._features[frame.index]

    def correspondences(self, left: Features, right: Features, size: ImageSize) -> Correspondences:
        """Return the matches between two frames."""
        key = (left.frame, right.frame)
        if key not in self._pairs:
            self._pairs[key] = self._matcher().correspondences(left, right, size)
        return self._pairs[key]


class SolversKnowingResponse:
    """The paper's vignette estimation alone, by each of its solvers, given the true response."""

    def __init__(self, response: Response, settings: PaperSettings) -> None:
        self._response, self._settings = response, settings
        self._matcher = FeatureMatcher(settings)
        self._recent: deque[tuple[Features, float]] = deque()
        self._equations: list[tuple[FloatArray, FloatArray]] = []
        self._size: ImageSize = (0, 0)

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        self._size = size_of(frame.image)
        features = self._matcher.features(frame)
        self._recent.append((features, frame.exposure_ms))
        if len(self._recent) <= self._settings.vignette_offset:
            return
        left, left_ms = self._recent.popleft()
        found = self._matcher.correspondences(left, features, self._size)
        exposed = (np.minimum(found.grey0, found.grey1) > 0) & (np.maximum(found.grey0, found.grey1) < 1)
        moving = found.radial_displacement >= self._settings.vignette_min_radial_displacement
        pairs = found.select(exposed & moving)
        self._equations.append(vignette_rows(pairs, left_ms / frame.exposure_ms, self._response))

    def found(self) -> dict[str, Outcome]:
        """Return the vignette of each solver."""
        count = sum(len(targets) for _, targets in self._equations)
        if count < self._settings.min_samples:
            return {f"true g/{name}": f"only {count} points move along the radius" for name in VIGNETTE_SOLVERS}
        rows, targets = (np.concatenate(parts) for parts in zip(*self._equations, strict=True))
        outcomes: dict[str, Outcome] = {}
        for name in VIGNETTE_SOLVERS:
            coefficients = tuple(solve_vignette(rows, targets, name, self._settings.huber_tuning).tolist())
            outcomes[f"true g/{name}"] = Estimate(self._response, PolynomialVignette(self._size, coefficients))
        return outcomes
