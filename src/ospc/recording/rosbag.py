"""Bags of ROS 1 and ROS 2 with a topic of images and one of exposures."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from ospc.arrays import FloatArray, Image, IntArray
from ospc.errors import ExposureError, FrameError, RecordingError, escaped, listed
from ospc.recording.bags.bag import Bag, is_bag
from ospc.recording.bags.carriers import Carrier, Reading, carrier_of
from ospc.recording.bags.container import Topic
from ospc.recording.bags.image_messages import read_image, read_stamp_ns
from ospc.recording.bags.image_stream import ImageStream
from ospc.recording.bags.matching import Times, match
from ospc.recording.bags.messages import DamagedMessageError
from ospc.recording.bags.topics import exposure_topic, image_topic, image_topics
from ospc.recording.exposure_units import GainUnit, infer_unit
from ospc.recording.frame import Frame
from ospc.recording.frame_table import checked_exposures, unlisted
from ospc.recording.options import DEFAULT, ReadingOptions
from ospc.recording.pixel_layout import PixelLayout, StoredImage, find_layout
from ospc.recording.recording import StoredRecording

_NS_PER_S, _NS_PER_MS = 1e9, 1e6


@dataclass(frozen=True)
class Rosbag:
    """The kind of recording that is a bag of ROS 1 or ROS 2."""

    name: str = "rosbag"

    def recognises(self, path: Path) -> bool:
        """Tell whether the path is a file that begins like a bag, or a folder with such files."""
        return is_bag(path)

    def open(self, path: Path, options: ReadingOptions = DEFAULT) -> BagRecording:
        """Open the bag and read it once, for time stamps and exposures.

        Raises
        ------
        RecordingError
            If it is not a bag, is damaged, ends early, or lacks the images.
        ExposureError
            If the exposures are missing, or their topic, field or unit has to be stated.
        MissingExtraError
            If the optional dependency for bags is not installed.
        """
        bag = Bag.at(path)
        images, notes = image_topic(bag, options)
        try:
            carrying = exposure_topic(bag, images, options)
        except ExposureError:
            if not options.unknown_exposures:
                raise
            return _without_exposures(bag, images, notes, options)
        source = f"{path}: {escaped(carrying.name)}"
        carrier = carrier_of(carrying, options)
        found = _read_through(bag, images, carrying, carrier)
        if not len(found.exposures.log_ns):
            raise ExposureError(f"{source}: holds no exposures ({carrier.summary}); state another topic")
        matching = match(found.images, found.exposures, source)
        messages, stamps_ns, stamp_notes = _increasing(
            found.images, np.flatnonzero(matching.exposure >= 0), str(path)
        )
        values, unit_notes = _in_ms(found, carrier, _interval_ms(stamps_ns), source)
        exposures_ms = checked_exposures(
            values[matching.exposure[messages]],
            lambda frames: f"{source}, image {listed(frames)}",
            "state the unit or the gain, or ignore it with --gain-unit none",
        )
        said = (*notes, *unit_notes, *matching.notes, *stamp_notes)
        frames = _Frames(found.images, messages, exposures_ms, stamps_ns / _NS_PER_S)
        return _recording(bag, images, options, frames, said)

    def cameras(self, path: Path, options: ReadingOptions) -> dict[str, tuple[Path, ReadingOptions]]:
        """Return the cameras of the bag by the names of their topics; only the stated topic if there is one.

        Raises
        ------
        RecordingError
            If it is not a bag, is damaged, ends early, or lacks the images.
        MissingExtraError
            If the optional dependency for bags is not installed.
        """
        bag = Bag.at(path)
        topics = image_topics(bag) if options.image_topic is None else []
        return camera_names(topics or [image_topic(bag, options)[0]], path, options)


@dataclass(frozen=True, eq=False, kw_only=True)
class BagRecording(StoredRecording):
    """Images of one topic of a bag.

    Attributes
    ----------
    bag
        The bag.
    topic
        The topic with the images.
    options
        What the user states about the recording.
    layout
        What the images have in common.
    numbers
        Number of the message of every frame, shape (frames,).
    times
        When the messages of the topic were sent and recorded.
    """

    bag: Bag = field(repr=False)
    topic: Topic
    options: ReadingOptions
    layout: PixelLayout
    numbers: IntArray = field(repr=False)
    times: Times = field(repr=False)

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames in order, not yet decoded; they share one pass through the bag."""
        stream = ImageStream(self.bag, self.topic, self.times.log_ns)
        for index, number in enumerate(self.numbers.tolist()):
            yield self._frame(index, _label(self.topic, number), partial(self._load, stream, number))

    def stored_bytes(self, index: int) -> bytes:
        """Return the message of a frame.

        Raises
        ------
        FrameError
            If it cannot be read.
        """
        return _read(ImageStream(self.bag, self.topic, self.times.log_ns), int(self.numbers[index]))

    def _load(self, stream: ImageStream, number: int) -> Image:
        stored = _load(stream, self.topic, self.options, number)
        return self.layout.grey(stored.pixels, _label(self.topic, number))


