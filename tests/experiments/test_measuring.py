"""Methods run in one pass over a recording, and every failure is a line of the table."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import replace

import numpy as np
import pytest

from ospc.errors import ExposureError, FormatError, NotObservableError
from ospc.experiments.ambiguity import show_ambiguity
from ospc.experiments.design import EXPERIMENTS, OFFSETS, joint, offsets
from ospc.experiments.measuring import (
    FIGURES,
    Measurement,
    Others,
    as_csv,
    as_markdown,
    exposure_error,
    measure,
    medians,
    read_exposures,
)
from ospc.experiments.methods import Exposures, Paper, SolversKnowingResponse, Timed
from ospc.experiments.reports import make_ambiguity, make_experiment
from ospc.experiments.sources import stand_ins
from ospc.experiments.static import METHODS, static_methods, sweeps
from ospc.exposures.lookup import StatedExposures
from ospc.formats.opening import Photometry
from ospc.methods.paper import PaperMethod
from ospc.photometry.response import Response
from ospc.settings import PaperSettings


class Fixed:
    def __init__(self, name, result):
        self._name, self._result = name, result
        self.frames = 0

    def push(self, frame):
        self.frames += 1

    def found(self):
        if isinstance(self._result, Exception):
            raise self._result
        return {self._name: self._result}


@pytest.fixture
def source():
    return stand_ins(1, 5, (64, 48))[0]


def test_the_truth_itself_has_no_error_and_others_are_compared_too(source):
    fixed = Fixed("perfect", replace(source.truth, name="perfect"))
    other = Photometry("theirs", Response.gamma(1.0), None)
    measured = measure(source, [Timed("perfect", fixed)], others=Others((other,)))
    assert fixed.frames == 5
    perfect, theirs = measured.rows
    assert all(perfect.value(f) == pytest.approx(0, abs=1e-6) for f in FIGURES[:-1])
    assert theirs.method == "theirs"
    assert theirs.value("response_rmse") > 0.1
    assert theirs.value("vignette_rmse") == math.inf


def test_failures_are_rows(source):
    broken = Fixed("broken", NotObservableError("it is too dark"))
    empty = Fixed("empty", Photometry("empty", None, None))
    rows = measure(source, [Timed("broken", broken), Timed("empty", empty)]).rows
    assert [row.failure for row in rows] == ["it is too dark", "it found neither response nor vignette"]
    table = list(csv.DictReader(io.StringIO(as_csv(rows))))
    assert table[0]["failure"] == "it is too dark"
    assert table[0]["vignette_rmse"] == ""
    assert "1/1" in as_markdown(rows)


def test_medians_count_what_is_missing_as_worst():
    rows = [Measurement(str(i), "m", {"vignette_rmse": value}, 0.0) for i, value in enumerate((0.1, None, 0.3))]
    assert medians(rows, "vignette_rmse") == {"m": 0.3}
    assert medians(rows[:2], "vignette_rmse") == {"m": math.inf}


def test_variants_that_share_their_matching_find_what_they_find_alone():
    source = stand_ins(1, 24, (120, 90))[0]
    base = PaperSettings(
        response_window=12, vignette_window=20, min_samples=10, acceptance_tolerance=10.0, max_features=400
    )
    variants = {str(n): replace(base, vignette_offset=n) for n in (5, 10)}
    together = measure(source, [Timed("paper", Paper(variants))]).found
    for name, settings in variants.items():
        alone, exposures = PaperMethod(settings, (120, 90), 255), StatedExposures()
        for frame in source.open():
            exposures.add(frame.index, frame.exposure_ms)
            alone.push(frame, exposures)
        expected = alone.calibration(exposures)
        np.testing.assert_array_equal(together[name].response.inverse_table, expected.response.inverse_table)


def test_every_experiment_names_its_methods_and_what_it_varies(source):
    for name, make in EXPERIMENTS.items():
        experiment = make()
        assert experiment.name == name
        assert experiment.methods(source)
    assert list(offsets().varied.values()) == list(OFFSETS)


def test_joint_estimation_is_compared_with_and_without_truth(tmp_path):
    source = stand_ins(1, 102, (80, 60))[0]
    report = make_experiment(
        joint(), [source], tmp_path / "out", lambda *_: None, Others((replace(source.truth, name="mine"),))
    )
    assert not report.problems
    methods = [row.method for row in report.rows]
    assert methods == [
        "ours",
        "joint-online-wgt",
        "joint-online-wogt",
        "joint-batch-wgt",
        "joint-batch-wogt",
        "kim-pollefeys-known",
        "kim-pollefeys-assumed",
        "mine",
    ]
    assert {p.name for p in report.files} == {
        "curves-simulated-0.csv",
        "curves-simulated-0.png",
        "measurements.csv",
        "table.md",
        "errors.png",
    }
    with (tmp_path / "out" / "curves-simulated-0.csv").open() as file:
        rows = list(csv.reader(file))
    assert rows[0][:4] == ["curve", "at", "truth", "ours"]
    assert len(rows) == 1 + 256 + 50


def test_powers_explain_as_much_until_exposures_are_known(tmp_path):
    source = stand_ins(1, 30, (120, 90))[0]
    found = show_ambiguity(source)
    np.testing.assert_allclose(found.free, found.free[0], rtol=1e-6)
    assert found.exponents[np.argmin(found.known)] == pytest.approx(1, abs=0.13)
    assert found.known[[0, -1]].min() > 1.3 * found.known.min()
    report = make_ambiguity(source, tmp_path, lambda *_: None)
    assert {p.name for p in report.files} == {"ambiguity.csv", "starts.csv", "ambiguity.png"}


def test_the_ambiguity_needs_the_truth(source):
    with pytest.raises(FormatError, match="true"):
        show_ambiguity(replace(source, truth=Photometry("x", Response.gamma(2.0), None)))


def test_methods_for_a_still_camera_are_run_on_sweeps():
    (source,) = sweeps(1, 8, (48, 36))
    methods = static_methods()
    assert [method.label for method in methods] == ["ours", *METHODS]
    rows = measure(source, methods[1:]).rows
    assert {row.method for row in rows} == set(METHODS)
    assert all(row.value("response_rmse") < 0.1 for row in rows)


def test_exposures_are_compared_up_to_a_factor(source, tmp_path):
    true = {frame.index: frame.exposure_ms for frame in source.open()}
    frames = np.array(list(true))
    values = np.array(list(true.values()))
    assert exposure_error(Exposures(frames, 7 * values), true) == pytest.approx(0, abs=1e-12)
    assert exposure_error(Exposures(frames, values**1.5), true) == pytest.approx(0.5 * np.std(np.log(values)))
    file = tmp_path / "theirs.txt"
    file.write_text("# id stamp exposure\n" + "".join(f"{i} {i / 20} {3 * e:.9g}\n" for i, e in true.items()))
    rows = measure(source, [], others=Others(exposures={"theirs": read_exposures(file)})).rows
    assert [row.method for row in rows] == ["theirs"]
    assert rows[0].value("exposure_error") == pytest.approx(0, abs=1e-7)
    with pytest.raises(ExposureError, match="lacks"):
        exposure_error(Exposures(frames + 1, values), true)
    with pytest.raises(ExposureError, match="above 0"):
        exposure_error(Exposures(frames, -values), true)
    file.write_text("1 x\n")
    with pytest.raises(FormatError, match="exposure"):
        read_exposures(file)


def test_solvers_are_compared_after_the_true_response():
    source = stand_ins(1, 20, (120, 90), speed=0.5)[0]
    settings = PaperSettings(
        vignette_offset=8, vignette_min_radial_displacement=0.02, min_samples=10, max_features=400
    )
    alone = SolversKnowingResponse(source.truth.response, settings, ("l2", "l1"))
    found = measure(source, [Timed("true g", alone)]).found
    assert list(found) == ["true g/l2", "true g/l1"]
    assert found["true g/l2"].response is source.truth.response
    assert found["true g/l2"].vignette.coefficients != found["true g/l1"].vignette.coefficients
    wanting = SolversKnowingResponse(source.truth.response, replace(settings, min_samples=10**6), ("l2",))
    (row,) = measure(source, [Timed("true g", wanting)]).rows
    assert "points move along the radius" in row.failure
