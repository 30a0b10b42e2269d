"""Threads of the libraries, of which this program needs none: it has its own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import cache

import cv2
from threadpoolctl import ThreadpoolController


@contextmanager
def one_library_thread() -> Iterator[None]:
    """Keep OpenCV and the linear algebra from using threads: images and matrices are small, and threads only wait."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with _libraries().limit(limits=1):
            yield
    finally:
        cv2.setNumThreads(before)


def one_blas_thread() -> AbstractContextManager[object]:
    """Keep the linear algebra from using threads."""
    limit: AbstractContextManager[object] = _libraries().limit(limits=1, user_api="blas")
    return limit


@cache
def _libraries() -> ThreadpoolController:
    # Looking through all libraries that are loaded takes a millisecond, and a run does it hundreds of times.
    return ThreadpoolController()
