"""ROS 1 and ROS 2 bags with a topic for images and a topic for exposures."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from ospc.arrays import FloatArray, Image, IntArray, nearest, read_only
from ospc.errors import ExposureError, RecordingError, counted, escaped, listed
from ospc.recording.bags.bag import Bag, exposure_topic, image_topic, image_topics, is_bag, own_exposure_topic
from ospc.recording.bags.carriers import Carrier, carrier_of
from ospc.recording.bags.container import Topic
from ospc.recording.bags.image_messages import ImageStream, read_stamp_ns
from ospc.recording.bags.messages import NS_PER_S, DamagedMessageError
from ospc.recording.exposure_lists import read_list
from ospc.recording.exposure_units import ExposureUnit, GainUnit, infer_unit
from ospc.recording.frame import Frame
from ospc.recording.frame_table import FrameTable, checked_exposures, unlisted
from ospc.recording.list_search import names_exposures
from ospc.recording.options import DEFAULT, ReadingOptions
from ospc.recording.pixel_layout import PixelLayout, find_layout
from ospc.recording.recording import StoredRecording

_NS_PER_MS = 1e6
"""Nanoseconds, the unit of stamps in bags, per millisecond."""

_LEAST_SHARE = 0.5
"""Minimum share of the images that must have an exposure; with fewer, the time stamps are wrong."""

_ONLY_IMAGE_TOLERANCE_NS = 5e8
"""Largest time between an exposure and a single image, which has no frame interval."""


class _Rosbag:
    name = "rosbag"

    def recognises(self, path: Path) -> bool:
        return is_bag(path)

    def open(self, path: Path, options: ReadingOptions = DEFAULT) -> _BagRecording:
        bag = Bag.at(path)
        topic, notes = image_topic(bag, options)
        if len(bag.files) > 1:
            joined = listed([file.path.name for file in bag.files])
            notes.append(f"{path}: {len(bag.files)} bags are read as one recording: {joined}")
        try:
            if options.exposure_topic is None and names_exposures(bag.exposure_list):
                log_ns, numbers, table = _listed(bag, topic, read_list(bag.exposure_list, options))
            else:
                carrying = exposure_topic(bag, topic, options)
                carrier = carrier_of(carrying, options, f"{path}: {carrying.name}")
                log_ns, numbers, table = _exposed(bag, topic, carrier)
        except ExposureError:
            if not options.unknown_exposures:
                raise
            log_ns, numbers, table = _unexposed(bag, topic)
        images = ImageStream(bag, topic, log_ns, options.channel)
        sampled = images.again()  # a stream keeps its file open and part of it in memory
        layout, pixel_notes = find_layout(
            lambda i: sampled.image(int(numbers[i])),
            table.exposures_ms,
            f"{path}: {escaped(topic.name)}",
            options,
            take_green=True,
        )
        return _BagRecording(
            path=path,
            kind=self.name,
            size=layout.size,
            max_grey=layout.depth.max_grey,
            exposures_ms=table.exposures_ms,
            stamps_s=table.stamps_s,
            notes=(*notes, *table.notes, *pixel_notes),
            channel=options.channel,
            images=images,
            layout=layout,
            numbers=numbers,
        )

    def cameras(self, path: Path, options: ReadingOptions) -> dict[str, tuple[Path, ReadingOptions]]:
        bag = Bag.at(path)
        topics = image_topics(bag) if options.image_topic is None else []
        cameras = _camera_names(topics or [image_topic(bag, options)[0]])
        found = {}
        for name, topic in cameras.items():
            exposures = options.exposure_topic
            if exposures is not None:
                exposures = own_exposure_topic(bag, exposures, topic, list(cameras.values()))
            found[name] = path, replace(options, image_topic=topic.name, exposure_topic=exposures)
        return found


@dataclass(frozen=True, eq=False, kw_only=True)
class _BagRecording(StoredRecording):
    """``numbers`` are the message numbers of the frames, shape (frames,)."""

    images: ImageStream = field(repr=False)
    layout: PixelLayout
    numbers: IntArray = field(repr=False)

    def __iter__(self) -> Iterator[Frame]:
        stream = self.images.again()  # the frames share one pass through the bag
        for index, number in enumerate(self.numbers.tolist()):
            yield self._frame(index, stream.label(number), partial(self._load, stream, number))

    def stored_bytes(self, index: int) -> bytes:
        return self.images.again().read(int(self.numbers[index]))

    def _load(self, stream: ImageStream, number: int) -> Image:
        return self.layout.grey(stream.image(number).pixels, stream.label(number))


def _camera_names(topics: Sequence[Topic]) -> dict[str, Topic]:
    """Name cameras after their topics: ``/cam0/image_raw`` is ``cam0`` unless another topic has the same name."""
    parts = [topic.name.strip("/").split("/") for topic in topics]
    named = [[part for part in own if not part.startswith("image") and part != "compressed"] for own in parts]
    short = ["_".join(name or own) for name, own in zip(named, parts, strict=True)]
    names = [name if short.count(name) == 1 else "_".join(own) for name, own in zip(short, parts, strict=True)]
    return dict(zip(names, topics, strict=True))


@dataclass(frozen=True)
class _Times:
    """Time stamps of messages, 0 if they have none, and the times at which they were recorded, shape (messages,)."""

    stamp_ns: IntArray
    log_ns: IntArray


def _read_through(bag: Bag, images: Topic, carrier: Carrier | None) -> tuple[_Times, _Times, FloatArray]:
    """Return the times of images and of exposures, and exposures and gains, shape (2, messages)."""
    image_times, exposure_times = array("q"), array("q")  # a time stamp and a time of recording for each message
    readings = array("d")  # an exposure and a gain for each message
    topic = carrying = images if carrier is None else carrier.topic
    try:
        read = None if carrier is None else carrier.readings()
        for message in bag.messages({images.name, carrying.name}):
            if message.topic == images.name:
                topic = images
                image_times.extend((read_stamp_ns(message.data, images), message.log_ns))
            if read is not None and message.topic == carrying.name:
                topic = carrying
                if (reading := read(message.data)) is not None:
                    exposure, gain, stamp_ns = reading
                    exposure_times.extend((stamp_ns, message.log_ns))
                    readings.extend((exposure, gain))
    except (DamagedMessageError, OverflowError) as error:
        raise RecordingError(f"{bag.path}: a message of {topic.name} cannot be read: {error}") from None
    if not image_times:
        raise RecordingError(f"{bag.path}: {images.name} has no images; choose another topic with --image-topic")
    images_at, exposures_at = (
        _Times(*np.array(pairs, dtype=np.int64).reshape(-1, 2).T.copy()) for pairs in (image_times, exposure_times)
    )
    return images_at, exposures_at, np.array(readings, dtype=np.float64).reshape(-1, 2).T


def _unexposed(bag: Bag, images: Topic) -> tuple[IntArray, IntArray, FrameTable]:
    """Return recording times and message numbers of all images, and their table with unknown exposures."""
    times, _, _ = _read_through(bag, images, None)
    numbers, stamps_ns, notes = _increasing(times, np.arange(len(times.log_ns)), str(bag.path))
    table = unlisted(str(bag.path), stamps_ns / NS_PER_S, stamped=True)
    return times.log_ns, numbers, replace(table, notes=(*table.notes, *notes))


def _exposed(bag: Bag, images: Topic, carrier: Carrier) -> tuple[IntArray, IntArray, FrameTable]:
    """Return recording times of all images, message numbers of those with an exposure, and their table."""
    times, exposures, readings = _read_through(bag, images, carrier)
    source = f"{bag.path}: {escaped(carrier.topic.name)}"
    if not readings.size:
        raise ExposureError(f"{source}: has no exposures ({carrier.summary}); choose another topic")
    exposure, match_notes = _match(times, exposures, source)
    numbers, stamps_ns, stamp_notes = _increasing(times, np.flatnonzero(exposure >= 0), str(bag.path))
    interval_ms = float(np.median(np.diff(stamps_ns))) / _NS_PER_MS if len(stamps_ns) > 1 else None
    values, unit_notes = _in_ms(readings, carrier, interval_ms, source)
    exposures_ms = checked_exposures(
        values[exposure[numbers]],
        lambda frames: f"{source}, image {listed(frames)}",
        "give the unit or the gain, or ignore it with --gain-unit none",
    )
    stamps_s = read_only(stamps_ns / NS_PER_S)
    notes = (*unit_notes, *match_notes, *stamp_notes)
    return times.log_ns, numbers, FrameTable(source, (), stamps_s, exposures_ms, notes)


def _listed(bag: Bag, images: Topic, table: FrameTable) -> tuple[IntArray, IntArray, FrameTable]:
    """Return the same as :func:`_exposed` with the exposures of a list."""
    if not table.stamped:
        raise ExposureError(f"{table.source}: has no time stamps; add a column timestamp_s or timestamp_ns")
    times, _, _ = _read_through(bag, images, None)
    at_ns = np.rint(table.stamps_s * NS_PER_S).astype(np.int64)
    exposure, match_notes = _match(times, _Times(at_ns, at_ns), table.source)
    numbers, stamps_ns, stamp_notes = _increasing(times, np.flatnonzero(exposure >= 0), str(bag.path))
    exposures_ms = read_only(table.exposures_ms[exposure[numbers]])
    notes = (f"{table.source}: exposures are read from this list", *table.notes, *match_notes, *stamp_notes)
    return times.log_ns, numbers, FrameTable(table.source, (), read_only(stamps_ns / NS_PER_S), exposures_ms, notes)


def _match(images: _Times, exposures: _Times, source: str) -> tuple[IntArray, list[str]]:
    """Return the index of each image's exposure, -1 for none, (images,), and notes; ExposureError if few match."""
    # Time stamps of the camera take precedence. If they are missing or come from different clocks, the times at which
    # the messages were recorded are used.
    ways = [("time of recording", images.log_ns, exposures.log_ns)]
    if np.all(images.stamp_ns > 0) and np.all(exposures.stamp_ns > 0):
        ways.insert(0, ("time stamp", images.stamp_ns, exposures.stamp_ns))
    for what, wanted, offered in ways:
        found, tolerance_ns = _nearest(wanted, offered)
        known = int(np.count_nonzero(found >= 0))
        if known >= _LEAST_SHARE * len(found):
            notes = [] if what == "time stamp" else [f"{source}: exposures are matched to images by {what}"]
            if known < len(found):
                near = f"is within {tolerance_ns / 1e6:.3g} ms" if tolerance_ns else "has the same time stamp"
                notes.append(
                    f"{source}: {len(found) - known} of {counted(len(found), 'image')} left out, because no exposure "
                    f"{near}"
                )
            return found, notes
    raise ExposureError(
        f"{source}: has exposures for only {known} of {counted(len(found), 'image')}; record an exposure with the "
        f"time stamp of every image"
    )


