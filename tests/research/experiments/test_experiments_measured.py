"""Methods run in one pass over a recording, and every failure is a row of the table."""

from __future__ import annotations

import csv
import pickle
from dataclasses import dataclass, replace

import numpy as np
import pytest

from ospc.correspondence.features import SurfExtractor
from ospc.errors import FormatError, NotObservableError, RecordingError, SettingError
from ospc.exposures.table import ExposureTable
from ospc.methods.paper import PaperMethod
from ospc.photometry.response import Response
from ospc.recording.table_text import exposures_in
from ospc.research.experiments.ambiguity import ambiguity_report, measure_ambiguity
from ospc.research.experiments.design import EXPERIMENTS, OFFSETS, experiment_report, median_table
from ospc.research.experiments.sources import stand_ins, sweeps
from ospc.research.measurement import Measurement
from ospc.research.method import Estimate, SolversKnowingResponse, paper_variants, run_methods
from ospc.research.scoring import Truth
from ospc.research.source import SimulatedSource, judge, loaded, measuring_task
from ospc.settings import PaperSettings


class Fixed:
    def __init__(self, outcome):
        self._outcome = outcome
        self.frames = 0

    def push(self, frame):
        self.frames += 1

    def found(self):
        if isinstance(self._outcome, Exception):
            raise self._outcome
        return {"fixed": self._outcome}


@dataclass(frozen=True)
class OnlyResponse(SimulatedSource):
    def truth(self):
        return Truth(Response.gamma(2.0))


@pytest.fixture(scope="module")
def source():
    return stand_ins(1, 5, (64, 48))[0]


def run(source, **methods):
    return run_methods(methods, source.frames(), source.count, lambda _share: None)


def test_every_method_gets_every_frame_and_failures_are_results(source):
    good, broken = Fixed(Estimate()), Fixed(NotObservableError("it is too dark"))
    found = run(source, good=good, broken=broken, wrong=Fixed(ZeroDivisionError("0")))
    assert good.frames == 5
    assert found == {"fixed": Estimate(), "broken": "it is too dark", "wrong": "unexpected ZeroDivisionError: 0"}


def test_the_table_marks_the_lowest_and_counts_what_gave_no_result():
    rows = [
        Measurement("1", "a", {"vignette_rmse": 0.1}),
        Measurement("1", "b", {"vignette_rmse": 0.2}),
        Measurement("2", "a", {"vignette_rmse": 0.3}),
        Measurement("2", "b", failure="it is too dark"),
    ]
    table = median_table(rows)
    column = table.header.index("vignette, RMSE of the profile")
    assert [row[column] for row in table.rows] == ["0.2000", "–"]
    assert table.best == {(0, column)}
    assert [row[-1] for row in table.rows] == ["0/2", "1/2"]


def test_variants_that_share_their_matching_find_what_they_find_alone():
    source = stand_ins(1, 24, (120, 90))[0]
    base = PaperSettings(
        response_window=12, vignette_window=20, min_samples=10, acceptance_tolerance=10.0, max_features=400
    )
    variants = {str(n): replace(base, vignette_offset=n) for n in (5, 10)}
    together = run(source, **paper_variants(variants))
    for name, settings in variants.items():
        alone, exposures = PaperMethod(settings, (120, 90), 255), ExposureTable()
        for frame in source.frames():
            exposures.append(frame.exposure_ms)
            alone.push(frame, None, exposures)
        expected = alone.calibration(exposures)
        np.testing.assert_array_equal(together[name].response.inverse_table, expected.response.inverse_table)
        assert together[name].calibration.verdicts == expected.verdicts


def test_features_that_cannot_be_extracted_are_the_outcome_of_their_variant_alone(source, monkeypatch):
    def broken(_self):
        raise SettingError("SURF needs the extra 'surf'")

    monkeypatch.setattr(SurfExtractor, "__init__", broken)
    methods = EXPERIMENTS["features"].make(source)
    found = run(source, **{name: method for name, method in methods.items() if name != "ours"})
    assert list(found) == ["paper/sift", "paper/surf", "paper/orb"]
    assert [name for name, outcome in found.items() if "extra" in str(outcome)] == ["paper/surf"]


