"""Work on a batch in processes of this machine."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Generator, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Protocol

from ospc.batch.work import Answer, Task, work

_PATIENCE_S = 5
"""Time an idle or terminated process gets to end before it is killed."""


class Runner(Protocol):
    """Does tasks, here or elsewhere."""

    def run(self, tasks: Iterable[Task]) -> Generator[Answer, None, None]:
        """Give the answers to tasks as they come, one to each, in no particular order."""
        ...


class ThisProcess:
    """Does one task after the other."""

    def run(self, tasks: Iterable[Task]) -> Generator[Answer, None, None]:
        """Give the answers in the order of the tasks."""
        yield from map(work, tasks)


@dataclass
class _Worker:
    process: SpawnProcess
    connection: Connection
    task: Task | None = None


@dataclass(frozen=True)
class Processes:
    """Does tasks in processes of this machine; one that dies takes only its own task with it."""

    count: int

    def run(self, tasks: Iterable[Task]) -> Generator[Answer, None, None]:
        """Give the answers as they come."""
        waiting, workers = iter(tasks), list[_Worker]()
        try:
            while True:
                self._hand_out(waiting, workers)
                busy = [worker for worker in workers if worker.task is not None]
                if not busy:
                    return
                ready = wait([worker.connection for worker in busy])
                for worker in busy:
                    if worker.connection in ready:
                        yield _answer_of(worker)
                        if not worker.process.is_alive():
                            workers.remove(worker)
        finally:
            for worker in workers:
                _end(worker)

    def _hand_out(self, waiting: Iterator[Task], workers: list[_Worker]) -> None:
        """Give every idle worker a task, and start workers as long as there are tasks for them."""
        while True:
            idle = next((worker for worker in workers if worker.task is None), None)
            if idle is None and len(workers) >= self.count:
                return
            task = next(waiting, None)
            if task is None:
                return
            if idle is None:
                idle = _started()
                workers.append(idle)
            idle.task = task
            with suppress(OSError):  # a worker that died meanwhile is noticed when its answer is awaited
                idle.connection.send(task)


def _started() -> _Worker:
    # A fresh interpreter, because libraries with threads do not survive a fork.
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_serve, args=(there,), daemon=True)
    process.start()
    there.close()
    return _Worker(process, here)


def _serve(connection: Connection) -> None:
    """Answer tasks until there are no more."""
    # Ctrl-C reaches all processes of a terminal, but only the one that hands out work must act on it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(EOFError, OSError):
        while True:
            connection.send(work(connection.recv()))


def _answer_of(worker: _Worker) -> Answer:
    task, worker.task = worker.task, None
    assert task is not None
    try:
        answer: Answer = worker.connection.recv()
    except (EOFError, OSError):
        worker.process.join()
        return Answer(task.number, error=f"the process that worked on it died ({_death(worker.process.exitcode)})")
    return answer


def _death(exitcode: int | None) -> str:
    if exitcode is None or exitcode >= 0:
        return f"exit code {exitcode}"
    with suppress(ValueError):
        name = signal.Signals(-exitcode).name
        return f"{name}, perhaps for lack of memory" if name == "SIGKILL" else name
    return f"signal {-exitcode}"


def _end(worker: _Worker) -> None:
    worker.connection.close()
    if worker.task is not None:
        worker.process.terminate()
    worker.process.join(_PATIENCE_S)
    if worker.process.is_alive():
        worker.process.kill()
        worker.process.join()


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
