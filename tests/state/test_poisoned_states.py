"""States with a valid checksum and impossible content are refused on loading, or everything works with them."""

from __future__ import annotations

import copy
import typing
from contextlib import suppress
from dataclasses import is_dataclass, replace
from functools import partial
from itertools import islice

import numpy as np
import pytest

from ospc.calibrator import OnlineCalibrator, remaining
from ospc.engine.state import Run
from ospc.engine.state_rules import RULES
from ospc.errors import FormatError, OspcError
from ospc.methods.maximum_likelihood_state import MaximumLikelihoodState
from ospc.observations import Observations
from ospc.pooling.pool import Pool, merge
from ospc.settings import DefaultSettings
from ospc.simulation import SimulationSettings, frames
from ospc.state import container
from ospc.state.run import KIND, VERSION
from ospc.state.values import has_json_form

SMALL = {"points_per_pair": 80, "max_points": 1500, "keyframes": 6, "response_intervals": 8, "radial_terms": 4}
QUICK = replace(DefaultSettings(), rounds=2, **SMALL)
NUMBERS = [-1, 0, 2**62, 10**400, 1e300, -1e300, "nan", "inf", "1e999", None, True, [], {}, "x"]

MOTIONS = ["handheld", "static"]


@pytest.fixture(autouse=True)
def uncompressed(monkeypatch):
    """Compression takes most of the time when a state is refused."""
    monkeypatch.setattr(container, "_COMPRESSION", 0)


@pytest.fixture(scope="module", params=MOTIONS)
def motion(request):
    return request.param


@pytest.fixture(scope="module")
def recording(motion):
    return list(frames(SimulationSettings(size=(96, 72), frames=30, motion=motion, exposure="sweep")))


@pytest.fixture(scope="module")
def saved(recording, tmp_path_factory):
    calibrator = OnlineCalibrator(QUICK)
    for frame in recording[:26]:
        calibrator.push(frame)
    place = calibrator.save_state(tmp_path_factory.mktemp("saved") / "state.ospc", complete=True)
    return container.load(place, KIND, VERSION)


def leaves(content, path=()):
    """Yield the paths of all values that are not containers."""
    if isinstance(content, dict | list) and content:
        items = content.items() if isinstance(content, dict) else list(enumerate(content))[:2]
        for key, value in items:
            yield from leaves(value, (*path, key))
    else:
        yield path


def changed(content, path, value):
    content = copy.deepcopy(content)
    inside = content
    for key in path[:-1]:
        inside = inside[key]
        if inside is None:
            pytest.skip("this run has no such value")
    inside[path[-1]] = value
    return content


def arrays_instead_of(array):
    yield array[:0]
    yield array[:-1]
    yield np.concatenate([array, array])
    yield array[..., None]
    if array.dtype.kind == "f":
        for value in (np.nan, np.inf, np.finfo(array.dtype).max, np.finfo(array.dtype).min, -1.0, 1e9):
            poisoned = array.copy()
            poisoned.flat[-1:] = value
            yield poisoned
        yield np.full_like(array, -1e3)
    elif array.dtype.kind != "b":
        limits = np.iinfo(array.dtype)
        for value in (limits.min, limits.max, 0):
            yield np.full_like(array, value)
            poisoned = array.copy()
            poisoned.flat[-1:] = value
            yield poisoned


def use(place, recording):
    """Resume from a state as far as possible, and use it in every supported way."""
    try:
        calibrator = OnlineCalibrator.load_state(place)
    except OspcError:
        return
    with suppress(OspcError):
        for frame in remaining(calibrator, recording):
            calibrator.push(frame)
        calibrator.calibration().as_dict()
        calibrator.save_state(place, complete=True)
        merge(Pool.load(place)).calibration.as_dict()


def poisoned(state):
    """Yield each array or value's name, and a function that returns the state with it changed."""
    for name, array in state.arrays.items():
        for other in arrays_instead_of(array):
            yield name, partial(replace, state, arrays={**state.arrays, name: other})
    for path in leaves(state.content):
        for value in NUMBERS:
            yield path[0], lambda path=path, value=value: replace(state, content=changed(state.content, path, value))


