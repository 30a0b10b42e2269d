"""What raises a suspicion of change, how long it lasts at any frame rate, and what confirms a change."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from log_polynomials import log_polynomial
from ospc.estimation.fit import Fit
from ospc.estimation.fit_plan import FitPlan
from ospc.estimation.response_basis import ResponseBasis
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.estimation.vignette_choice import fit_with_chosen_vignette
from ospc.exposures.table import ExposureTable
from ospc.methods.change_detection import Change, ChangeDetector
from ospc.observations import ExposedObservations
from ospc.photometry.grey_range import FULL_RANGE
from ospc.settings import DefaultSettings
from ospc.settings.methods import MIN_BASELINE_PAIRS, MIN_FRAME_RATE, RECENT_PAIRS
from ospc.simulation.responses import make_response
from synthetic_observations import POLYNOMIAL, SIZE, Camera

CAMERA = Camera(make_response("srgb"), POLYNOMIAL, log_ratio=0.2)
DARKER_CORNERS = replace(CAMERA, vignette=log_polynomial(SIZE, (-0.8, 0.05, -0.2)))
NEIGHBOURS, DISTANT = 1, 4
LONG_ENOUGH = 100
"""Number of pairs that prove a change."""


@dataclass(frozen=True)
class SeenPair:
    """A pair of observed frames with known exposures."""

    exposed: ExposedObservations
    frame: tuple[int, int]

    @property
    def starts(self):
        return self.exposed.starts

    def of_points(self, chosen):
        return replace(self, exposed=self.exposed.of_points(chosen))

    def with_exposures(self, _exposures):
        return replace(self.exposed, frame=np.tile(self.frame, len(self.starts)))


@dataclass
class Watched:
    """A detector for a calibrated camera, and the number of its next frame."""

    detector: ChangeDetector
    frame: int = 0

    def see(self, camera: Camera, age: int, count: int, *, light: float = 0.0) -> Change | None:
        """Observe pairs ``age`` frames apart; the light changes within each by up to ``light`` in ln.

        Return the last change that is found.
        """
        found = None
        for number in range(self.frame, self.frame + count):
            exposed = camera.pairs(number, groups=1)
            brighter = np.tile([0.0, light * np.cos(number)], len(exposed.starts))
            moved = replace(exposed, log_exposure=exposed.log_exposure + brighter)
            found = self.detector.observe(SeenPair(moved, (number, number + age)), ExposureTable()) or found
        self.frame += count
        return found


def fitted(camera: Camera) -> Fit:
    settings = DefaultSettings()
    basis = ResponseBasis(settings.response_intervals, settings.response_functions)
    seen = camera.pairs(10**6, groups=80, points=200)
    plan = FitPlan(basis, VignetteBasis(settings.radial_terms), None, settings.rounds)
    return fit_with_chosen_vignette(seen, plan).fit


@pytest.fixture(scope="module")
def fit():
    return fitted(CAMERA)


@pytest.fixture(scope="module")
def later_fit():
    """The fit to the camera after its corners became darker."""
    return fitted(DARKER_CORNERS)


@pytest.fixture
def watched(fit):
    found = Watched(ChangeDetector(reference=fit))
    for age in (NEIGHBOURS, DISTANT):
        found.see(CAMERA, age, 2 * MIN_BASELINE_PAIRS)
    return found


@pytest.mark.parametrize("age", [NEIGHBOURS, DISTANT])
def test_pairs_of_any_age_raise_a_suspicion_of_darker_corners(watched, age):
    watched.see(CAMERA, age, 4 * RECENT_PAIRS)
    assert not watched.detector.is_suspicious
    changed_at = watched.frame
    watched.see(DARKER_CORNERS, age, RECENT_PAIRS)
    assert watched.detector.is_suspicious
    assert changed_at <= watched.detector.since <= watched.frame + age


def test_light_raises_a_suspicion_only_if_it_changes_between_frames(watched):
    watched.see(CAMERA, DISTANT, 2 * RECENT_PAIRS, light=0.2)
    assert not watched.detector.is_suspicious
    watched.see(CAMERA, NEIGHBOURS, 2 * RECENT_PAIRS, light=0.2)
    assert watched.detector.is_suspicious


def test_a_change_that_the_complete_fit_explains_is_none_and_that_fit_stays_the_reference(watched, fit, later_fit):
    """For example, glare that the quick fit leaves out; here, the quick fit has another vignette."""
    detector = watched.detector
    change = watched.see(DARKER_CORNERS, DISTANT, LONG_ENOUGH)
    assert change.part == "vignette"
    assert detector.prove_again(change, later_fit, FULL_RANGE, ExposureTable()) is None
    detector.set_reference(fit)
    assert detector.reference is later_fit
    for age in (NEIGHBOURS, DISTANT):
        assert watched.see(DARKER_CORNERS, age, LONG_ENOUGH) is None
        assert not detector.is_suspicious
    assert watched.see(CAMERA, DISTANT, LONG_ENOUGH).part == "vignette"


def test_a_change_that_the_complete_fit_does_not_explain_is_confirmed_by_the_same_pairs(watched, fit):
    change = watched.see(DARKER_CORNERS, DISTANT, LONG_ENOUGH)
    found = watched.detector.prove_again(change, fit, FULL_RANGE, ExposureTable())
    assert (found.part, found.frame, found.found) == (change.part, change.frame, change.found)


@pytest.mark.parametrize(("rate", "counted"), [(5.0, 20.0), (20.0, 20.0), (50.0, 50.0), (1000.0, 100.0)])
def test_times_are_counted_in_frames_by_the_stamps(rate, counted):
    detector = ChangeDetector()
    for number in range(3, 400, 7):
        detector.observe_time(number, 1.7e9 + number / rate)
    assert detector.frames_per_s == pytest.approx(counted, rel=1e-6)


@pytest.mark.parametrize("stamps", [[0.0] * 5, [np.nan] * 5, [5.0, 4.0, 3.0, 2.0, 1.0]])
def test_stamps_that_are_none_count_as_those_of_slow_film(stamps):
    detector = ChangeDetector()
    for number, stamp_s in enumerate(stamps):
        detector.observe_time(number, stamp_s)
    assert detector.frames_per_s == MIN_FRAME_RATE
