"""Recordings with known ground truth, and the task of measuring methods on one of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from hashlib import sha256
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from ospc.errors import ExposureError, FormatError, escaped
from ospc.formats.dso import read_pcalib, read_vignette
from ospc.formats.opening import Photometry
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette
from ospc.recording import Frame, Recording, open_recording
from ospc.recording.recording import identity
from ospc.research.measurement import Measurement
from ospc.research.method import Estimate, Method, Outcome, run_methods
from ospc.research.runner import OnProgress, Task, made_with
from ospc.research.scoring import HeldOutPair, Truth, curves_of, score, simulated_pairs
from ospc.simulation import SimulationSettings
from ospc.simulation import frames as simulated_frames
from ospc.simulation import truth as simulated_truth
from ospc.simulation.responses import make_response, make_vignette

PCALIB, VIGNETTE = "pcalib.txt", "vignette.png"

SWEEP = SimulationSettings(motion="static", exposure="sweep", exposure_min_ms=1.0, exposure_max_ms=60.0)
"""An exposure sweep with a static camera: 1 to 60 ms expose every surface of the room at some time."""


@dataclass(frozen=True)
class Source(ABC):
    """A recording with known truth. Its name is unique among those measured together.

    Results are summarised by ``group``; ``factors`` holds the level of each factor that varies within the group.
    """

    name: str
    group: str = field(default="", kw_only=True)
    factors: dict[str, str] = field(default_factory=dict, kw_only=True)

    @property
    @abstractmethod
    def count(self) -> int:
        """Number of frames."""

    @abstractmethod
    def describe(self) -> dict[str, Any]:
        """Return what identifies the recording, as JSON-compatible values."""

    @abstractmethod
    def frames(self) -> Iterator[Frame]:
        """Iterate over the frames from the beginning."""

    @abstractmethod
    def truth(self) -> Truth:
        """Return what is known about the camera."""

    def exposures_ms(self) -> Mapping[int, float]:
        """Return the true exposure of every frame by its index."""
        return {frame.index: frame.exposure_ms for frame in self.frames()}

    def held_out(self) -> Sequence[HeldOutPair]:
        """Return frame pairs that no method sees, with known exposure ratios."""
        return ()


@dataclass(frozen=True)
class Methods(ABC):
    """A named set of methods to compare; their settings are part of this package's source."""

    name: str

    @abstractmethod
    def make(self, source: Source) -> dict[str, Method]:
        """Create the methods for a recording."""


def measuring_task(source: Source, methods: Methods) -> Task:
    """Return the task of measuring methods on a recording; the task is about the recording."""
    compared = [type(methods).__name__, methods.name]
    depends_on = {"recording": source.describe(), "methods": compared, "made_with": made_with()}
    return Task(f"{source.name} ({methods.name})", depends_on, partial(_run_and_judge, source, methods), source)


def _run_and_judge(source: Source, methods: Methods, progress: OnProgress) -> list[dict[str, Any]]:
    outcomes = run_methods(methods.make(source), source.frames(), source.count, progress)
    return [asdict(found) for found in judge(source, outcomes, source.held_out())]


def judge(source: Source, outcomes: Mapping[str, Outcome], held_out: Sequence[HeldOutPair] = ()) -> list[Measurement]:
    """Compare outcomes, by the name of their method, with the truth of a recording."""
    truth = source.truth()
    if any(isinstance(outcome, Estimate) and outcome.exposures is not None for outcome in outcomes.values()):
        truth = replace(truth, exposures_ms=source.exposures_ms())
    return [judge_one(source, method, outcome, truth, held_out) for method, outcome in outcomes.items()]


