"""Starting from an earlier calibration helps from the first frames on, and never applies after a lens change."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest

from calibrations import calibration as made_up
from log_polynomials import log_polynomial
from ospc.calibrator import OnlineCalibrator
from ospc.engine import state
from ospc.engine.state import Epoch, response_before_change
from ospc.errors import FormatError, NotObservableError, SettingError
from ospc.estimation.response_basis import FUNCTIONS, ResponseBasis
from ospc.evaluation.metrics import vignette_rmse
from ospc.live import LiveCalibrator
from ospc.methods.change_detection import Change
from ospc.methods.identifiability import doubted
from ospc.methods.result import calibration_of
from ospc.photometry.calibration import Calibration
from ospc.photometry.grey_range import GreyRange
from ospc.photometry.response import Response
from ospc.photometry.verdict import Verdict
from ospc.pooling.calibration_summary import summary_of_calibration
from ospc.pooling.pool import Pool, merge
from ospc.pooling.prior_calibration import PriorCalibration
from ospc.pooling.summary import summary_of
from ospc.recording import Frame
from ospc.settings import DefaultSettings
from response_functions import HatsCrowdedAtBlack
from summaries import CAMERA, OTHER_LENS, OTHER_RESPONSE, SIZE, fisheye_inputs_of, inputs_of, summary


@pytest.fixture(scope="module")
def yesterday(tmp_path_factory):
    """A saved state of four recordings, and a saved calibration of one."""
    place = tmp_path_factory.mktemp("yesterday")
    Pool.of([summary(CAMERA, seed) for seed in range(4)]).save(place / "state.ospc")
    calibration_of(inputs_of(CAMERA, 0, groups=80), DefaultSettings()).save(place / "calibration.json")
    return place


def today(camera, groups):
    evidence = inputs_of(camera, 50, groups=groups)
    return calibration_of(evidence, DefaultSettings()), summary(camera, 50, groups=groups)


@pytest.mark.parametrize("name", ["state.ospc", "calibration.json"])
def test_a_few_frames_of_the_same_camera_only_refine_the_calibration(yesterday, name):
    earlier = PriorCalibration.open(yesterday / name)
    own, seen = today(CAMERA, groups=6)
    found = earlier.continued(own, seen)
    assert found.response is not None
    assert "starting from" in found.verdicts["response"].reason
    assert found.source["started_from"]["changed"] == []
    assert vignette_rmse(found.vignette, CAMERA.vignette) < vignette_rmse(own.vignette, CAMERA.vignette)
    assert found.vignette_sigma[-1] < own.vignette_sigma[-1]
    alone = Calibration.load(yesterday)
    assert found.vignette_sigma[-1] < 1.05 * alone.vignette_sigma[-1]


@pytest.mark.parametrize("name", ["state.ospc", "calibration.json"])
def test_another_lens_is_noticed_and_yesterday_forgotten(yesterday, name):
    earlier = PriorCalibration.open(yesterday / name)
    own, seen = today(OTHER_LENS, groups=60)
    found = earlier.continued(own, seen)
    assert found.source["started_from"]["changed"] == ["vignette"]
    assert "another lens, or its focus" in found.verdicts["vignette"].reason
    np.testing.assert_array_equal(found.vignette.image(), own.vignette.image())


@pytest.mark.parametrize("groups", [6, 60])
def test_what_was_known_is_identifiable_once_new_frames_check_it(yesterday, groups):
    own, seen = today(CAMERA, groups=groups)
    found = PriorCalibration.open(yesterday).continued(own, seen)
    for name, verdict in found.verdicts.items():
        checked = own.verdicts[name].state == "identifiable"
        assert (verdict.state == "identifiable") == checked
        assert ("the new frames do not check it" in verdict.reason) == (not checked)
        assert verdict.remedy == own.verdicts[name].remedy
    assert found.converged == (groups == 60)


@pytest.mark.parametrize("part", ["response", "vignette"])
def test_a_small_but_significant_difference_is_a_change_too(yesterday, part):
    """It is within the scatter that is usual between recordings, but the mean would be of neither camera."""
    changed = {
        "response": replace(CAMERA, response=Response.gamma(1.73, 4097)),
        "vignette": replace(CAMERA, vignette=log_polynomial(SIZE, (-0.46, 0.05, -0.2))),
    }
    own, seen = today(changed[part], groups=60)
    found = PriorCalibration.open(yesterday).continued(own, seen)
    assert found.source["started_from"]["changed"] == [part]
    assert "standard deviations" in found.verdicts[part].reason
    np.testing.assert_array_equal(found.vignette.image(), own.vignette.image())
    np.testing.assert_array_equal(found.response.log_sigma, own.response.log_sigma)


@pytest.mark.parametrize("unknown", [{"exponent_sigma": 0.3}, {"rests_on": "a guess from one image"}])
def test_a_calibration_without_known_exposures_is_not_started_from(yesterday, tmp_path, unknown):
    """Its exponent is uncertain, which the result could not state."""
    replace(Calibration.load(yesterday), **unknown).save(tmp_path / "calibration.json")
    with pytest.raises(NotObservableError, match="is not from known exposures"):
        PriorCalibration.open(tmp_path)


@pytest.mark.parametrize("read", [PriorCalibration.open, Pool.load, OnlineCalibrator.load_state])
def test_what_is_no_path_is_refused(read):
    with pytest.raises(FormatError, match="must be given by its path"):
        read(None)


def test_starting_from_a_calibration_without_new_frames_returns_it(yesterday):
    before = Calibration.load(yesterday)
    nothing = Calibration(size=SIZE, verdicts=before.verdicts)
    found = PriorCalibration.open(yesterday / "calibration.json").continued(nothing, None)
    grey = np.linspace(0.1, 0.9, 9)
    np.testing.assert_allclose(found.response.inverse(grey), before.response.inverse(grey), rtol=0.01)
    np.testing.assert_allclose(found.vignette.image(), before.vignette.image(), atol=0.005)
    np.testing.assert_allclose(found.response.log_sigma[60], before.response.log_sigma[60], rtol=0.3)


@pytest.mark.parametrize(
    ("intervals", "functions"), [(20, "hats"), (64, "hats"), (DefaultSettings().response_intervals, "crowded")]
)
def test_the_earlier_response_may_have_another_basis(monkeypatch, tmp_path, intervals, functions):
    monkeypatch.setitem(FUNCTIONS, "crowded", HatsCrowdedAtBlack())
    before = calibration_of(
        inputs_of(CAMERA, 0, groups=80, basis=ResponseBasis(intervals, functions)), DefaultSettings()
    )
    before.save(tmp_path / "calibration.json")
    earlier = PriorCalibration.open(tmp_path)
    found = earlier.continued(Calibration(size=SIZE, verdicts=before.verdicts), None)
    ratios, expected = (
        one.response.inverse(np.linspace(0.05, 0.95, 19)) / one.response.inverse(0.5) for one in (found, before)
    )
    np.testing.assert_allclose(ratios, expected, rtol=0.01)
    own, seen = today(CAMERA, groups=6)
    assert earlier.continued(own, seen).source["started_from"]["changed"] == []
    ended = Epoch(0, 9, before, Change(10, 20, "vignette", "the vignette changed"))
    after_change = response_before_change([ended], np.zeros(20)).continued(own, seen)
    assert after_change.source["started_from"]["changed"] == []


def test_a_response_that_changed_with_the_vignette_is_not_carried_on():
    """A change of the vignette hides the change of the response, until the frames after it show theirs."""
    before = calibration_of(inputs_of(CAMERA, 0, groups=80), DefaultSettings())
    ended = Epoch(0, 9, before, Change(10, 20, "vignette", "the vignette changed"))
    own, seen = today(replace(OTHER_LENS, response=Response.gamma(1.73, 4097)), groups=60)
    found = response_before_change([ended], np.zeros(20)).continued(own, seen)
    assert found.source["started_from"]["changed"] == ["response"]
    np.testing.assert_array_equal(found.response.log_sigma, own.response.log_sigma)


@pytest.mark.parametrize("change", [{"functions": "no such"}, {"knots": [0.0, 0.7, 1.0]}, {"coefficients": [1.0]}])
def test_a_response_of_an_unknown_basis_is_refused(yesterday, change):
    known = Calibration.load(yesterday)
    other = replace(known, response=replace(known.response, model=known.response.model | change))
    with pytest.raises(FormatError, match="not a calibration of the default method"):
        summary_of_calibration(other, "other")


def test_what_the_prior_says_of_the_vignette_counts_once():
    before = calibration_of(inputs_of(CAMERA, 50, groups=6), DefaultSettings())  # so few that the prior matters
    earlier = PriorCalibration("before", Pool.of([summary_of_calibration(before, "before")]))
    found = earlier.continued(Calibration(size=SIZE, verdicts=before.verdicts), None)
    np.testing.assert_allclose(found.vignette_sigma[1:], before.vignette_sigma[1:], rtol=0.02)
    np.testing.assert_allclose(found.vignette.image(), before.vignette.image(), atol=0.001)


@pytest.mark.parametrize("name", ["state.ospc", "calibration.json"])
def test_a_continued_fisheye_keeps_its_image_limit(tmp_path, name):
    inputs = fisheye_inputs_of(CAMERA, 0, 0.7)
    before = calibration_of(inputs, DefaultSettings())
    before.save(tmp_path / "calibration.json")
    Pool.of([summary_of(inputs, "frames", {}, 100)]).save(tmp_path / "state.ospc")
    found = PriorCalibration.open(tmp_path / name).continued(Calibration(size=SIZE, verdicts=before.verdicts), None)
    np.testing.assert_allclose(found.vignette.image(), before.vignette.image(), atol=0.01)
    assert found.verdicts["vignette"].state == "identifiable"


def test_a_recording_that_starts_from_itself_counts_once():
    source = {"frames_sha256": "1", "images_sha256": "2"}
    inputs = inputs_of(CAMERA, 50, groups=20)
    own = replace(calibration_of(inputs, DefaultSettings()), source=source)
    seen = summary_of(inputs, "frames", source, 100)
    for itself in (Pool.of([seen]), Pool.of([summary_of_calibration(own, "itself")])):
        found = PriorCalibration("itself", itself).continued(own, seen)
        np.testing.assert_array_equal(found.vignette_sigma, own.vignette_sigma)
        np.testing.assert_array_equal(found.response.log_sigma, own.response.log_sigma)
        assert any("from this same recording" in note for note in found.notes)
    others = Pool.of([summary(CAMERA, 0), summary(CAMERA, 1)])
    twice, once = (PriorCalibration("both", pool).continued(own, seen) for pool in (others + Pool.of([seen]), others))
    np.testing.assert_array_equal(twice.vignette_sigma, once.vignette_sigma)


def test_starting_from_a_state_equals_starting_from_its_merge():
    of_other_response = replace(summary(OTHER_RESPONSE, 101), exposure_range_ms=(0.001, 1e6), radial_motion=3.0)
    recordings = [summary(CAMERA, seed) for seed in range(4)] + [summary(OTHER_LENS, 100, groups=160)]
    merged = merge(Pool.of([*recordings, of_other_response])).calibration
    assert merged.counts["differing"] == 2
    earlier = PriorCalibration("yesterday", Pool.of([*recordings, of_other_response]))
    found = earlier.continued(Calibration(size=SIZE, verdicts=merged.verdicts), None)
    for part in ("response", "vignette"):
        figure = merged.verdicts[part].reason.rsplit(", based on ", 1)[0]
        assert found.verdicts[part].reason.startswith(f"{figure}, starting from")
    np.testing.assert_allclose(found.response.log_sigma, merged.response.log_sigma, rtol=1e-6)
    np.testing.assert_allclose(found.vignette_sigma, merged.vignette_sigma, rtol=1e-6)


def test_contradicting_recordings_are_refused_as_a_start(tmp_path):
    Pool.of([summary(CAMERA, 0), summary(OTHER_RESPONSE, 101)]).save(tmp_path / "state.ospc")
    with pytest.raises(NotObservableError, match="contradict each other, so there is nothing to start from"):
        PriorCalibration.open(tmp_path)


def test_a_calibrator_starts_from_what_was_known(yesterday):
    calibrator = OnlineCalibrator(prior=PriorCalibration.open(yesterday))
    calibrator.push(Frame.of_array(np.full(SIZE[::-1], 90, np.uint8), 5.0))
    found = calibrator.calibration()
    # A single frame cannot show whether its exposure belongs to it, or whether the camera has changed.
    assert {verdict.state for verdict in found.verdicts.values()} == {"marginal"}
    assert "but the new frames do not check it" in found.verdicts["vignette"].reason
    assert found.response is not None
    assert found.vignette is not None
    assert not found.converged
    assert json.dumps(found.as_dict())
    assert found.counts["frames"] == 1


@pytest.mark.parametrize(("part", "known"), [("vignette", {"response"}), ("response", set())])
def test_after_a_change_of_the_camera_what_changed_is_no_longer_known(yesterday, part, known):
    calibrator = OnlineCalibrator(prior=PriorCalibration.open(yesterday))
    calibrator.push(Frame.of_array(np.full(SIZE[::-1], 90, np.uint8), 5.0))
    change = Change(1, 1, part, f"the {part} changed")
    calibrator._run.epochs.append(Epoch(0, 0, calibrator.calibration(), change))
    found = calibrator.calibration()
    assert {name for name in ("response", "vignette") if found.verdicts[name].known} == known


def test_a_live_calibrator_starts_from_what_was_known_before_a_restart(yesterday):
    with LiveCalibrator(prior=PriorCalibration.open(yesterday)) as live:
        live.push(Frame.of_array(np.full(SIZE[::-1], 90, np.uint8), 5.0))
        found = live.calibration()
    assert found.response is not None
    assert found.vignette is not None
    assert found.source["started_from"]["changed"] == []


def test_a_contradiction_by_new_frames_counts_despite_earlier_ones(yesterday):
    own, seen = today(CAMERA, groups=60)
    doubt = doubted(Verdict("identifiable", "known"), (("the response changes", "switch off scene modes"),))
    own = replace(own, verdicts={"response": doubt, "vignette": doubt}, warnings=("the response changes",))
    found = PriorCalibration.open(yesterday).continued(own, seen)
    assert not found.converged
    for verdict in found.verdicts.values():
        assert (verdict.state, verdict.remedy) == (doubt.state, doubt.remedy)
        assert "starting from" in verdict.reason
        assert "but the response changes" in verdict.reason


def test_a_warning_about_the_exposures_counts_however_much_was_known(yesterday, monkeypatch):
    calibrator = OnlineCalibrator(prior=PriorCalibration.open(yesterday))
    calibrator.push(Frame.of_array(np.full(SIZE[::-1], 90, np.uint8), 5.0))
    stale = replace(calibrator.exposure_findings(), warnings=("the metadata are stale",))
    monkeypatch.setattr(state, "checked_by_fit", lambda _method, table, *_, **__: (table, stale))
    found = calibrator.calibration()
    assert not found.converged
    assert {verdict.state for verdict in found.verdicts.values()} == {"marginal"}
    assert "; the metadata are stale" in found.verdicts["response"].reason


def test_an_earlier_calibration_of_another_range_of_grey_values_is_not_used_and_nothing_is_lost(yesterday):
    own, seen = today(CAMERA, groups=6)
    for other in (replace(seen, grey_range=GreyRange(16 / 255, 235 / 255)), replace(seen, max_grey=4095)):
        found = PriorCalibration.open(yesterday).continued(own, other)
        np.testing.assert_array_equal(found.response.inverse_table, own.response.inverse_table)
        assert found.verdicts == own.verdicts
        assert any("was not used: " in note and "another camera or mode" in note for note in found.notes)


def test_frames_of_another_size_are_calibrated_without_it(yesterday):
    calibrator = OnlineCalibrator(prior=PriorCalibration.open(yesterday))
    calibrator.push(Frame.of_array(np.zeros((48, 64), np.uint8), 5.0))
    (note,) = (note for note in calibrator.calibration().notes if "was not used" in note)
    assert note.endswith("it is for 640×480 pixels, but the frames have 64×48, so it is from another camera or mode")
    with pytest.raises(SettingError, match="it is for 640×480 pixels, but the frames have 64×48; start from a"):
        PriorCalibration.open(yesterday).check_size((64, 48))


def test_unsuitable_starts_are_refused_by_name(tmp_path):
    with pytest.raises(NotObservableError, match="has neither response nor vignette"):
        PriorCalibration.open(made_up(response=False, vignette=False).save(tmp_path / "a.json"))
    with pytest.raises(FormatError, match="not a calibration of the default method"):
        PriorCalibration.open(made_up().save(tmp_path / "b.json"))
    forged = replace(made_up(), covariance={"response": {"parameters": ["c0"], "matrix": [[0.0]]}})
    with pytest.raises(FormatError, match="not a calibration of the default method"):
        PriorCalibration.open(forged.save(tmp_path / "c.json"))
    with pytest.raises(FormatError, match="there is no such"):
        PriorCalibration.open(tmp_path / "none")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *itertools.product(["prior_walk", "prior_drift"], [1e300, -1.0, "nan", None]),
        *itertools.product(["prior_knees"], [[0], [48], [1, 2, 3, 4, 5], ["nan"], None]),
    ],
)
def test_a_calibration_with_an_impossible_prior_is_refused(yesterday, tmp_path, name, value):
    content = json.loads((yesterday / "calibration.json").read_text())
    content["response"]["model"][name] = value
    (tmp_path / "calibration.json").write_text(json.dumps(content))
    with pytest.raises(FormatError, match="not a calibration of the default method"):
        PriorCalibration.open(tmp_path / "calibration.json")