def test_every_experiment_makes_new_methods_and_describes_what_it_varies(source):
    descriptions = []
    for name, experiment in EXPERIMENTS.items():
        assert experiment.name == name
        first, again = experiment.make(source), experiment.make(source)
        assert first.keys() == again.keys()
        assert not {id(method) for method in first.values()} & {id(method) for method in again.values()}
        assert pickle.loads(pickle.dumps(experiment)) == experiment
        descriptions.append(measuring_task(source, experiment).depends_on)
    assert all(descriptions.count(one) == 1 for one in descriptions)
    assert list(EXPERIMENTS["offsets"].varied.values()) == list(OFFSETS)
    assert set(EXPERIMENTS["offsets"].varied) == set(EXPERIMENTS["offsets"].variants)


def test_joint_estimation_is_compared_with_and_without_truth(tmp_path):
    source = stand_ins(1, 24, (80, 60))[0]
    rows = loaded(measuring_task(source, EXPERIMENTS["joint"]).compute(lambda _share: None))
    rows += judge(source, {"mine": Estimate(vignette=source.truth().vignette)})
    assert [row.method for row in rows] == [
        "ours",
        "joint-online-wgt",
        "joint-online-wogt",
        "joint-batch-wgt",
        "joint-batch-wogt",
        "kim-pollefeys-known",
        "kim-pollefeys-assumed",
        "mine",
    ]
    assert [row.method for row in rows if "exposure_error" in row.figures] == [
        row.method for row in rows if row.method.startswith("joint")
    ]
    written = experiment_report(EXPERIMENTS["joint"], [source], rows).write(tmp_path / "out")
    assert {p.name for p in written} == {
        "curves-simulated-0.csv",
        "curves-simulated-0.png",
        "measurements.csv",
        "table.md",
        "errors.png",
    }
    with (tmp_path / "out" / "curves-simulated-0.csv").open() as file:
        lines = list(csv.reader(file))
    assert lines[0][:3] == ["curve", "at", "truth"]
    assert "joint-online-wgt" in lines[0]
    assert len(lines) == 1 + 256 + 50


def test_powers_explain_as_much_until_exposures_are_known(tmp_path):
    found = measure_ambiguity(stand_ins(1, 30, (120, 90))[0])
    exponents, free, known = (np.array(column) for column in found["ambiguity"].values())
    np.testing.assert_allclose(free, free[0], rtol=1e-6)
    assert exponents[np.argmin(known)] == pytest.approx(1, abs=0.13)
    assert known[[0, -1]].min() > 1.3 * known.min()
    written = ambiguity_report(found, "room").write(tmp_path)
    assert {p.name for p in written} == {"ambiguity.csv", "starts.csv", "ambiguity.png"}


def test_the_ambiguity_needs_the_truth(source):
    with pytest.raises(FormatError, match="true"):
        measure_ambiguity(OnlyResponse("x", source.settings))


def test_methods_for_a_camera_at_rest_are_run_on_sweeps():
    (source,) = sweeps(1, 8, (48, 36))
    methods = EXPERIMENTS["static"].make(source)
    names = ["debevec-malik", "robertson"]
    assert list(methods) == ["ours", *names]
    del methods["ours"]
    rows = judge(source, run(source, **methods))
    assert [row.method for row in rows] == names
    assert all(row.figures["response_rmse"] < 0.1 for row in rows)


def test_exposures_of_other_programs_are_read_and_compared(source, tmp_path):
    file = tmp_path / "theirs.txt"
    lines = (f"{f.index} {f.stamp_s} {3 * f.exposure_ms:.9g}\n" for f in source.frames())
    file.write_text("# id stamp exposure\n" + "".join(lines))
    (row,) = judge(source, {"theirs": Estimate(exposures=dict(enumerate(exposures_in(file))))})
    assert row.figures == {"exposure_error": pytest.approx(0, abs=1e-7)}
    file.write_text("1 x\n")
    with pytest.raises(RecordingError, match="exposure"):
        exposures_in(file)


def test_solvers_are_compared_after_the_true_response():
    source = stand_ins(1, 20, (120, 90), speed=0.5)[0]
    response = source.truth().response
    settings = PaperSettings(
        vignette_offset=8, vignette_min_radial_displacement=0.02, min_samples=10, max_features=400
    )
    wanting = replace(settings, min_samples=10**6)
    found = run(source, known=SolversKnowingResponse(response, settings))
    assert list(found) == ["true g/l2", "true g/l1", "true g/m-estimator"]
    assert found["true g/l2"].response is response
    assert found["true g/l2"].vignette.coefficients != found["true g/l1"].vignette.coefficients
    refused = run(source, known=SolversKnowingResponse(response, wanting))
    assert all("points move along the radius" in reason for reason in refused.values())
