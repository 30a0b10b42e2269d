"""Pools do not depend on the order, count each recording once, and are saved bit for bit."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ospc.calibrator import OnlineCalibrator
from ospc.errors import FormatError, SettingError
from ospc.photometry.grey_range import GreyRange
from ospc.pooling.pool import KIND, VERSION, Pool, largest_alike
from ospc.settings import DefaultSettings
from ospc.simulation import SimulationSettings, frames
from ospc.state import container
from ospc.state.container import Container
from summaries import plain

SUMMARIES = st.builds(plain, st.sampled_from("abcde"), st.integers(1, 3), st.integers(0, 2))
POOLS = st.lists(SUMMARIES, max_size=4).map(Pool.of)


def as_bytes(pool, place):
    return pool.save(place / "pool.ospc").read_bytes()


@settings(max_examples=25)
@given(a=POOLS, b=POOLS, c=POOLS)
def test_addition_is_associative_commutative_and_counts_a_recording_once(a, b, c, tmp_path_factory):
    place = tmp_path_factory.mktemp("pool")
    one = as_bytes((a + b) + c, place)
    assert as_bytes(a + (b + c), place) == one
    assert as_bytes(c + b + a, place) == one
    assert as_bytes(a + b + c + b + a, place) == one
    assert as_bytes(a + Pool(), place) == as_bytes(a, place)


@settings(max_examples=25)
@given(pool=POOLS)
def test_what_is_saved_is_loaded_to_the_bit(pool, tmp_path_factory):
    place = tmp_path_factory.mktemp("pool")
    data = as_bytes(pool, place)
    again = Pool.load(place / "pool.ospc")
    assert as_bytes(again, place) == data
    assert [s.key for s in again.summaries] == [s.key for s in pool.summaries]


def test_of_one_recording_the_longer_run_is_kept():
    short, long = plain("a", frames=5), plain("a", frames=9)
    assert [s.frames for s in (Pool.of([long]) + Pool.of([short])).summaries] == [9]


@pytest.mark.parametrize("change", [{"size": (320, 240)}, {"max_grey": 4095}])
def test_frames_of_another_size_or_depth_are_no_recordings_of_one_camera(change):
    with pytest.raises(SettingError, match=r"a has (640×480|255) "):
        Pool.of([plain("a"), replace(plain("b"), **change)])


def test_hundreds_of_recordings_are_a_small_file(tmp_path):
    pool = Pool.of(plain(f"{n:03}", seed=n) for n in range(500))
    assert pool.save(tmp_path / "pool.ospc").stat().st_size < 12_500_000


@pytest.mark.parametrize(("version", "age"), [(VERSION - 1, "an older"), (VERSION + 1, "a newer")])
def test_pools_of_other_versions_are_refused(tmp_path, version, age):
    place = container.save(Container(KIND, version, {}), tmp_path / "pool.ospc")
    with pytest.raises(FormatError, match=rf"written by {age} version"):
        Pool.load(place)


def test_files_of_other_kinds_and_damaged_ones_are_refused(tmp_path):
    with pytest.raises(FormatError, match="there is no such state"):
        Pool.load(tmp_path)
    place = container.save(Container(KIND, VERSION, {"summaries": [{"key": "a"}]}), tmp_path / "state.ospc")
    with pytest.raises(FormatError, match="not readable as a state"):
        Pool.load(tmp_path)
    place.write_bytes(place.read_bytes()[:-3])
    with pytest.raises(FormatError, match="truncated or damaged"):
        Pool.load(place)


@pytest.fixture(scope="module")
def calibrator():
    """A calibrator after a short recording."""
    calibrator = OnlineCalibrator(replace(DefaultSettings(), points_per_pair=80, rounds=3, min_points=50))
    calibrator.source = {"name": "kitchen", "frames_sha256": "1", "images_sha256": "2"}
    exposures = (3.0, 6.0, 12.0, 24.0)
    for frame in frames(SimulationSettings(size=(160, 120), frames=20, exposure="cycle", exposures_ms=exposures)):
        calibrator.push(frame)
    return calibrator


def test_a_finished_run_is_a_pool_of_one_recording_and_a_checkpoint_is_to_be_finished_first(calibrator, tmp_path):
    (tmp_path / "out").mkdir()
    calibrator.save_state(tmp_path / "out" / "state.ospc", complete=True)
    finished = Pool.load(tmp_path / "out")
    assert [s.name for s in finished.summaries] == ["kitchen"]
    calibrator.save_state(tmp_path / "checkpoint.ospc")
    with pytest.raises(FormatError, match="--resume"):
        Pool.load(tmp_path / "checkpoint.ospc")


def test_a_state_without_a_result_is_reported(tmp_path):
    OnlineCalibrator().save_state(tmp_path / "state.ospc")
    with pytest.raises(FormatError, match="nothing could be learned"):
        Pool.load(tmp_path)


SCATTERED = [GreyRange(0, white / 255) for white in (233, 234)]


def test_recordings_whose_white_scatters_are_of_one_camera():
    one, other = (replace(plain(key), grey_range=found) for key, found in zip("ab", SCATTERED, strict=True))
    assert len(Pool.of([one, other])) == 2
    with pytest.raises(SettingError, match=r"0 and 233 of 255 for black and white, .* 0 and 255 of 255"):
        Pool.of([replace(plain("a", frames=11), grey_range=SCATTERED[0]), plain("b")])


def test_the_largest_group_of_like_recordings_is_used_and_the_others_named():
    alike = [replace(plain(key), grey_range=SCATTERED[0]) for key in "abc"]
    others = [plain("d"), replace(plain("e"), max_grey=4095)]
    pool, differing = largest_alike([others[0], *alike, others[1]])
    assert [one.name for one in pool.summaries] == ["a", "b", "c"]
    assert [found.name for found in differing] == ["d", "e"]
    assert all("another camera or mode" in found.text for found in differing)
    assert len(largest_alike([])[0]) == 0


def test_a_recording_between_two_that_differ_goes_with_one_of_them():
    whites = {"a": 247, "m": 249, "z": 251}
    pool, differing = largest_alike([replace(plain(k), grey_range=GreyRange(0, w / 255)) for k, w in whites.items()])
    assert [one.name for one in pool.summaries] == ["a", "m"]
    assert [found.name for found in differing] == ["z"]


def test_pools_and_summaries_are_compared_by_their_content(tmp_path):
    pool = Pool.of([plain("a")])
    loaded = Pool.load(pool.save(tmp_path / "pool.ospc"))
    assert loaded == pool
    assert hash(loaded) == hash(pool)
    assert loaded.summaries[0] != replace(pool.summaries[0], name="another")
