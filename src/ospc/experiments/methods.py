"""Methods under comparison: each takes frames and, at the end, gives one calibration or several variants of it."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import process_time
from typing import Protocol

import numpy as np

from ospc.arrays import FloatArray, ImageSize, IntArray
from ospc.baselines.joint import OnlineJoint
from ospc.baselines.kim_pollefeys import calibrate_decoupled
from ospc.benchmark.running import SharedMatcher
from ospc.calibrator import OnlineCalibrator
from ospc.correspondence.features import Features
from ospc.errors import NotObservableError, OspcError
from ospc.exposures.lookup import StatedExposures
from ospc.formats.opening import Photometry
from ospc.methods.paper import FeatureMatcher, PaperMethod, solve_vignette, vignette_rows
from ospc.photometry.calibration import ExposureRatios
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette
from ospc.recording import Frame
from ospc.settings import PaperSettings

_MATCHING = (
    "features",
    "max_features",
    "match_ratio",
    "filter_blocks",
    "filter_bins",
    "filter_min_matches",
    "filter_length_sigmas",
)
"""Settings that finding and matching of features depend on."""


class SolversKnowingResponse:
    """The paper's vignette alone, from the true response, by each of its solvers.

    Parameters
    ----------
    response
        The true response.
    settings
        What pairs are matched, and how.
    solvers
        Names of solvers.
    """

    def __init__(self, response: Response, settings: PaperSettings, solvers: Sequence[str]) -> None:
        self._response, self._settings, self._solvers = response, settings, solvers
        self._matcher = FeatureMatcher(settings)
        self._recent: deque[Features] = deque()
        self._rows: list[FloatArray] = []
        self._targets: list[FloatArray] = []
        self._size: ImageSize = (0, 0)

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        self._size = (frame.image.shape[1], frame.image.shape[0])
        features = self._matcher.features(frame)
        self._recent.append(features)
        if len(self._recent) <= self._settings.vignette_offset:
            return
        earlier = self._recent.popleft()
        found = self._matcher.correspondences(earlier, features, self._size)
        exposed = (np.minimum(found.grey0, found.grey1) > 0) & (np.maximum(found.grey0, found.grey1) < 1)
        moving = found.radial_displacement >= self._settings.vignette_min_radial_displacement
        ratio = earlier.exposure_ms / features.exposure_ms
        rows, targets = vignette_rows(found.select(exposed & moving), ratio, self._response)
        self._rows.append(rows)
        self._targets.append(targets)

    def found(self) -> dict[str, Photometry | str]:
        """Return a vignette by each solver."""
        count = sum(map(len, self._targets))
        if count < self._settings.min_samples:
            return {f"true g/{name}": f"only {count} points move along the radius" for name in self._solvers}
        rows, targets = np.concatenate(self._rows), np.concatenate(self._targets)
        results: dict[str, Photometry | str] = {}
        for name in self._solvers:
            coefficients = tuple(solve_vignette(rows, targets, name, self._settings.huber_tuning).tolist())
            label = f"true g/{name}"
            results[label] = Photometry(label, self._response, PolynomialVignette(self._size, coefficients))
        return results


@dataclass(frozen=True)
class Exposures:
    """Exposures that a method estimated, up to a factor.

    Attributes
    ----------
    frames
        Indices of the frames, shape (n,).
    values
        Positive, shape (n,).
    """

    frames: IntArray
    values: FloatArray


class Rival(Protocol):
    """One method over one recording."""

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        ...

    def found(self) -> dict[str, Photometry | str]:
        """Return calibrations by name, or why there is none."""
        ...


class Ours:
    """The method of this project."""

    def __init__(self) -> None:
        self._calibrator = OnlineCalibrator()

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        self._calibrator.push(frame)

    def found(self) -> dict[str, Photometry | str]:
        """Return the calibration."""
        known = self._calibrator.calibration()
        return {"ours": Photometry("ours", known.response, known.vignette, known)}


class Paper:
    """The paper's method in variants that look at the same frames; those that can share match features once.

    Parameters
    ----------
    variants
        Settings by name.
    """

    def __init__(self, variants: dict[str, PaperSettings]) -> None:
        self._variants = variants
        self._methods: dict[str, PaperMethod] = {}
        self._exposures = StatedExposures()
        self.ratios: dict[str, ExposureRatios] = {}

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        if not self._methods:
            shared: dict[tuple[object, ...], SharedMatcher] = {}
            size = (frame.image.shape[1], frame.image.shape[0])
            for name, settings in self._variants.items():
                alike = tuple(getattr(settings, setting) for setting in _MATCHING)
                matcher = shared.setdefault(alike, SharedMatcher(FeatureMatcher(settings)))
                self._methods[name] = PaperMethod(settings, size, frame.max_grey, matcher)
        self._exposures.add(frame.index, frame.exposure_ms)
        for method in self._methods.values():
            method.push(frame, self._exposures)

    def found(self) -> dict[str, Photometry | str]:
        """Return the calibrations."""
        results: dict[str, Photometry | str] = {}
        for name, method in self._methods.items():
            known = method.calibration(self._exposures)
            self.ratios[name] = known.exposure_ratios
            results[name] = Photometry(name, known.response, known.vignette, known)
        return results


class Joint:
    """Joint estimation, with one point of the true response and without.

    Parameters
    ----------
    truth
        The true response, of which one point is used.
    online
        Whether it is the online variant.
    """

    def __init__(self, truth: Response | None, *, online: bool) -> None:
        self._truth = truth
        self._name = "joint-online" if online else "joint-batch"
        self.exposures: dict[str, Exposures] = {}
        self._method = OnlineJoint(200 if online else None)

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        self._method.push(frame)

    def found(self) -> dict[str, Photometry | str]:
        """Return the calibration with the known point and without."""
        free = self._method.estimate()
        variants = {f"{self._name}-wogt": free}
        if self._truth is not None:
            variants = {f"{self._name}-wgt": free.aligned_to(self._truth), **variants}
        self.exposures = {name: Exposures(one.frames, one.exposures) for name, one in variants.items()}
        return {name: Photometry(name, one.response, one.vignette) for name, one in variants.items()}


class Decoupled:
    """Kim and Pollefeys, with one exposure ratio known and with one assumed."""

    EVERY, OFFSET = 5, 2

    def __init__(self) -> None:
        self._frames: list[Frame] = []
        self._seen = 0

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        if self._seen % self.EVERY == 0:
            image = frame.image
            self._frames.append(replace(frame, load=lambda: image))
        self._seen += 1

    def found(self) -> dict[str, Photometry | str]:
        """Return both calibrations."""
        results: dict[str, Photometry | str] = {}
        for name, known in (("kim-pollefeys-known", True), ("kim-pollefeys-assumed", False)):
            try:
                found = calibrate_decoupled(self._frames, offset=self.OFFSET, every=1, exposures_known=known)
                results[name] = Photometry(name, found.response, found.vignette)
            except NotObservableError as error:
                results[name] = str(error)
        return results


class Timed:
    """A method whose processor time is taken; its errors are results."""

    def __init__(self, label: str, rival: Rival) -> None:
        self.label = label
        self.rival = rival
        self.seconds = 0.0
        self._failure = ""

    def push(self, frame: Frame) -> None:
        """Take the next frame, unless it has broken down."""
        if self._failure:
            return
        began = process_time()
        try:
            self.rival.push(frame)
        except OspcError as error:
            self._failure = str(error)
        self.seconds += process_time() - began

    @property
    def exposures(self) -> dict[str, Exposures]:
        """Exposures by variant, of methods that estimate them; to be asked for after :meth:`found`."""
        return self.rival.exposures if isinstance(self.rival, Joint) else {}

    def found(self) -> dict[str, Photometry | str]:
        """Return what it found, or under its label why it found nothing."""
        if self._failure:
            return {self.label: self._failure}
        began = process_time()
        try:
            return self.rival.found()
        except OspcError as error:
            return {self.label: str(error)}
        finally:
            self.seconds += process_time() - began
