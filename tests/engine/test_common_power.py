"""Exposures on another scale after a change raise response and vignette to one power; other changes do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrations import calibration
from ospc.calibrator import OnlineCalibrator
from ospc.engine.verdicts import common_power, compared_with_epoch_before, judged
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.verdict import Verdict
from ospc.photometry.vignette import LogSplineVignette, RasterVignette
from ospc.recording import Frame
from ospc.simulation.responses import make_response

BEFORE = calibration(vignette_sigma=np.full(51, 0.003))


def raised(of_response: float, of_vignette: float) -> Calibration:
    """Return the calibration with response and vignette raised to a power each."""
    assert BEFORE.response is not None
    assert BEFORE.vignette is not None
    response = replace(BEFORE.response, inverse_table=BEFORE.response.inverse_table**of_response)
    return replace(BEFORE, response=response, vignette=RasterVignette(BEFORE.vignette.image() ** of_vignette))


@pytest.mark.parametrize("power", [0.5, 0.67, 0.8, 1.25, 2.0])
def test_one_power_of_both_is_found(power: float) -> None:
    assert common_power(BEFORE, raised(power, power)) == pytest.approx(power, rel=0.02)


def test_a_power_is_found_where_the_vignette_is_known() -> None:
    sigma = np.where(PROFILE_RADII > 0.7, 0.5, 0.003)
    lenses = {power: LogSplineVignette(BEFORE.size, (-0.4 * power, -0.4 * power), limit=0.7) for power in (1.0, 0.67)}
    before, after = (replace(raised(power, 1), vignette=lens, vignette_sigma=sigma) for power, lens in lenses.items())
    assert common_power(before, after) == pytest.approx(0.67, rel=0.02)


@pytest.mark.parametrize(("of_response", "of_vignette"), [(1, 1), (0.6, 1), (1, 0.6), (0.6, 1.4), (1.05, 1.05)])
def test_a_change_of_one_part_or_of_neither_is_no_common_power(of_response: float, of_vignette: float) -> None:
    assert common_power(BEFORE, raised(of_response, of_vignette)) is None


def test_another_camera_is_no_power_of_the_one_before() -> None:
    assert BEFORE.response is not None
    filmic = replace(BEFORE.response, inverse_table=make_response("filmic").inverse(BEFORE.response.levels))
    assert common_power(BEFORE, replace(raised(1, 1.4), response=filmic)) is None


@pytest.mark.parametrize("lacking", ["response", "vignette"])
def test_without_both_parts_nothing_is_compared(lacking: str) -> None:
    assert common_power(BEFORE, replace(raised(0.5, 0.5), **{lacking: None})) is None


def test_a_vignette_that_is_hardly_known_shows_no_power() -> None:
    unsure = replace(raised(0.8, 0.8), vignette_sigma=np.full(51, 0.1))
    assert common_power(BEFORE, unsure) is None


@pytest.mark.parametrize("power", [0.6, 1.0])
def test_the_verdicts_name_such_a_power_after_a_change(power: float) -> None:
    engine = OnlineCalibrator()
    engine.push(Frame.of_array(np.full(BEFORE.size[::-1], 90, np.uint8), 5.0))
    reliable = replace(engine.exposure_findings(), verdict=Verdict("identifiable", "they agree"), warnings=())
    after = raised(power, power)
    found = judged(after, compared_with_epoch_before(reliable, after, BEFORE), "", ())
    named = {name: "to the power of 0.60" in verdict.reason for name, verdict in found.verdicts.items()}
    assert set(named.values()) == {power != 1}
    states = {name: verdict.state for name, verdict in found.verdicts.items()}
    doubted = {"response": "marginal", "vignette": "marginal", "exposures": "not identifiable"}
    assert states == (doubted if power != 1 else dict.fromkeys(doubted, "identifiable"))
