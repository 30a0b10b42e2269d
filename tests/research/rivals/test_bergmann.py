"""Joint estimation as published: online in a window, with and without one point of the truth."""

from __future__ import annotations

import numpy as np
import pytest

from ospc.research.rivals.bergmann import Bergmann
from ospc.simulation import SimulationSettings, frames, truth

SETTINGS = SimulationSettings(frames=40, size=(160, 120), seed=5, scene_seed=0)


@pytest.fixture(scope="module")
def recording():
    return list(frames(SETTINGS))


def test_the_online_variant_gives_estimates_as_it_goes(recording):
    online = Bergmann(None, online=True, window=20, every=5)
    given_at = []
    for frame in recording:
        online.push(frame)
        if frame.index > 24:
            given_at.append(online.estimate())
    assert len({id(e) for e in given_at}) == 4
    assert given_at[-1].frames.min() >= 18


def test_the_two_variants_differ_by_one_exponent(recording):
    response = truth(SETTINGS).response
    method = Bergmann(response, online=False)
    for frame in recording:
        method.push(frame)
    found = method.found()
    assert list(found) == ["joint-batch-wgt", "joint-batch-wogt"]
    aligned, free = found.values()
    assert aligned.response.inverse(0.5) == pytest.approx(response.inverse(0.5), abs=5e-3)
    log_e = np.log([list(one.exposures.values()) for one in (aligned, free)])
    exponent = np.polyfit(log_e[1], log_e[0], 1)[0]
    np.testing.assert_allclose(log_e[0], exponent * log_e[1], atol=1e-9)
    greys = np.linspace(0.3, 0.9, 7)
    np.testing.assert_allclose(aligned.response.inverse(greys), free.response.inverse(greys) ** exponent, atol=5e-3)