def judge_one(
    source: Source, method: str, outcome: Outcome, truth: Truth, held_out: Sequence[HeldOutPair] = ()
) -> Measurement:
    """Compare the outcome of a method on a recording with the truth."""
    row = Measurement(source.name, method, group=source.group, factors=source.factors, limits=truth.limits)
    if isinstance(outcome, str):
        return replace(row, failure=outcome)
    try:
        row = replace(row, figures=score(outcome, truth, held_out), curves=curves_of(outcome))
    except ExposureError as error:
        return replace(row, failure=str(error))
    if outcome.calibration is None:
        return row
    verdicts, ratios = outcome.calibration.verdicts, vars(outcome.calibration.exposure_ratios)
    return replace(
        row,
        states={name: verdict.state for name, verdict in verdicts.items()},
        reasons={name: verdict.reason for name, verdict in verdicts.items()},
        ratios={name: values.tolist() for name, values in ratios.items() if values is not None},
    )


def loaded(stored: Sequence[dict[str, Any]]) -> list[Measurement]:
    """Return the measurements from the stored result of a :func:`measuring_task`."""
    return [Measurement(**content) for content in stored]


@dataclass(frozen=True)
class SimulatedSource(Source):
    """A simulated recording; with ``with_pairs``, exposure ratios of another scene are predicted."""

    settings: SimulationSettings
    with_pairs: bool = False

    group: str = field(default="simulated", kw_only=True)

    @property
    def count(self) -> int:
        """Number of frames."""
        return self.settings.frames

    def describe(self) -> dict[str, Any]:
        """Return the settings and hashes of the true curves."""
        known = {"kind": type(self).__name__, **self.settings.as_dict(), "with_pairs": self.with_pairs}
        return known | fingerprints(self.truth())

    def frames(self) -> Iterator[Frame]:
        """Iterate over the frames."""
        return simulated_frames(self.settings)

    def truth(self) -> Truth:
        """Return response and vignette."""
        return Truth(make_response(self.settings.response), make_vignette(self.settings))

    def exposures_ms(self) -> Mapping[int, float]:
        """Return the simulated exposures, from which the metadata may differ."""
        return dict(enumerate(simulated_truth(self.settings).exposures_ms.tolist()))

    def held_out(self) -> Sequence[HeldOutPair]:
        """Return pairs of another scene."""
        return simulated_pairs(self.settings) if self.with_pairs else ()


@dataclass(frozen=True)
class GivenSource(Source):
    """A folder in the layout of the TUM monocular data set, whose pcalib.txt and vignette.png are the truth.

    At most ``most_frames`` frames are used; None for all.
    """

    path: Path
    most_frames: int | None = None

    group: str = field(default="given", kw_only=True)

    @classmethod
    def of(cls, path: Path, most_frames: int | None = None) -> GivenSource:
        """Return the source of a folder; opening it at once reveals mistakes before hours are spent."""
        true_curves(open_recording(path))
        return cls(escaped(path.resolve().name), path, most_frames)

    @property
    def count(self) -> int:
        """Number of frames used."""
        there = len(open_recording(self.path))
        return there if self.most_frames is None else min(there, self.most_frames)

    def describe(self) -> dict[str, Any]:
        """Return what identifies the frames and the truth."""
        return {**identity(open_recording(self.path)), "used": self.count, **fingerprints(self.truth())}

    def frames(self) -> Iterator[Frame]:
        """Iterate over the frames."""
        return islice(iter(open_recording(self.path)), self.most_frames)

    def truth(self) -> Truth:
        """Return the curves in the folder."""
        return Truth(*true_curves(open_recording(self.path)))


def true_curves(recording: Recording) -> tuple[Response, Vignette]:
    """Return the true response and vignette stored in a recording's folder."""
    files = [recording.path / PCALIB, recording.path / VIGNETTE]
    if not all(file.is_file() for file in files):
        raise FormatError(f"{recording.path}: lacks the ground truth; add {PCALIB} and {VIGNETTE}")
    return read_pcalib(files[0]), read_vignette(files[1])


def fingerprints(curves: Truth | Photometry) -> dict[str, str]:
    """Return hashes that identify the curves."""
    response, vignette = curves.response, curves.vignette
    tables = {
        "response_sha256": None if response is None else response.resampled(256),
        "vignette_sha256": None if vignette is None else vignette.image(),
    }
    return {n: sha256(np.ascontiguousarray(t).tobytes()).hexdigest() for n, t in tables.items() if t is not None}
