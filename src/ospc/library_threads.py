"""Threads of the libraries, of which this program needs none: it has its own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import cv2
from threadpoolctl import threadpool_limits


@contextmanager
def one_library_thread() -> Iterator[None]:
    """Keep OpenCV and the linear algebra from using threads: images and matrices are small, and threads only wait."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with threadpool_limits(1):
            yield
    finally:
        cv2.setNumThreads(before)
