"""Run a batch on a Dask cluster, on workers that can read the recordings, and survive lost workers."""

from __future__ import annotations

import os
import time
from collections.abc import Generator, Iterable, Iterator
from dataclasses import dataclass, field
from importlib import import_module
from itertools import islice
from typing import Any
from uuid import uuid4

import ospc
from ospc.batch.work import Answer, Task, work
from ospc.errors import SettingError, message_of, needs_extra, one_line

_TASKS_PER_THREAD, _FEWEST_IN_FLIGHT = 4, 16
"""Number of tasks in flight: enough to keep all workers busy, few enough for the scheduler's memory."""

_LOOK_EVERY_S = 1.0
"""How often to check whether workers came or went."""

_CONNECT_S = 15.0
"""How long the scheduler may take to answer."""


def on_cluster(tasks: Iterable[Task], address: str, patience_s: float = 300.0) -> Generator[Answer, None, None]:
    """Yield the answers from the workers of the Dask scheduler at an address such as ``tcp://10.0.0.1:8786``.

    Workers need the same version of this package and see the recordings under the same paths; a recording that only
    some of them can read goes to one of these. If a worker is lost, its task goes to another one; after three lost
    workers the task fails. If there is no worker, the run waits up to ``patience_s`` seconds for one.
    """
    with needs_extra("working on a Dask cluster", "cluster"):
        distributed: Any = import_module("distributed")
    try:
        client = distributed.Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise SettingError(f"{address}: no Dask scheduler answers there ({message_of(error)})") from None
    try:
        yield from _Run(distributed, client, address, patience_s).answers(iter(tasks))
    finally:
        client.close()


@dataclass
class _Run:
    """One run over tasks; each pending task is stored with the workers it is restricted to, if any."""

    distributed: Any
    client: Any
    address: str
    patience_s: float
    pending: dict[Any, tuple[Task, frozenset[str]]] = field(default_factory=dict)
    _checked: set[str] = field(default_factory=set)

    def answers(self, waiting: Iterator[Task]) -> Generator[Answer, None, None]:
        """Yield the answers as they arrive."""
        while True:
            threads = self._workers()
            room = max(_FEWEST_IN_FLIGHT, _TASKS_PER_THREAD * sum(threads.values())) - len(self.pending)
            self._hand_out(list(islice(waiting, max(room, 0))), threads)
            if not self.pending:
                return
            try:
                with self.client.as_current():
                    found = self.distributed.wait([*self.pending], _LOOK_EVERY_S, return_when="FIRST_COMPLETED")
            except (TimeoutError, self.distributed.TimeoutError):
                self._rescue(threads)
                continue
            for future in set(found.done):
                task, _ = self.pending.pop(future)
                yield self._answer(future, task)

    def _workers(self) -> dict[str, int]:
        """Return the number of threads of each worker; wait if there are no workers."""
        begun_s = time.monotonic()
        while True:
            threads = self._asked()
            if threads:
                self._check_versions(set(threads))
                return threads
            if time.monotonic() - begun_s > self.patience_s:
                raise SettingError(
                    f"{self.address}: the scheduler has no workers; start some, such as: dask worker {self.address}"
                )
            time.sleep(_LOOK_EVERY_S)

    def _asked(self) -> dict[str, int]:
        try:
            return dict(self.client.nthreads())
        except (OSError, TimeoutError, self.distributed.comm.CommClosedError) as error:
            raise SettingError(
                f"{self.address}: the connection to the scheduler is lost ({error}); run the command again "
                "to continue"
            ) from None

    def _check_versions(self, workers: set[str]) -> None:
        new = workers - self._checked
        if not new:
            return
        for worker, found in self.client.run(_version, workers=sorted(new), on_error="return").items():
            if isinstance(found, Exception):
                if worker not in self._asked():
                    continue  # it was lost a moment ago
                raise SettingError(f"{worker}: cannot run a task ({found}); is ospc installed there?")
            if found != ospc.__version__:
                raise SettingError(
                    f"{worker}: has ospc {found}, but this is {ospc.__version__}; install the same version"
                )
            self._checked.add(worker)

    def _hand_out(self, tasks: list[Task], threads: dict[str, int]) -> None:
        readable = self._readable(tasks)
        for task in tasks:
            can = frozenset(worker for worker, numbers in readable.items() if task.number in numbers)
            # If no worker can read it, any may try and report why; if all can, so can workers that join later.
            restricted = bool(can) and len(can) < len(threads)
            where = {"workers": sorted(can), "allow_other_workers": False} if restricted else {}
            future = self.client.submit(work, task, key=f"ospc-{uuid4()}", pure=False, **where)
            self.pending[future] = task, can if restricted else frozenset()

    def _readable(self, tasks: list[Task]) -> dict[str, set[int]]:
        """Return for each worker the numbers of the tasks whose recordings it can read."""
        remote = {task.number for task in tasks if task.entry.is_remote}
        paths = {task.number: task.entry.recording for task in tasks if task.number not in remote}
        if not paths:
            return {}
        answers = self.client.run(_readable_of, paths, on_error="return").items()
        return {worker: remote.union(found) for worker, found in answers if not isinstance(found, Exception)}

    def _rescue(self, threads: dict[str, int]) -> None:
        """Hand out again the tasks whose workers are all lost."""
        lost = [future for future, (_, may) in self.pending.items() if may and may.isdisjoint(threads)]
        tasks = [self.pending.pop(future)[0] for future in lost]
        for future in lost:
            future.cancel()
        self._hand_out(tasks, threads)

    def _answer(self, future: Any, task: Task) -> Answer:
        try:
            answer: Answer = future.result()
        except self.distributed.KilledWorker as error:
            return Answer(task.number, error=f"the workers that ran it died, the last one at {error.last_worker}")
        except Exception as error:  # any error affects this recording only
            return Answer(task.number, error=one_line(error))
        return answer


def _version() -> str:
    return ospc.__version__


def _readable_of(paths: dict[int, str]) -> list[int]:
    return [number for number, path in paths.items() if os.access(path, os.R_OK)]
