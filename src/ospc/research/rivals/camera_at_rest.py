"""The rivals that need a camera at rest, as studies run them: they need all images at once, and find no vignette."""

from __future__ import annotations

from collections.abc import Callable

from ospc.photometry.response import Response
from ospc.recording.frame import Frame
from ospc.research.method import Estimate, Outcome
from ospc.research.rivals.debevec_malik import debevec_malik
from ospc.research.rivals.engel import engel_response
from ospc.research.rivals.exposure_series import ExposureSeries
from ospc.research.rivals.mitsunaga_nayar import mitsunaga_nayar
from ospc.research.rivals.robertson import robertson

METHODS: dict[str, Callable[[ExposureSeries], Response]] = {
    "debevec-malik": debevec_malik,
    "robertson": robertson,
    "mitsunaga-nayar": lambda series: mitsunaga_nayar(series).response,
    "engel": engel_response,
}


class CameraAtRest:
    """One of these methods.

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

    def found(self) -> dict[str, Outcome]:
        """Return the response."""
        return {self._name: Estimate(METHODS[self._name](ExposureSeries.of(self._frames)))}
