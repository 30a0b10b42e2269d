"""Outcomes are determined by the reported messages and the errors."""

from __future__ import annotations

import numpy as np
import pytest

from ospc.photometry.calibration import Calibration
from ospc.photometry.response import Response
from ospc.photometry.verdict import Verdict
from ospc.research.accuracy.design import select
from ospc.research.faults import judging
from ospc.research.faults.footage import Fault, good_footage, good_sources
from ospc.research.faults.judging import FAULTS, Run, calibrated, fault_task, judged, outcome_of, step_sigma
from ospc.research.faults.study import fault_tables, fault_tasks

GOOD = {"response": "identifiable", "vignette": "identifiable", "exposures": "identifiable"}
SMALL = {"kappa": 0.002, "step": 0.01, "step_sigma": 0.005, "vignette": 0.003, "vignette_sigmas": 1.0}


@pytest.mark.parametrize(
    ("states", "figures", "told", "outcome"),
    [
        ({}, {}, {}, "harmless"),
        ({}, {}, {"corrected": True}, "corrected"),
        ({}, {}, {"warned": True}, "detected"),
        ({"vignette": "not identifiable"}, {}, {}, "detected"),
        ({}, {"kappa": 0.006}, {}, "confident and wrong"),
        ({}, {"vignette": 0.006}, {}, "confident and wrong"),
        ({}, {"step": -0.016}, {}, "confident and wrong"),
        ({}, {"vignette_sigmas": 3.1}, {}, "confident and wrong"),
        ({}, {"kappa": 0.006}, {"corrected": True}, "confident and wrong"),
        ({"response": "marginal"}, {"kappa": 0.006}, {}, "uncertain"),
        ({"response": "marginal"}, {"kappa": 0.006, "step": 0.1}, {}, "confident and wrong"),
        ({"vignette": "marginal"}, {"kappa": 0.006}, {}, "confident and wrong"),
        ({"vignette": "marginal"}, {"kappa": 0.006, "vignette": 0.006}, {}, "confident and wrong"),
        ({"vignette": "marginal"}, {"vignette": 0.02}, {"corrected": True}, "uncertain"),
        ({}, {"step_sigma": None}, {}, "confident and wrong"),
        ({}, {"vignette": None, "vignette_sigmas": None}, {}, "harmless"),
    ],
)
def test_outcomes(states, figures, told, outcome):
    assert outcome_of(GOOD | states, SMALL | figures, **({"warned": False, "corrected": False} | told)) == outcome


def calibration(footage, **changes) -> Calibration:
    matrix = np.diag([1e-6] * 3)
    known = {
        "size": footage.vignette.size,
        "response": footage.responses[0],
        "vignette": footage.vignette,
        "vignette_sigma": np.full(51, 0.001),
        "verdicts": {name: Verdict(state, "for a reason") for name, state in GOOD.items()},
        "covariance": {"response": {"parameters": ["gamma(0)", "gamma(0.5)", "gamma(1)"], "matrix": matrix.tolist()}},
    }
    return Calibration(**known | changes)


RUN = Run("room", "glare", "weak", 0.01, "harmless")


def test_the_truth_is_harmless(footage):
    run = judged(calibration(footage), footage, RUN)
    assert (run.outcome, run.kappa, run.step, run.vignette, run.vignette_sigmas) == ("harmless", 0, 0, 0, 0)


def test_skipped_frames_and_notes_are_corrections(footage):
    assert judged(calibration(footage, counts={"skipped": 1}), footage, RUN).outcome == "corrected"
    assert judged(calibration(footage, notes=("moved",)), footage, RUN).said == ("moved",)


def test_another_exponent_is_wrong(footage):
    run = judged(calibration(footage, response=Response.gamma(1.2)), footage, RUN)
    assert run.outcome == "confident and wrong"
    assert run.beyond == ("κ", "σ of g")
    truth = footage.responses[0].inverse([0.25, 0.75])
    assert run.step == pytest.approx(1.2 * np.log(3) - np.log(truth[1] / truth[0]), abs=1e-3)


def test_grey_levels_that_cannot_occur_are_not_judged(footage):
    (fault,) = select(FAULTS, "white-clipped", "fault")
    clipped = fault.put_on(footage, 100)
    assert max(int(image.max()) for image in clipped.images) <= 100
    table = footage.responses[0].inverse_table.copy()
    above = np.linspace(0, 255, len(table)) > 100
    table[above] = table[~above][-1] * np.linspace(1.0001, 1.001, np.count_nonzero(above))
    found = calibration(footage, response=Response.from_values(table))
    assert judged(found, clipped, RUN).kappa < 1e-4
    assert judged(found, footage, RUN).kappa > 1e-2


def test_an_estimated_truth_is_judged_with_its_own_uncertainty(footage):
    found = calibration(footage, response=footage.responses[0])
    filmed = type(footage)(**vars(footage) | {"reference": found})
    exact, estimated = (judged(found, truth, RUN).step_sigma for truth in (footage, filmed))
    assert estimated == pytest.approx(np.sqrt(2) * exact)


