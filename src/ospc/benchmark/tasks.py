"""Runs cases and presets, those only that are not in the store yet."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from multiprocessing import get_context
from typing import TypeAlias

from ospc.benchmark.case import Case, Row
from ospc.benchmark.store import Store
from ospc.errors import SettingError


@dataclass(frozen=True)
class Task:
    """A case and the preset to run on it."""

    case: Case
    preset: str


@dataclass(frozen=True)
class Result:
    """What came of a task.

    Attributes
    ----------
    task
        The task.
    rows
        One a method.
    stored
        Whether it was in the store already.
    """

    task: Task
    rows: list[Row]
    stored: bool


OnShare: TypeAlias = Callable[[Task, float], None]
"""Called with the task that is under way and the share of it that is done."""


def choose(cases: Sequence[Case], pattern: str | None) -> list[Case]:
    """Return the cases whose name matches a pattern of shell wildcards, or contains one that has none.

    Raises
    ------
    SettingError
        If none matches.
    """
    if pattern is None:
        return list(cases)
    wild = pattern if any(c in pattern for c in "*?[") else f"*{pattern}*"
    chosen = [case for case in cases if fnmatchcase(case.name, wild)]
    if not chosen:
        raise SettingError(f"no case of the benchmark matches '{pattern}'; known: {', '.join(c.name for c in cases)}")
    return chosen


def run(
    tasks: Sequence[Task], store: Store, jobs: int, on_share: OnShare = lambda _task, _share: None
) -> Iterator[Result]:
    """Give the result of every task as it is finished: first what is stored, then what has to be computed.

    Every result is stored before it is given, so that an interruption loses only what was under way.

    Parameters
    ----------
    tasks
        What to run.
    store
        Where results are kept.
    jobs
        Number of processes; with 1 everything happens in this one.
    on_share
        Called while a task is under way, with one job only.
    """
    missing: list[Task] = []
    for task in tasks:
        rows = store.get(task.case, task.preset)
        if rows is None:
            missing.append(task)
        else:
            yield Result(task, rows, stored=True)
    for task, rows in _computed(missing, jobs, on_share):
        store.put(task.case, task.preset, rows)
        yield Result(task, rows, stored=False)


def _computed(tasks: Sequence[Task], jobs: int, on_share: OnShare) -> Iterable[tuple[Task, list[Row]]]:
    if jobs == 1 or len(tasks) < 2:
        for task in tasks:
            yield task, task.case.rows(task.preset, lambda share, task=task: on_share(task, share))  # type: ignore[misc]
        return
    # Leaving the block ends the processes, after an interruption too.
    with get_context("spawn").Pool(min(jobs, len(tasks)), _prepare) as pool:
        yield from pool.imap_unordered(_rows, tasks)


def _prepare() -> None:
    """Leave interruptions to the process that waits, and the other cores to the other processes."""
    import cv2

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)


def _rows(task: Task) -> tuple[Task, list[Row]]:
    return task, task.case.rows(task.preset, lambda _share: None)
