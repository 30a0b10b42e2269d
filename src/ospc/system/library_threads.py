"""Limits on the threads of libraries; this program uses its own threads instead."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import cache, partial
from threading import Lock
from typing import Any

import cv2
from threadpoolctl import ThreadpoolController


class _Limit(AbstractContextManager[None]):
    """A limit of the whole process, lifted when the last of the threads inside leaves.

    The first to leave would lift it for the others, too, whose results would then differ in the last bits.
    ``impose`` sets the limit, and returns the function that lifts it.
    """

    def __init__(self, impose: Callable[[], Callable[[], object]]) -> None:
        self._impose, self._inside, self._lock = impose, 0, Lock()

    def __enter__(self) -> None:
        with self._lock:
            if not self._inside:
                self._lift = self._impose()
            self._inside += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._inside -= 1
            if not self._inside:
                self._lift()


def _impose_on_opencv() -> Callable[[], object]:
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    return partial(cv2.setNumThreads, before)


def _impose_on_blas() -> Callable[[], object]:
    limit = _changed(partial(_libraries().limit, limits=1, user_api="blas"))
    return partial(_changed, limit.restore_original_limits)


def _changed(change: Callable[[], Any]) -> Any:
    """Change the limits of BLAS; any thread may then change them, which threadpoolctl 3.8 keeps to the first one."""
    found = change()
    for library in _libraries().lib_controllers:
        if hasattr(library, "clear_controlling_thread"):
            library.clear_controlling_thread(force=True)
    return found


@cache
def _libraries() -> ThreadpoolController:
    # Searching the loaded libraries takes a millisecond, and a run needs it hundreds of times.
    return ThreadpoolController()


_ON_OPENCV, _ON_BLAS = _Limit(_impose_on_opencv), _Limit(_impose_on_blas)


@contextmanager
def one_library_thread() -> Iterator[None]:
    """Keep OpenCV and BLAS on one thread: images and matrices are too small to benefit from more."""
    with _ON_OPENCV, _ON_BLAS:
        yield


def one_blas_thread() -> AbstractContextManager[None]:
    """Keep BLAS on one thread."""
    return _ON_BLAS
