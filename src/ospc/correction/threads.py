"""Work on a stream in a few threads, with a bounded number of items in flight."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

_MOST_WORKERS = 8


def default_workers() -> int:
    """Return how many threads to use: one for each processor, few enough that the images in flight are few."""
    return min(os.cpu_count() or 1, _MOST_WORKERS)


def mapped(
    work: Callable[[Item], Result], items: Iterable[Item], workers: int | None = None, ahead: int = 2
) -> Iterator[Result]:
    """Give the results of ``work`` in the order of the items, which are drawn by the calling thread alone.

    Parameters
    ----------
    work
        Called in other threads.
    items
        Drawn at most ``workers + ahead`` before their result is given, which bounds what is in memory.
    workers
        Number of threads; :func:`default_workers` where None.
    ahead
        Items that wait for a thread.

    Raises
    ------
    BaseException
        What drawing an item or working on it raised; work that has begun is finished before, the rest is dropped.
    """
    count = workers or default_workers()
    pending: deque[Future[Result]] = deque()
    pool = ThreadPoolExecutor(count)
    try:
        for item in items:
            pending.append(pool.submit(work, item))
            if len(pending) >= count + ahead:
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