@dataclass(frozen=True)
class _Frames:
    """Times of all image messages; number, exposure and time stamp of those that are frames."""

    times: Times
    numbers: IntArray
    exposures_ms: FloatArray
    stamps_s: FloatArray


def _recording(
    bag: Bag, images: Topic, options: ReadingOptions, frames: _Frames, notes: Sequence[str]
) -> BagRecording:
    """Find out how the images are stored and put the recording together."""
    load = partial(_load, ImageStream(bag, images, frames.times.log_ns), images, options)
    layout, pixel_notes = find_layout(
        lambda i: load(int(frames.numbers[i])),
        frames.exposures_ms,
        f"{bag.path}: {escaped(images.name)}",
        options,
        take_green=True,
    )
    frames.stamps_s.setflags(write=False)
    return BagRecording(
        path=bag.path,
        kind="rosbag",
        size=layout.size,
        max_grey=layout.depth.max_grey,
        exposures_ms=frames.exposures_ms,
        stamps_s=frames.stamps_s,
        notes=(*notes, *pixel_notes),
        channel=options.channel,
        bag=bag,
        topic=images,
        options=options,
        layout=layout,
        numbers=frames.numbers,
        times=frames.times,
    )


def _without_exposures(bag: Bag, images: Topic, notes: Sequence[str], options: ReadingOptions) -> BagRecording:
    times = _read_through(bag, images).images
    messages, stamps_ns, stamp_notes = _increasing(times, np.arange(len(times.log_ns)), str(bag.path))
    table = unlisted(str(bag.path), stamps_ns / _NS_PER_S, stamped=True)
    frames = _Frames(times, messages, table.exposures_ms, table.stamps_s)
    return _recording(bag, images, options, frames, (*notes, *table.notes, *stamp_notes))


def camera_names(
    topics: Sequence[Topic], path: Path, options: ReadingOptions
) -> dict[str, tuple[Path, ReadingOptions]]:
    """Name cameras after their topics: ``/cam0/image_raw`` is ``cam0`` unless another topic would get that name."""
    short = [_short_name(topic.name) for topic in topics]
    full = [topic.name.strip("/").replace("/", "_") for topic in topics]
    names = [name if short.count(name) == 1 else long for name, long in zip(short, full, strict=True)]
    return {name: (path, replace(options, image_topic=topic.name)) for name, topic in zip(names, topics, strict=True)}


def _short_name(topic: str) -> str:
    parts = topic.strip("/").split("/")
    named = [part for part in parts if not part.startswith("image") and part != "compressed"]
    return "_".join(named or parts)


@dataclass(frozen=True)
class _Contents:
    """Times of the images; times, values and gains of the exposures in the units of their carrier."""

    images: Times
    exposures: Times
    values: FloatArray
    gains: FloatArray


