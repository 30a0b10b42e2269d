"""Simulated recordings as cases: everything is known of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ospc.benchmark.case import Group, OnProgress, Row
from ospc.benchmark.held_out import simulated_pairs
from ospc.benchmark.measured_responses import fingerprint
from ospc.benchmark.running import VIGNETTE_SOLVERS, run_preset
from ospc.benchmark.scoring import score
from ospc.photometry.calibration import Calibration
from ospc.photometry.response import Response
from ospc.simulation import SimulationSettings, frames
from ospc.simulation.responses import make_response
from ospc.simulation.vignettes import make_vignette


@dataclass(frozen=True)
class SimulatedCase:
    """A simulated recording.

    Attributes
    ----------
    name
        Its name.
    settings
        What is simulated.
    factors
        The level of each factor.
    """

    name: str
    settings: SimulationSettings
    factors: dict[str, str]

    @property
    def group(self) -> Group:
        """``static`` for a camera that stands still, ``simulated`` otherwise."""
        return "static" if self.settings.motion == "static" else "simulated"

    def describe(self) -> dict[str, Any]:
        """Return the settings, with a hash of a response that is given as a table."""
        described = {"kind": "simulation", **self.settings.as_dict()}
        if isinstance(self.settings.response, Response):
            described["response_sha256"] = fingerprint(self.settings.response)
        return described

    def rows(self, preset: str, progress: OnProgress) -> list[Row]:
        """Run every method of a preset and compare with the truth."""
        response, vignette = make_response(self.settings.response), make_vignette(self.settings)
        still = self.group == "static"
        solvers = None if still else VIGNETTE_SOLVERS
        found = run_preset(preset, frames(self.settings), self.settings.frames, progress, solvers=solvers)
        pairs = simulated_pairs(self.settings, still=still)
        return [
            score(method, outcome, response, vignette, pairs=pairs)
            if isinstance(outcome, Calibration)
            else Row(method, failure=outcome)
            for method, outcome in found.items()
        ]
