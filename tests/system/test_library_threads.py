"""Limits on the threads of libraries: they hold until the last thread that needs them has left."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import cv2
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from ospc.system.library_threads import one_blas_thread, one_library_thread


def of_blas() -> set[int]:
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


@pytest.fixture(autouse=True)
def two_threads() -> Iterator[None]:
    for threads in (2, 1):  # as outside and inside the tests
        with ThreadPoolExecutor(1) as another:  # while it lives, no other thread may set limits
            another.submit(threadpool_limits, threads).result()
        cv2.setNumThreads(threads)
        if threads == 2:
            yield


@pytest.mark.parametrize("limit", [one_blas_thread, one_library_thread])
def test_a_limit_holds_until_the_last_thread_leaves(limit):
    before = of_blas(), cv2.getNumThreads()
    with ThreadPoolExecutor(1) as one, ThreadPoolExecutor(1) as other:
        first, second = one.submit(limit).result(), other.submit(limit).result()
        one.submit(first.__enter__).result()
        other.submit(second.__enter__).result()
        one.submit(first.__exit__, None, None, None).result()
        assert of_blas() <= {1}  # empty for a library whose threads cannot be limited
        other.submit(second.__exit__, None, None, None).result()
        assert (of_blas(), cv2.getNumThreads()) == before
