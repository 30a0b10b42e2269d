"""Limits on the threads of libraries; this program uses its own threads instead."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import cache

import cv2
from threadpoolctl import ThreadpoolController


@contextmanager
def one_library_thread() -> Iterator[None]:
    """Keep OpenCV and BLAS on one thread: images and matrices are too small to benefit from more."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with _libraries().limit(limits=1):
            yield
    finally:
        cv2.setNumThreads(before)


def one_blas_thread() -> AbstractContextManager[object]:
    """Keep BLAS on one thread."""
    limit: AbstractContextManager[object] = _libraries().limit(limits=1, user_api="blas")
    return limit


@cache
def _libraries() -> ThreadpoolController:
    # Searching the loaded libraries takes a millisecond, and a run needs it hundreds of times.
    return ThreadpoolController()
