"""Images of a bag by their number; memory does not depend on how many there are."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from ospc.errors import FrameError
from ospc.recording.bags.bag import Bag
from ospc.recording.bags.container import Message, Topic
from ospc.recording.wording import escaped

_READ_ON = 64
"""Images farther ahead than this are gone to directly instead of reading what lies between."""


class ImageStream:
    """Messages of one topic; going forward reads on, going back starts where it must.

    Threads may read at the same time, one after the other.

    Parameters
    ----------
    bag
        The bag.
    topic
        The topic.
    log_ns
        When each of its messages was recorded, in the order they are read, shape (messages,).
    """

    def __init__(self, bag: Bag, topic: Topic, log_ns: npt.NDArray[np.int64]) -> None:
        self._bag = bag
        self._topic = topic
        self._log_ns = log_ns
        self._rank = _ranks(log_ns)
        self._lock = threading.Lock()
        self._messages: Iterator[Message] | None = None
        self._seen: Counter[int] = Counter()
        self._next = 0

    def read(self, index: int) -> bytes:
        """Return a message by its number.

        Raises
        ------
        FrameError
            If the bag has changed meanwhile.
        RecordingError
            If it is damaged.
        """
        with self._lock:
            if self._messages is None or not 0 <= index - self._next < _READ_ON:
                self._start(index)
            data = self._go_to(index)
            if data is None:
                self._start(index)
                data = self._go_to(index)
            if data is None:
                raise FrameError(
                    f"{self._bag.path}: image {index} of {escaped(self._topic.name)} is not there any more"
                )
            self._next = index + 1
            return data

    def _start(self, index: int) -> None:
        self._seen = Counter()
        self._messages = self._bag.messages((self._topic.name,), int(self._log_ns[index]))

    def _go_to(self, index: int) -> bytes | None:
        wanted, rank = int(self._log_ns[index]), int(self._rank[index])
        for message in self._messages or ():
            if message.log_ns == wanted:
                self._seen[wanted] += 1
                if self._seen[wanted] == rank + 1:
                    return message.data
        self._messages = None
        return None


def _ranks(log_ns: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return how many earlier messages were recorded at the same time as each."""
    order = np.argsort(log_ns, kind="stable")
    _, start, count = np.unique(log_ns[order], return_index=True, return_counts=True)
    rank = np.empty(len(log_ns), np.int64)
    rank[order] = np.arange(len(log_ns)) - np.repeat(start, count)
    return rank
