"""Runs tasks, several at a time, and stores each result as soon as it is there."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from typing import Any, Protocol, TypeAlias

from ospc.research.store import ResultStore

OnProgress: TypeAlias = Callable[[float], None]
"""Called now and then with the share of a task that is done."""


class Task(Protocol):
    """Something that takes long to compute. Tasks are pickled when several run at a time."""

    @property
    def name(self) -> str:
        """Its name, for people."""
        ...

    def describe(self) -> dict[str, Any]:
        """Return everything the result depends on, as JSON-compatible values."""
        ...

    def run(self, progress: OnProgress) -> Any:
        """Compute the result, of JSON-compatible values."""
        ...


@dataclass(frozen=True)
class Finished:
    """The result of a task, and whether it was in the store already."""

    task: Any
    result: Any
    stored: bool


OnShare: TypeAlias = Callable[[Task, float], None]
"""Called with the task under way and the share of it that is done."""


def run(
    tasks: Sequence[Task], store: ResultStore, jobs: int = 1, on_share: OnShare = lambda _task, _share: None
) -> Iterator[Finished]:
    """Give the result of every task: first the stored ones, then the others as they finish.

    Each result is stored before it is given, so an interruption loses only what is under way. Ending the iteration
    early ends all processes, and the programs they started. With one job everything runs in this process, and
    ``on_share`` is called while a task runs.
    """
    missing: list[tuple[Task, dict[str, Any]]] = []
    for task in tasks:
        description = task.describe()
        result = store.get(task.name, description)
        if result is None:
            missing.append((task, description))
        else:
            yield Finished(task, result, stored=True)
    for number, result in _computed([task for task, _ in missing], jobs, on_share):
        task, description = missing[number]
        store.put(task.name, description, result)
        yield Finished(task, result, stored=False)


def _computed(tasks: list[Task], jobs: int, on_share: OnShare) -> Iterable[tuple[int, Any]]:
    if jobs == 1 or len(tasks) < 2:
        for number, task in enumerate(tasks):
            yield number, task.run(partial(on_share, task))
        return
    pool = get_context("spawn").Pool(min(jobs, len(tasks)), _prepare)
    try:
        yield from pool.imap_unordered(_run, enumerate(tasks))
        # Terminated instead, a process that is just about to wait for its next task may miss the signal, and hang.
        pool.close()
    except BaseException:
        pool.terminate()
        raise
    finally:
        pool.join()


def _prepare() -> None:
    """Leave interruptions to the parent, end in good order when it says so, and use one core."""
    import cv2

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Exiting by an exception lets a task end the program that it started.
    signal.signal(signal.SIGTERM, lambda _signal, _frame: sys.exit(1))
    cv2.setNumThreads(1)


def _run(entry: tuple[int, Task]) -> tuple[int, Any]:
    number, task = entry
    return number, task.run(lambda _share: None)