def test_a_poisoned_state_is_refused_or_everything_works_with_it(saved, motion, recording, tmp_path):
    """Each recording tests a different subset of the changes, because all of them take minutes."""
    for name, change in islice(poisoned(saved), 97 * MOTIONS.index(motion), None, 97 * len(MOTIONS)):
        place = container.save(change(), tmp_path / "state.ospc")
        if name.startswith("summary"):  # all that merging reads
            with suppress(OspcError):
                merge(Pool.load(place)).calibration.as_dict()
        use(place, recording)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("run.max_grey", -5),
        ("run.size", [200_000, 200_000]),
        ("run.size.0", 10**400),
        ("run.sampler.number", 2**62),
        ("run.sampler.comparison_period_frames", 0),
        ("run.exposures._next_assessment", -1),
        ("run.exposures.history", None),
        ("run.exposures.choice", "always"),
        ("run.exposures.choice", 2**62),
        ("run.exposures._first_frame", 3),
        ("run.exposures.table._count", 3),
        ("run.pixels._max_grey", 10),
        ("method", None),
        ("method.fit.texture_share", "nan"),
        ("method.fit.errors.constant", 10**400),
        ("method.fit.vignette_basis.radial", 5000),
        ("method.data.reservoir.capacity", 2**40),
        ("method.data.reservoir.points", 3),
        ("method.data.stationary.motions", ["inf"]),
        ("method.keyframes.capacity", 7),
        ("method.keyframes._kept.columns.number.0", 10**6),
        ("method.keyframes._kept.columns.log_exposure.0", 1e300),
    ],
)
def test_values_out_of_range_are_refused(saved, tmp_path, path, value):
    keys = [int(key) if key.isdigit() else key for key in path.split(".")]
    place = container.save(replace(saved, content=changed(saved.content, keys, value)), tmp_path / "state.ospc")
    with pytest.raises(FormatError, match="not readable as a state"):
        OnlineCalibrator.load_state(place)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("run.exposures.table._log_exposure", 1e300),
        ("method.fit.covariance", np.nan),
        ("method.fit.parameters", -1.0),
        ("method.data.reservoir.kept.gradient", 1e300),
        ("method.data.reservoir.kept.grey", 2.0),
        ("run.exposures.history.changes.log_ratio", 1e300),
    ],
)
def test_arrays_out_of_range_are_refused(saved, tmp_path, name, value):
    if name not in saved.arrays:
        pytest.skip("this run has no such array")
    array = saved.arrays[name].copy()
    array.flat[0] = value
    for wrong in (array, saved.arrays[name][:-1], np.concatenate([array] * 2)):
        place = container.save(replace(saved, arrays={**saved.arrays, name: wrong}), tmp_path / "state.ospc")
        with pytest.raises(FormatError, match="not readable as a state"):
            OnlineCalibrator.load_state(place)


@pytest.mark.parametrize("value", [np.nan, 1e300, -1e300])
@pytest.mark.parametrize("name", ["estimate", "triangle", "vector"])
def test_summaries_out_of_range_are_refused(saved, tmp_path, name, value):
    if f"summary.{name}" not in saved.arrays:
        pytest.skip("this run has no summary")
    array = saved.arrays[f"summary.{name}"].copy()
    array[0] = value
    place = container.save(replace(saved, arrays={**saved.arrays, f"summary.{name}": array}), tmp_path / "s.ospc")
    with pytest.raises(FormatError, match="not readable as a state"):
        Pool.load(place)


def dataclasses_in(kind):
    yield kind
    for hint in typing.get_type_hints(kind).values():
        parts = [hint, *typing.get_args(hint), *(p for part in typing.get_args(hint) for p in typing.get_args(part))]
        for part in filter(is_dataclass, parts):
            if not has_json_form(part):
                yield from dataclasses_in(part)


def says_enough(hint):
    """Return whether a type fully describes a value: a number, truth value, string, JSON, or values of a state."""
    if typing.get_origin(hint) is dict:
        return True
    parts = [part for part in (typing.get_args(hint) or (hint,)) if part is not type(None)]
    of_state = is_dataclass(parts[0])
    if typing.get_origin(hint) is list:
        return of_state
    return len(parts) == 1 and (of_state or parts[0] in (int, float, bool, str))


CHECKED_TOGETHER = {
    *("size", "epochs", "first_frames", "calibration", "wrong_exposures", "first", "latest", "brightest", "allowed"),
    *("_histogram", "_brightest", "_ranges", "_kept", "_places", "_size", "_grey", "_index", "_found", "_frames"),
    *("_waiting", "effect_estimates", "parameters", "covariance", "chance", "chosen"),
}
"""Fields that are checked with the other values that they have to agree with, or only by their declared type."""


def test_values_of_a_state_that_types_do_not_restrict_have_a_rule():
    kinds = {*dataclasses_in(Run), *dataclasses_in(MaximumLikelihoodState)} - {Observations}
    assert RULES.keys() <= kinds
    for kind in kinds:
        ruled = set(" ".join(RULES.get(kind, {})).split())
        assert ruled <= set(kind.__dataclass_fields__)
        hints = typing.get_type_hints(kind)
        unrestricted = {name for name in kind.__dataclass_fields__ if not says_enough(hints[name])}
        assert unrestricted <= ruled | CHECKED_TOGETHER, kind


def test_rules_hold_throughout_a_run(recording, tmp_path):
    calibrator = OnlineCalibrator(QUICK)
    for frame in recording:
        calibrator.push(frame)
        if frame.index % 3 == 0:
            OnlineCalibrator.load_state(calibrator.save_state(tmp_path / "state.ospc"))
