"""The decoupled method, tested with synthetic correspondences of known truth."""

from __future__ import annotations

import numpy as np
import pytest

from ospc.errors import NotObservableError
from ospc.evaluation.metrics import response_rmse, vignette_rmse
from ospc.methods.paper import Correspondences
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette
from ospc.recording.frame import Frame
from ospc.research.rivals.kim_pollefeys import KimPollefeys, estimate_decoupled
from ospc.simulation.responses import srgb

SIZE = (640, 480)
VIGNETTE = PolynomialVignette(SIZE, (-0.35, 0.05, -0.15))
RATIOS = (1.5, 0.7, 1.2, 2.0, 0.6)


def pairs(response: Response, ratios=RATIOS, noise: float = 0.004) -> list[Correspondences]:
    random = np.random.default_rng(5)
    found = []
    for number, ratio in enumerate(ratios):
        points0, points1 = random.uniform(0, SIZE, (2, 12_000, 2))
        points1[:4000] = np.clip(points0[:4000] + random.normal(size=(4000, 2)), 0, np.array(SIZE) - 1)
        radiance = np.exp(random.uniform(np.log(0.01), np.log(0.8), 12_000)) / np.sqrt(ratio)
        grey = [
            response(np.minimum(radiance * e * VIGNETTE.at(p), 1)) + noise * random.normal(size=12_000)
            for e, p in ((ratio, points0), (1.0, points1))
        ]
        found.append(Correspondences((number, number + 1), SIZE, points0, points1, *np.clip(grey, 0, 1)))
    return found


@pytest.mark.parametrize("response", [srgb(), Response.gamma(1.6)])
def test_all_is_found_with_one_known_exposure(response):
    data = pairs(response)
    found, log_ratios = estimate_decoupled(data, np.log(RATIOS))
    assert response_rmse(found.response, response) < 0.04
    assert vignette_rmse(found.vignette, VIGNETTE) < 0.02
    np.testing.assert_allclose(log_ratios, np.log(RATIOS), atol=0.05)


def test_a_wrong_assumption_is_an_exponent_of_everything():
    data = pairs(srgb())
    right, right_ratios = estimate_decoupled(data, np.log(RATIOS))
    wrong, wrong_ratios = estimate_decoupled(data, 1.2 * np.log(RATIOS))
    slope = np.polyfit(right_ratios, wrong_ratios, 1)[0]
    assert slope == pytest.approx(1.2, abs=0.05)
    greys = np.linspace(0.2, 0.9, 30)
    exponent = np.polyfit(np.log(right.response.inverse(greys)), np.log(wrong.response.inverse(greys)), 1)[0]
    assert exponent == pytest.approx(1.2, abs=0.1)
    corner = np.log([v.profile(0.9) for v in (right.vignette, wrong.vignette)])
    assert corner[1] / corner[0] == pytest.approx(1.2, abs=0.1)


def test_without_a_known_exposure_one_is_assumed():
    _, log_ratios = estimate_decoupled(pairs(srgb()))
    assert np.max(np.abs(log_ratios)) == pytest.approx(np.log(1.5), abs=1e-6)


def test_what_cannot_be_known_is_refused():
    with pytest.raises(NotObservableError, match="no pair"):
        estimate_decoupled(pairs(srgb(), ratios=(1.0, 1.0)), (0.0, 0.0))
    few = [p.select(np.arange(len(p)) < 50) for p in pairs(srgb())]
    with pytest.raises(NotObservableError):
        estimate_decoupled(few)
    still = [p.select(p.radial_displacement < 0.001) for p in pairs(srgb())]
    with pytest.raises(NotObservableError):
        estimate_decoupled(still)
    blank = Frame.of_array(np.zeros((48, 64), np.uint8), 1.0)
    for count in (1, 20):
        method = KimPollefeys()
        for _ in range(count):
            method.push(blank)
        found = method.found()
        assert set(found) == {"kim-pollefeys-known", "kim-pollefeys-assumed"}
        assert all("no pair" in reason for reason in found.values())