def _read_through(
    bag: Bag, images: Topic, carrying: Topic | None = None, carrier: Carrier | None = None
) -> _Contents:
    """Read times and exposures of a bag; one message at a time is in memory."""
    image_stamps, image_logs, exposure_stamps, exposure_logs = (array("q") for _ in range(4))
    values, gains = array("d"), array("d")
    topic = images
    try:
        read: Callable[[bytes], Reading | None] | None = None
        if carrying is not None and carrier is not None:
            topic = carrying
            read = carrier.readings(carrying)
        for message in bag.messages({images.name} | ({carrying.name} if carrying else set())):
            if message.topic == images.name:
                topic = images
                image_stamps.append(_stamp_ns(message.data, images))
                image_logs.append(message.log_ns)
            if carrying is not None and read is not None and message.topic == carrying.name:
                topic = carrying
                reading = read(message.data)
                if reading is not None:
                    exposure_stamps.append(reading.stamp_ns or 0)
                    exposure_logs.append(message.log_ns)
                    values.append(reading.exposure)
                    gains.append(reading.gain)
    except (DamagedMessageError, OverflowError) as error:
        raise RecordingError(f"{bag.path}: a message of {escaped(topic.name)} cannot be read: {error}") from None
    if not image_logs:
        raise RecordingError(f"{bag.path}: {escaped(images.name)} holds no images; choose another with --image-topic")
    return _Contents(
        Times(_column(image_stamps), _column(image_logs)),
        Times(_column(exposure_stamps), _column(exposure_logs)),
        np.array(values, dtype=np.float64),
        np.array(gains, dtype=np.float64),
    )


def _column(values: array[int]) -> IntArray:
    return np.array(values, dtype=np.int64)


def _stamp_ns(data: bytes, topic: Topic) -> int:
    try:
        return max(0, read_stamp_ns(data, topic.type, topic.encoding))
    except DamagedMessageError:
        # The error is raised when the image is read.
        return 0


def _increasing(times: Times, messages: IntArray, path: str) -> tuple[IntArray, IntArray, list[str]]:
    """Return the messages in temporal order, their time stamps in nanoseconds, and notes about those left out."""
    stamps_ns, notes = times.stamp_ns[messages], []
    if np.any(stamps_ns <= 0):
        stamps_ns = times.log_ns[messages]
        notes.append(f"{path}: some images have no time stamp; the times of recording are used instead")
    # An image is kept if it is later than all images before it.
    latest = np.maximum.accumulate(stamps_ns)
    later = np.concatenate([[True], stamps_ns[1:] > latest[:-1]])
    if not later.all():
        count = np.count_nonzero(~later)
        notes.append(f"{path}: {count} images whose time stamps do not increase are left out")
    return messages[later], stamps_ns[later], notes


def _interval_ms(stamps_ns: IntArray) -> float | None:
    return float(np.median(np.diff(stamps_ns))) / _NS_PER_MS if len(stamps_ns) > 1 else None


def _in_ms(
    found: _Contents, carrier: Carrier, interval_ms: float | None, source: str
) -> tuple[FloatArray, list[str]]:
    """Return exposure times gain in milliseconds, and notes about the units."""
    unit = carrier.unit or infer_unit(found.values, interval_ms, source)
    how = "" if carrier.unit is not None else f" taken as {unit.value}, by their size and the frame rate"
    notes = [f"{source}: exposures are {carrier.summary}{how}"]
    gain_unit = carrier.gain_unit
    if gain_unit is None:
        if np.ptp(found.gains) > 0:
            raise ExposureError(
                f"{source}: the gain changes from {found.gains.min():g} to {found.gains.max():g} in the "
                f"camera's own unit; state the unit with --gain-unit (linear, db, iso, or none to ignore it)"
            )
        gain_unit = GainUnit.NONE
        notes.append(f"{source}: the gain is constant and ignored")
    return unit.to_ms(found.values) * gain_unit.linear(found.gains), notes


def _load(stream: ImageStream, topic: Topic, options: ReadingOptions, number: int) -> StoredImage:
    label = _label(topic, number)
    try:
        return read_image(_read(stream, number), topic.type, topic.encoding, label, options.channel)
    except DamagedMessageError as error:
        raise FrameError(f"{label}: {error}; leave it out") from None


def _read(stream: ImageStream, number: int) -> bytes:
    try:
        return stream.read(number)
    except FrameError:
        raise
    except RecordingError as error:
        raise FrameError(str(error)) from None


def _label(topic: Topic, number: int) -> str:
    return f"{escaped(topic.name)}[{number}]"


KIND = Rosbag()
