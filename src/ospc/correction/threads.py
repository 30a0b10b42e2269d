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


def mapped(
    work: Callable[[Item], Result], items: Iterable[Item], workers: int | None = None, ahead: int = 2
) -> Iterator[Result]:
    """Yield the results of ``work``, called in other threads, in the order of the items.

    There is one thread per processor, up to a few, unless ``workers`` says how many. Only the calling thread draws
    items, at most ``workers + ahead`` before their results are yielded, which bounds the memory. An error of the work
    or of the items is raised after the work in progress is finished; the rest is dropped.
    """
    count = workers or min(os.cpu_count() or 1, _MOST_WORKERS)
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