@pytest.mark.parametrize("name", ["power", "power-up", "dimming"])
def test_a_power_of_the_exposures_is_indistinguishable(footage, name):
    (fault,) = (one for one in select(FAULTS, name, "fault") if one.name == name)
    faulty = fault.put_on(footage, fault.strengths[1])
    stated = faulty.as_stated()
    # Proof: radiance raised to the fault's power gives the same grey levels with the twin, in two different frames.
    (camera,), (twin,) = faulty.responses, stated.responses
    places, frames = np.array([[0.0, 0.0], [20.0, 11.0], [31.0, 20.0]]), [0, len(faulty) // 2]
    reaching = faulty.exposures_ms ** (1 / faulty.power)
    radiance = 0.4 / (reaching * faulty.vignette.at(places)[:, None]).max()
    for frame in frames:
        irradiance = radiance * faulty.vignette.at(places) * reaching[frame]
        of_twin = radiance**faulty.power * stated.vignette.at(places) * faulty.exposures_ms[frame]
        np.testing.assert_allclose(twin(of_twin), camera(irradiance), atol=2e-3)
    found = calibration(footage, response=twin, vignette=stated.vignette)
    assert judged(found, faulty, RUN).outcome == "indistinguishable"
    assert judged(found, footage, RUN).outcome == "confident and wrong"
    assert judged(calibration(footage, response=Response.gamma(1.2)), faulty, RUN).outcome == "confident and wrong"


def test_a_missing_part_is_detected_unless_its_truth_is_unknown(footage):
    verdicts = {name: Verdict("identifiable", "") for name in GOOD} | {"vignette": Verdict("not identifiable", "")}
    found = calibration(footage, vignette=None, vignette_sigma=None, verdicts=verdicts)
    assert judged(found, footage, RUN).outcome == "detected"
    unknown = type(footage)(**vars(footage) | {"vignette": None})
    assert judged(found, unknown, RUN).outcome == "harmless"


def test_the_stated_deviation_agrees_with_the_bands(monkeypatch):
    monkeypatch.setattr("ospc.research.faults.footage.SIZE", (160, 120))
    (source,), _ = good_sources(1, 45)
    found = calibrated(good_footage(source))
    assert found.response is not None
    assert found.response.log_sigma is not None
    low, high = np.interp([0.25, 0.75], found.response.levels, found.response.log_sigma)
    sigma = step_sigma(found)
    assert sigma is not None
    # The bands are relative to a grey level between these two.
    assert abs(high - low) <= sigma <= high + low


def test_errors_count_as_detected_and_crashes_as_crashed(tiny_source, monkeypatch):
    no_exposure = Fault("zero", "0 everywhere", (1, 2, 3), lambda f, _s: f.with_exposures(0 * f.exposures_ms))
    monkeypatch.setitem(judging.FAULTS, "zero", no_exposure)
    task = fault_task(tiny_source, no_exposure)
    assert task.compute(lambda _share: None)["outcome"] == "detected"
    monkeypatch.setattr(judging, "calibrate", lambda _frames: 1 / 0)
    found = task.compute(lambda _share: None)
    assert found["outcome"] == "crashed"
    assert "ZeroDivisionError" in found["said"][0]


def test_every_recording_is_run_without_a_fault_first(tiny_source):
    fault = Fault("zero", "0 everywhere {}", (1, 2, 3), lambda f, _s: f)
    tasks = fault_tasks([tiny_source], [fault])
    assert [task.name for task in tasks] == [
        "tiny (none)",
        *(f"tiny (zero {s})" for s in ("weak", "medium", "strong")),
    ]
    assert len({str(task.depends_on) for task in tasks}) == 4


def test_tables_count_outcomes_and_list_what_is_wrong():
    clean = Run("room", "none", "", None, "detected", said=("it flickers",), false_alarm=True)
    wrong = Run("room", "glare", "weak", 0.01, "confident and wrong", 0.1, 0.2, 0.01, 0.02, 4.0, GOOD)
    tables = {table.title: table.rows for table in fault_tables([clean, RUN, wrong])}
    assert tables["Outcomes"][1][:5] == ("with a fault", "2", "", "", "1")
    ((*_, kappa, step, vignette),) = tables["Faults of light, optics and scene"]
    assert (kappa, step, vignette) == ("0.1000", "+0.2000 ± 0.0100", "0.0200")
    assert tables["Confident and wrong, and crashed: every run"][0][:3] == ("glare", "weak", "room")
    assert tables["False alarms on clean recordings"] == (("room", "detected", "it flickers"),)


def test_faults_are_chosen_by_name_pattern_or_word():
    assert [fault.name for fault in select(FAULTS, "late", "fault")] == ["late"]
    assert [fault.name for fault in select(FAULTS, "late-*", "fault")] == ["late-by-a-part"]
    assert {"bilateral"} == {fault.name for fault in select(FAULTS, "ilat", "fault")}
