"""Process a stream in a few threads, with a bounded number of items in memory."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

_MOST_WORKERS = 8
"""More threads only hold more images in memory: writing to disk is the limit."""


def default_workers() -> int:
    """Return how many threads to use: one per processor, up to a few."""
    return min(os.cpu_count() or 1, _MOST_WORKERS)


def mapped(
    work: Callable[[Item], Result], items: Iterable[Item], workers: int | None = None, ahead: int = 2
) -> Iterator[Result]:
    """Yield the results of ``work`` in the order of the items, which only the calling thread draws.

    Parameters
    ----------
    work
        Called in other threads.
    items
        At most ``workers + ahead`` are drawn before their results are yielded, which bounds the memory.
    workers
        Number of threads; :func:`default_workers` if None.
    ahead
        Number of items that may wait for a thread.

    Raises
    ------
    BaseException
        Whatever drawing or processing an item raised, after the work in progress is finished; the rest is dropped.
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
