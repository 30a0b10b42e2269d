"""Results are kept, found again only for what they belong to, and survive interruptions."""

from __future__ import annotations

import json

import pytest
from fake_cases import FakeCase

from ospc.benchmark import store as store_module
from ospc.benchmark.store import Store, key_of
from ospc.benchmark.tasks import Task, choose, run
from ospc.errors import SettingError


def tasks(cases, presets=("default", "paper")):
    return [Task(case, preset) for preset in presets for case in cases]


def test_what_is_put_is_found(tmp_path):
    case, store = FakeCase("a"), Store(tmp_path / "cache")
    assert store.get(case, "default") is None
    rows = case.rows("default", lambda _share: None)
    path = store.put(case, "default", rows)
    assert store.get(case, "default") == rows
    assert store.get(case, "paper") is None
    assert json.loads(path.read_text())["recording"] == case.describe()


def test_another_recording_or_source_is_another_key(monkeypatch):
    key = key_of(FakeCase("a"), "default")
    assert key != key_of(FakeCase("a", shape=0.02), "default")
    assert key != key_of(FakeCase("a"), "paper")
    assert key == key_of(FakeCase("a"), "default")
    monkeypatch.setattr(store_module, "source_hash", lambda: "other")
    assert key != key_of(FakeCase("a"), "default")


def test_every_part_that_results_depend_on_is_hashed():
    before = store_module.source_hash()
    root = store_module.Path(store_module.ospc.__file__).parent
    assert all((root / name).exists() for name in store_module._DEPENDED_ON)
    assert len(before) == 64


@pytest.mark.parametrize("content", ["", "{", "[]", "{}", '{"schema": "other"}', "[" * 10_000])
def test_damaged_files_count_as_missing(tmp_path, content):
    case, store = FakeCase("a"), Store(tmp_path)
    path = store.put(case, "default", [])
    path.write_text(content)
    assert store.get(case, "default") is None


def test_a_folder_that_cannot_be_made_is_an_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(SettingError, match="cannot be written"):
        Store(tmp_path / "file" / "cache").put(FakeCase("a"), "default", [])


def test_stored_results_are_not_computed_again(tmp_path):
    log = tmp_path / "log"
    cases = [FakeCase(name, log=log) for name in "abc"]
    first = list(run(tasks(cases), Store(tmp_path / "cache"), 1))
    again = list(run(tasks(cases), Store(tmp_path / "cache"), 1))
    assert [r.stored for r in first] == [False] * 6
    assert [r.stored for r in again] == [True] * 6
    assert [r.rows for r in again] == [r.rows for r in first]
    assert len(log.read_text().splitlines()) == 6


def test_an_interruption_keeps_what_was_finished(tmp_path):
    log = tmp_path / "log"
    good = FakeCase("a", log=log)
    interrupted = [good, FakeCase("b", error=KeyboardInterrupt), FakeCase("c", log=log)]
    with pytest.raises(KeyboardInterrupt):
        list(run(tasks(interrupted, ["default"]), Store(tmp_path / "cache"), 1))
    resumed = [good, FakeCase("b", log=log), FakeCase("c", log=log)]
    results = list(run(tasks(resumed, ["default"]), Store(tmp_path / "cache"), 1))
    assert [r.stored for r in results] == [True, False, False]
    assert log.read_text().split() == ["a", "default", "b", "default", "c", "default"]


def test_several_processes_give_the_same(tmp_path):
    cases = [FakeCase(name, shape) for name, shape in (("a", 0.1), ("b", 0.2))]
    results = list(run(tasks(cases, ["default"]), Store(tmp_path), 2))
    assert {r.task.case.name: r.rows for r in results} == {
        case.name: case.rows("default", lambda _share: None) for case in cases
    }


def test_progress_is_told(tmp_path):
    told = []
    list(run(tasks([FakeCase("a")], ["default"]), Store(tmp_path), 1, lambda t, s: told.append((t.case.name, s))))
    assert told == [("a", 0.5), ("a", 1.0)]


def test_choosing_by_name():
    cases = [FakeCase(name) for name in ("srgb-weak", "srgb-strong", "linear-weak")]
    assert [c.name for c in choose(cases, None)] == ["srgb-weak", "srgb-strong", "linear-weak"]
    assert [c.name for c in choose(cases, "srgb-*")] == ["srgb-weak", "srgb-strong"]
    assert [c.name for c in choose(cases, "weak")] == ["srgb-weak", "linear-weak"]
    with pytest.raises(SettingError, match="known: srgb-weak"):
        choose(cases, "gamma")
