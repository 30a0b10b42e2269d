"""The black level that a fitted response shows."""

from __future__ import annotations

import numpy as np
import pytest

from ospc.estimation.black_level import black_level
from ospc.estimation.fit_plan import FitPlan
from ospc.estimation.vignette_choice import fit_with_chosen_vignette
from ospc.photometry.grey_range import GreyRange
from ospc.photometry.response import Response
from ospc.pooling.summary import RESPONSE, VIGNETTE
from ospc.settings.response import BLACK_LEVEL_ACCURACY, MIN_BLACK_LEVEL
from ospc.simulation.responses import filmic, logarithmic, srgb
from synthetic_observations import Camera


def lifted(pedestal: float, gamma: float) -> Response:
    """Return a response that is black at a pedestal."""
    grey = np.linspace(0, 1, 4097)
    above = np.clip((grey - pedestal) / (1 - pedestal), 0, 1) ** gamma
    return Response.from_values(np.maximum(above, 1e-9 * grey))


def found_black_level(response: Response, seed: int) -> float:
    """Return the black level that is found in as many steps as it takes."""
    observations, found, least = Camera(response).pairs(seed, groups=60, points=150), GreyRange(), MIN_BLACK_LEVEL
    while True:
        stretched = observations.stretched(found)
        fit = fit_with_chosen_vignette(stretched, FitPlan(RESPONSE, VIGNETTE, None, rounds=8)).fit
        black = black_level(fit, stretched, least)
        if black == 0:
            return found.black
        found, least = found.with_black_at(black), BLACK_LEVEL_ACCURACY


@pytest.mark.parametrize("pedestal", [0.03, 0.0625, 0.1])
@pytest.mark.parametrize("gamma", [1.0, 2.2])
def test_a_pedestal_is_found(pedestal: float, gamma: float) -> None:
    assert found_black_level(lifted(pedestal, gamma), 0) == pytest.approx(pedestal, abs=0.004 * gamma)


def s_shaped(strength: float) -> Response:
    """Return a response whose slope is one minus the strength at black and at white."""
    grey = np.linspace(0, 1, 4097)
    return Response.from_values(grey - strength * np.sin(2 * np.pi * grey) / (2 * np.pi))


USUAL = [Response.gamma(1.0), Response.gamma(2.2), srgb(), logarithmic(), filmic()]


@pytest.mark.parametrize("response", [*USUAL, s_shaped(0.9), s_shaped(0.97)])
def test_usual_responses_are_black_at_zero(response: Response) -> None:
    assert found_black_level(response, 1) == 0
