"""Fixtures of the methods' tests: one shared recording and a calibration run."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import pytest
from recorded_in_memory import Recorded, recorded

from ospc.calibrator import OnlineCalibrator
from ospc.photometry.calibration import Calibration
from ospc.photometry.response import Response
from ospc.recording import Frame
from ospc.settings import Settings


@pytest.fixture(scope="session")
def walk() -> Recorded:
    """A simulated handheld recording with auto exposure; its response is one of the paper's polynomials."""
    return recorded(frames=105, noise="low", response=Response.gamma(2.0, 2041))


@pytest.fixture(scope="session")
def calibrated() -> Callable[..., Calibration]:
    """Return a function that pushes frames, requires all to be usable, and returns the calibration."""

    def run(
        frames: Iterable[Frame], settings: Settings | str = "default", ask_after: tuple[int, ...] = ()
    ) -> Calibration:
        calibrator = OnlineCalibrator(settings)
        for number, frame in enumerate(frames, start=1):
            assert calibrator.push(frame)
            if number in ask_after:
                calibrator.calibration()
                assert calibrator.status.frames == number
        return calibrator.calibration()

    return run
