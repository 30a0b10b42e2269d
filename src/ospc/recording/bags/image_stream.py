"""Random access to the images of a bag, in memory that does not grow with their number."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from ospc.errors import FrameError, RecordingError, escaped
from ospc.recording.bags.bag import Bag
from ospc.recording.bags.container import Message, Topic
from ospc.recording.bags.image_messages import read_image
from ospc.recording.bags.messages import DamagedMessageError
from ospc.recording.channel import Channel
from ospc.recording.pixel_layout import StoredImage

_READ_ON = 64
"""Images further ahead than this are searched for by time instead of reading all messages up to them."""


class ImageStream:
    """Messages of one topic by number: going forward reads on, going back searches by time.

    Threads may share it; their reads are serialised.

    Parameters
    ----------
    bag, topic
        The bag and the topic with the images.
    log_ns
        When each message of the topic was recorded in nanoseconds, in reading order, shape (messages,).
    channel
        Channel taken from colour images; luma if None.
    """

    def __init__(self, bag: Bag, topic: Topic, log_ns: npt.NDArray[np.int64], channel: Channel | None) -> None:
        self._bag, self._topic, self._log_ns, self._channel = bag, topic, log_ns, channel
        self._rank = _ranks(log_ns)
        self._lock = threading.Lock()
        self._messages: Iterator[Message] | None = None
        self._passed: Counter[int] = Counter()
        self._next = 0

    def again(self) -> ImageStream:
        """Return a stream of the same images with a position of its own."""
        return ImageStream(self._bag, self._topic, self._log_ns, self._channel)

    def label(self, number: int) -> str:
        """Return the name of an image in messages."""
        return f"{escaped(self._topic.name)}[{number}]"

    def image(self, number: int) -> StoredImage:
        """Return the image in a message; FrameError if it cannot be read."""
        label, data = self.label(number), self.read(number)
        try:
            return read_image(data, self._topic.type, self._topic.encoding, label, self._channel)
        except DamagedMessageError as error:
            raise FrameError(f"{label}: {error}; leave it out") from None

    def read(self, number: int) -> bytes:
        """Return a message; FrameError if the bag is damaged there or has changed since."""
        with self._lock:
            try:
                if self._messages is None or not 0 <= number - self._next < _READ_ON:
                    self._start(number)
                data = self._advance_to(number)
                if data is None:
                    self._start(number)
                    data = self._advance_to(number)
            except RecordingError as error:
                raise FrameError(str(error)) from None
            if data is None:
                raise FrameError(f"{self._bag.path}: image {self.label(number)} is missing; the bag has changed")
            self._next = number + 1
            return data

    def _start(self, number: int) -> None:
        self._passed = Counter()
        self._messages = self._bag.messages((self._topic.name,), int(self._log_ns[number]))

    def _advance_to(self, number: int) -> bytes | None:
        wanted, rank = int(self._log_ns[number]), int(self._rank[number])
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
