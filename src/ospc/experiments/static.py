"""Methods for a camera that stands still, on simulated sweeps of the exposure."""

from __future__ import annotations

from collections.abc import Callable

from ospc.baselines.static_series import (
    ExposureSeries,
    debevec_malik,
    engel_response,
    mitsunaga_nayar,
    robertson,
)
from ospc.errors import NotObservableError
from ospc.experiments.methods import Ours, Timed
from ospc.experiments.sources import Source
from ospc.formats.opening import Photometry
from ospc.photometry.response import Response
from ospc.recording import Frame
from ospc.simulation import SimulationSettings
from ospc.simulation import frames as simulated_frames
from ospc.simulation.responses import make_response

RESPONSES = ("linear", "srgb", "gamma2.2", "log", "filmic", "tum_narrow")
_SEED = 4000

METHODS: dict[str, Callable[[ExposureSeries], Response]] = {
    "debevec-malik": debevec_malik,
    "robertson": robertson,
    "mitsunaga-nayar": lambda series: mitsunaga_nayar(series).response,
    "engel": engel_response,
}


def sweeps(count: int, frames: int, size: tuple[int, int]) -> list[Source]:
    """Return sweeps of the exposure by cameras with different responses that stand still."""
    found = []
    for number in range(count):
        settings = SimulationSettings(
            size=size,
            frames=frames,
            seed=_SEED + number,
            response=RESPONSES[number % len(RESPONSES)],
            motion="static",
            exposure="sweep",
            exposure_min_ms=1.0,
            exposure_max_ms=60.0,
        )
        truth = Photometry("truth", make_response(settings.response), None)
        found.append(_source(f"static-{settings.response}-{number}", settings, truth))
    return found


def _source(name: str, settings: SimulationSettings, truth: Photometry) -> Source:
    return Source(name, settings.frames, truth, lambda: simulated_frames(settings))


class StaticMethod:
    """One of the methods, which need all images at once.

    Parameters
    ----------
    name
        One of :data:`METHODS`.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._frames: list[Frame] = []

    def push(self, frame: Frame) -> None:
        """Take the next frame."""
        self._frames.append(frame)

    def found(self) -> dict[str, Photometry | str]:
        """Return the response."""
        try:
            series = ExposureSeries.of(self._frames)
            return {self._name: Photometry(self._name, METHODS[self._name](series), None)}
        except NotObservableError as error:
            return {self._name: str(error)}


def static_methods() -> list[Timed]:
    """Return all of them and this project's own."""
    return [Timed("ours", Ours()), *(Timed(name, StaticMethod(name)) for name in METHODS)]
