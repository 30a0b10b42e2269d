"""Results are stored, found only under their own description, and survive interruptions."""

from __future__ import annotations

import json

import pytest
from fake_tasks import deadly_task, fake_task

from ospc.errors import FrameError, OspcError, SettingError
from ospc.research import runner as runner_module
from ospc.research.runner import ResultStore, key_of, made_with, run
from ospc.research.source import loaded


def test_what_is_stored_is_found_only_under_its_description(tmp_path):
    store = ResultStore(tmp_path / "cache")
    assert store.get("a", {"x": 1}) is None
    path = store.put("a", {"x": 1}, [0.1, float("inf"), None])
    assert store.get("a", {"x": 1}) == [0.1, float("inf"), None]
    assert store.get("a", {"x": 2}) is None
    assert store.get("b", {"x": 1}) is None
    assert json.loads(path.read_text())["depends_on"] == {"x": 1}


def test_the_order_of_a_description_does_not_matter():
    assert key_of({"x": 1, "y": [2]}) == key_of({"y": [2], "x": 1})
    assert key_of({"x": 1, "y": [2]}) != key_of({"x": 1, "y": [3]})


def test_names_cannot_leave_the_folder(tmp_path):
    store = ResultStore(tmp_path / "cache")
    for name in ("../x", "/etc/x", "..", "a\\b", "x" * 1000):
        assert store.put(name, {}, 1).parent == tmp_path / "cache"
        assert store.get(name, {}) == 1


def test_results_depend_on_the_source_that_makes_them_and_on_libraries(tmp_path, monkeypatch):
    package = tmp_path / "package"
    for part in ("estimation", "cli"):
        (package / part).mkdir(parents=True)
        (package / part / "a.py").write_text("1")
    monkeypatch.setattr(runner_module.ospc, "__file__", str(package / "__init__.py"))

    def hashed(**options):
        runner_module.source_hash.cache_clear()
        return made_with(**options)["source"]

    before, whole_before = hashed(), hashed(whole=True)
    (package / "cli" / "a.py").write_text("2")
    assert hashed() == before
    assert hashed(whole=True) != whole_before
    (package / "estimation" / "a.py").write_text("2")
    assert hashed() != before
    assert {"ospc", "numpy", "scipy", "opencv"} <= set(made_with())
    monkeypatch.undo()
    runner_module.source_hash.cache_clear()


@pytest.mark.parametrize("content", ["", "{", "[]", "{}", '{"schema": "other"}', "[" * 10_000])
def test_damaged_files_count_as_missing(tmp_path, content):
    store = ResultStore(tmp_path)
    store.put("a", {}, []).write_text(content)
    assert store.get("a", {}) is None


def test_a_folder_that_cannot_be_made_is_an_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(SettingError, match="cannot be written"):
        ResultStore(tmp_path / "file" / "cache").put("a", {}, [])


def test_stored_results_are_not_computed_again(tmp_path):
    log = tmp_path / "log"
    tasks = [fake_task(name, log=log) for name in "abc"]
    first, again = (list(run(tasks, ResultStore(tmp_path / "cache"))) for _ in range(2))
    assert again == first
    assert log.read_text().split() == ["a", "b", "c"]


def test_an_interruption_keeps_finished_tasks(tmp_path):
    log = tmp_path / "log"
    good = fake_task("a", log=log)
    interrupted = [good, fake_task("b", error=KeyboardInterrupt), fake_task("c", log=log)]
    with pytest.raises(KeyboardInterrupt):
        list(run(interrupted, ResultStore(tmp_path / "cache")))
    resumed = [good, fake_task("b", log=log), fake_task("c", log=log)]
    results = list(run(resumed, ResultStore(tmp_path / "cache")))
    assert len(results) == 3
    assert log.read_text().split() == ["a", "b", "c"]


def test_several_processes_give_the_same(tmp_path):
    tasks = [fake_task(name, shape) for name, shape in (("a", 0.1), ("b", 0.2))]
    results = list(run(tasks, ResultStore(tmp_path), 2))
    assert {task.name: result for task, result in results} == {
        task.name: task.compute(lambda _share: None) for task in tasks
    }
    assert {row.figures["response_shape_rmse"] for _, result in results for row in loaded(result)} == {0.1, 0.2}


def test_a_process_that_dies_ends_the_study_with_a_reason(tmp_path):
    """A pool of processes would wait for its result for ever."""
    with pytest.raises(OspcError, match=r"deadly: the process that worked on it died \(SIGKILL"):
        list(run([deadly_task(), deadly_task()], ResultStore(tmp_path), 2))


def test_errors_in_other_processes_are_raised(tmp_path):
    with pytest.raises(FrameError, match="torn"):
        list(run([fake_task(name, error=FrameError("torn")) for name in "ab"], ResultStore(tmp_path), 2))


def test_progress_is_reported(tmp_path):
    told = []
    list(run([fake_task("a")], ResultStore(tmp_path), 1, lambda task, share: told.append((task.name, share))))
    assert told == [("a", 0.5), ("a", 1.0)]