def _nearest(wanted: IntArray, offered: IntArray) -> tuple[IntArray, float]:
    """Return the index of the nearest time, -1 if it is further than half a frame interval, and this tolerance.

    It is 0 if most times are equal: then the others belong to images that were not recorded.
    """
    order = np.argsort(offered, kind="stable")
    times = offered[order]
    nearer = nearest(times, wanted)
    distance = np.abs(times[nearer] - wanted)
    steps = np.diff(np.sort(wanted))
    tolerance_ns = float(np.median(steps)) / 2 if len(steps) else _ONLY_IMAGE_TOLERANCE_NS
    if np.count_nonzero(distance == 0) >= _LEAST_SHARE * len(wanted):
        tolerance_ns = 0.0
    found = np.where(distance <= tolerance_ns, order[nearer], -1)
    return found.astype(np.int64), tolerance_ns


def _increasing(times: _Times, messages: IntArray, path: str) -> tuple[IntArray, IntArray, list[str]]:
    """Return the messages in temporal order, their time stamps in nanoseconds, and notes about those left out."""
    stamps_ns, notes = times.stamp_ns[messages], []
    if np.any(stamps_ns <= 0):
        stamps_ns = times.log_ns[messages]
        notes.append(f"{path}: some images have no time stamp; using the times at which they were recorded")
    # An image is kept if it is later than all images before it.
    latest = np.maximum.accumulate(stamps_ns)
    later = np.concatenate([[True], stamps_ns[1:] > latest[:-1]])
    if not later.all():
        count = int(np.count_nonzero(~later))
        notes.append(f"{path}: {counted(count, 'image')} left out, because time stamps do not increase")
    return messages[later], stamps_ns[later], notes


def _in_ms(
    readings: FloatArray, carrier: Carrier, interval_ms: float | None, source: str
) -> tuple[FloatArray, list[str]]:
    """Return exposure times gain in milliseconds, and notes about the units."""
    values, gains = readings
    unit = carrier.unit or infer_unit(values, interval_ms, source)
    if unit is not ExposureUnit.LOG2_S:
        values = np.where(values <= 0, np.nan, values)  # drivers send 0 or -1 while they do not know the exposure
    how = "" if carrier.unit is not None else f", in {unit.value}, inferred from their size and the frame rate"
    notes = [f"{source}: exposures are {carrier.summary}{how}"]
    gain_unit = carrier.gain_unit
    if gain_unit is None:
        if np.ptp(gains) > 0:
            raise ExposureError(
                f"{source}: the gain changes from {gains.min():g} to {gains.max():g} in the "
                f"camera's own unit; give it with --gain-unit (linear, db, iso, or none to ignore it)"
            )
        gain_unit = GainUnit.NONE
        notes.append(f"{source}: the gain is constant and ignored")
    return unit.to_ms(values) * gain_unit.linear(gains), notes


KIND = _Rosbag()
