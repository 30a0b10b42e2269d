"""Random access to the images of a bag, in memory that does not grow with their number."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from ospc.errors import FrameError, escaped
from ospc.recording.bags.bag import Bag
from ospc.recording.bags.container import Message, Topic

_READ_ON = 64
"""Images further ahead than this are searched for by time instead of reading all messages up to them."""


class ImageStream:
    """Messages of one topic by number: going forward reads on, going back searches by time.

    Threads may share it; their reads are serialised.

    Parameters
    ----------
    bag
        The bag.
    topic
        The topic.
    log_ns
        When each of its messages was recorded in nanoseconds, in reading order, shape (messages,).
    """

    def __init__(self, bag: Bag, topic: Topic, log_ns: npt.NDArray[np.int64]) -> None:
        self._bag = bag
        self._topic = topic
        self._log_ns = log_ns
        self._rank = _ranks(log_ns)
        self._lock = threading.Lock()
        self._messages: Iterator[Message] | None = None
        self._passed: Counter[int] = Counter()
        self._next = 0

    def read(self, index: int) -> bytes:
        """Return a message by its number.

        Raises
        ------
        FrameError
            If the bag has changed since.
        RecordingError
            If it is damaged.
        """
        with self._lock:
            if self._messages is None or not 0 <= index - self._next < _READ_ON:
                self._start(index)
            data = self._advance_to(index)
            if data is None:
                self._start(index)
                data = self._advance_to(index)
            if data is None:
                raise FrameError(
                    f"{self._bag.path}: image {index} of {escaped(self._topic.name)} is missing; the bag has changed"
                )
            self._next = index + 1
            return data

    def _start(self, index: int) -> None:
        self._passed = Counter()
        self._messages = self._bag.messages((self._topic.name,), int(self._log_ns[index]))

    def _advance_to(self, index: int) -> bytes | None:
        wanted, rank = int(self._log_ns[index]), int(self._rank[index])
        for message in self._messages or ():
            if message.log_ns == wanted:
                self._passed[wanted] += 1
                if self._passed[wanted] == rank + 1:
                    return message.data
        self._messages = None
        return None


def _ranks(log_ns: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return for each message how many earlier ones were recorded at the same time."""
    order = np.argsort(log_ns, kind="stable")
    _, start, count = np.unique(log_ns[order], return_index=True, return_counts=True)
    rank = np.empty(len(log_ns), np.int64)
    rank[order] = np.arange(len(log_ns)) - np.repeat(start, count)
    return rank
