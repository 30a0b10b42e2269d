"""Times of the messages of a bag, by which exposures and gains are matched to images."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ospc.arrays import FloatArray, IntArray, nearest
from ospc.errors import ExposureError, RecordingError, counted
from ospc.recording.bags.bag import Bag
from ospc.recording.bags.carriers import Carrier
from ospc.recording.bags.container import Topic
from ospc.recording.bags.image_messages import read_stamp_ns
from ospc.recording.bags.messages import DamagedMessageError

_LEAST_SHARE = 0.5
"""Minimum share of the images that must have an exposure; with fewer, the time stamps are wrong."""

_ONLY_IMAGE_TOLERANCE_NS = 5e8
"""Largest time between an exposure and a single image, which has no frame interval."""

_EQUAL_NS = 1e3
"""Largest difference of equal time stamps: those of lists are read as floating-point seconds, today to 0.2 µs."""


@dataclass(frozen=True)
class Times:
    """Time stamps of messages, 0 if they have none, and the times at which they were recorded, shape (messages,)."""

    stamp_ns: IntArray
    log_ns: IntArray


Carried = tuple[Times, FloatArray]
"""Times of the messages of a carrier, and their exposures and gains, shape (2, messages)."""


def read_through(bag: Bag, images: Topic, carriers: Sequence[Carrier] = ()) -> tuple[Times, list[Carried]]:
    """Return the times of images, and what the messages of each carrier say, in one pass through a bag.

    Raises
    ------
    RecordingError
        If a message is damaged, or there are no images.
    """
    times, topic = array("q"), images  # a time stamp and a time of recording for each message
    carried = [(array("q"), array("d")) for _ in carriers]  # the same, and an exposure and a gain
    try:
        reading = [carrier.readings() for carrier in carriers]
        for message in bag.messages({images.name, *(carrier.topic.name for carrier in carriers)}):
            if message.topic == images.name:
                topic = images
                times.extend((read_stamp_ns(message.data, images), message.log_ns))
            for carrier, read, (at, said) in zip(carriers, reading, carried, strict=True):
                if message.topic == carrier.topic.name:
                    topic = carrier.topic
                    if (found := read(message.data)) is not None:
                        at.extend((found[2], message.log_ns))
                        said.extend(found[:2])
    except (DamagedMessageError, OverflowError) as error:
        raise RecordingError(f"{bag.path}: a message of {topic.name} cannot be read: {error}") from None
    if not times:
        raise RecordingError(f"{bag.path}: {images.name} has no images; choose another topic with --image-topic")
    values = [np.array(said, dtype=np.float64).reshape(-1, 2).T for _, said in carried]
    return _times(times), [(_times(at), said) for (at, _), said in zip(carried, values, strict=True)]


def _times(pairs: array[int]) -> Times:
    return Times(*np.array(pairs, dtype=np.int64).reshape(-1, 2).T.copy())


def match_times(images: Times, exposures: Times, source: str, what: str = "exposure") -> tuple[IntArray, list[str]]:
    """Return the index of each image's exposure, -1 for none, (images,), and notes; ``what`` it is for messages.

    Raises
    ------
    ExposureError
        If few images have one.
    """
    # Time stamps of the camera take precedence. If they are missing or come from different clocks, the times at which
    # the messages were recorded are used.
    ways = [("time of recording", images.log_ns, exposures.log_ns)]
    if np.all(images.stamp_ns > 0) and np.all(exposures.stamp_ns > 0):
        ways.insert(0, ("time stamp", images.stamp_ns, exposures.stamp_ns))
    for way, wanted, offered in ways:
        found, tolerance_ns = _nearest(wanted, offered)
        known = int(np.count_nonzero(found >= 0))
        if known >= _LEAST_SHARE * len(found):
            notes = [] if way == "time stamp" else [f"{source}: {what}s are matched to images by {way}"]
            if known < len(found):
                equal = tolerance_ns <= _EQUAL_NS
                near = "has the same time stamp" if equal else f"is within {tolerance_ns / 1e6:.3g} ms"
                notes.append(
                    f"{source}: {len(found) - known} of {counted(len(found), 'image')} left out, because no {what} "
                    f"{near}"
                )
            return found, notes
    raise ExposureError(
        f"{source}: has {what}s for only {known} of {counted(len(found), 'image')}; record the {what} with the time "
        f"stamp of every image"
    )


def _nearest(wanted: IntArray, offered: IntArray) -> tuple[IntArray, float]:
    """Return the index of the nearest time, -1 if it is further than half a frame interval, and this tolerance.

    It is that of equal times if most are: then the others belong to images that were not recorded.
    """
    order = np.argsort(offered, kind="stable")
    times = offered[order]
    nearer = nearest(times, wanted)
    distance = np.abs(times[nearer] - wanted)
    steps = np.diff(np.sort(wanted))
    tolerance_ns = float(np.median(steps)) / 2 if len(steps) else _ONLY_IMAGE_TOLERANCE_NS
    if np.count_nonzero(distance <= _EQUAL_NS) >= _LEAST_SHARE * len(wanted):
        tolerance_ns = _EQUAL_NS
    found = np.where(distance <= tolerance_ns, order[nearer], -1)
    return found.astype(np.int64), tolerance_ns


def without_steps_back(times: Times, messages: IntArray, path: str) -> tuple[IntArray, IntArray, list[str]]:
    """Return the messages later than all before them, their time stamps in nanoseconds, and notes on the others."""
    stamps_ns, notes = times.stamp_ns[messages], []
    if np.any(stamps_ns <= 0):
        stamps_ns = times.log_ns[messages]
        notes.append(f"{path}: some images have no time stamp; using the times at which they were recorded")
    latest = np.maximum.accumulate(stamps_ns)
    later = np.append(True, stamps_ns[1:] > latest[:-1])[: len(messages)]
    if not later.all():
        count = int(np.count_nonzero(~later))
        notes.append(f"{path}: {counted(count, 'image')} left out, because time stamps do not increase")
    return messages[later], stamps_ns[later], notes
