"""What a study compares: methods that take frames and give estimates, and how they are run over a recording."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from time import process_time
from typing import Protocol, TypeAlias

from ospc.errors import OspcError
from ospc.photometry.calibration import Calibration
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette
from ospc.recording.frame import Frame
from ospc.research.runner import OnProgress


@dataclass(frozen=True)
class Estimate:
    """What a method found; None for what it did not.

    Attributes
    ----------
    response, vignette
        The curves.
    calibration
        The whole calibration, with uncertainties and verdicts, of methods of this project.
    exposures
        The exposures by the index of the frame, up to a factor, of methods that estimate them.
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
"""An estimate, or the reason why there is none."""


class Method(Protocol):
    """One method on one recording. It may have several variants, which share work."""

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        ...

    def found(self) -> dict[str, Outcome]:
        """Return the outcome of every variant by its name."""
        ...


@dataclass(frozen=True)
class Result:
    """The outcome of a variant, and the processor time that its method took."""

    variant: str
    outcome: Outcome
    seconds: float | None = None


def run_methods(
    methods: dict[str, Method], frames: Iterable[Frame], count: int, progress: OnProgress
) -> list[Result]:
    """Run new methods over a recording of ``count`` frames in one pass; report the progress after each frame.

    Errors of a method are outcomes. Where it breaks down, its name stands for all of its variants.
    """
    seconds = dict.fromkeys(methods, 0.0)
    broken: dict[str, str] = {}
    for done, frame in enumerate(frames, start=1):
        for name in methods.keys() - broken.keys():
            began = process_time()
            try:
                methods[name].push(frame)
            except Exception as error:  # a method that breaks down has lost this recording, not the others
                broken[name] = failure(error)
            seconds[name] += process_time() - began
        progress(min(done / count, 1.0))
    results: list[Result] = []
    for name, method in methods.items():
        began = process_time()
        try:
            outcomes: dict[str, Outcome] = {name: broken[name]} if name in broken else method.found()
        except Exception as error:
            outcomes = {name: failure(error)}
        seconds[name] += process_time() - began
        results += [Result(variant, outcome, seconds[name]) for variant, outcome in outcomes.items()]
    return results


def failure(error: Exception) -> str:
    """Return an error as an outcome; errors the library does not raise on purpose are named."""
    return str(error) if isinstance(error, OspcError) else f"{type(error).__name__}: {error}"
