"""Bags of ROS 1 and ROS 2 with a topic of images and one of exposures."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ospc.arrays import FloatArray, Image, ImageSize
from ospc.errors import ExposureError, FrameError, RecordingError
from ospc.recording.bags.bag import Bag, is_bag
from ospc.recording.bags.carriers import Carrier, Reading, carrier_of
from ospc.recording.bags.container import Topic
from ospc.recording.bags.image_messages import read_image, read_stamp_ns
from ospc.recording.bags.image_stream import ImageStream
from ospc.recording.bags.matching import Times, match
from ospc.recording.bags.topics import exposure_topic, image_topic, image_topics
from ospc.recording.bags.wire import DamagedMessageError
from ospc.recording.channel import Channel
from ospc.recording.exposure_units import GainUnit, infer_unit
from ospc.recording.frame import Frame
from ospc.recording.frame_table import EXPOSURE_RANGE_MS
from ospc.recording.options import DEFAULT, ReadingOptions
from ospc.recording.pixel_layout import PixelLayout, StoredImage, find_layout
from ospc.recording.wording import escaped, listed


@dataclass(frozen=True)
class Rosbag:
    """The kind of recording that is a bag of ROS 1 or ROS 2."""

    name: str = "rosbag"

    def recognises(self, path: Path) -> bool:
        """Tell whether the path is a file that begins like a bag, or a folder with such files."""
        return is_bag(path)

    def open(self, path: Path, options: ReadingOptions = DEFAULT) -> BagRecording:
        """Open the bag and go through it once, for time stamps and exposures.

        Raises
        ------
        RecordingError
            If it is no bag, damaged, ends early, or has no such images.
        ExposureError
            If the exposures are missing, or it is unclear where they are or in which unit.
        MissingExtraError
            If the optional dependency for its format is not installed.
        """
        bag = Bag.at(path)
        images, notes = image_topic(bag, options)
        carrying = exposure_topic(bag, images, options)
        source = f"{path}: {escaped(carrying.name)}"
        carrier = carrier_of(carrying, options)
        contents = _go_through(bag, images, carrying, carrier)
        if not len(contents.images.log_ns):
            raise RecordingError(f"{path}: {escaped(images.name)} holds no images")
        if not len(contents.exposures.log_ns):
            raise ExposureError(f"{source}: holds no exposures ({carrier.says})")
        matching = match(contents.images, contents.exposures, source)
        kept = np.flatnonzero(matching.exposure >= 0)
        stamps_ns, kept, stamp_notes = _increasing(contents.images, kept, str(path))
        values, unit_notes = _in_ms(contents, carrier, _interval_ms(stamps_ns), source)
        exposures_ms = _checked(values[matching.exposure[kept]], source)
        stream = ImageStream(bag, images, contents.images.log_ns)
        load = partial(_load, stream, images, options)
        layout, pixel_notes = find_layout(
            lambda i: load(int(kept[i])), exposures_ms, f"{path}: {escaped(images.name)}", options, take_green=True
        )
        said = [*notes, *unit_notes, *matching.notes, *stamp_notes, *pixel_notes]
        stamps_s = stamps_ns / 1e9
        stamps_s.setflags(write=False)
        return BagRecording(
            path, bag, images, options, exposures_ms, stamps_s, layout, kept, contents.images, tuple(said)
        )

    def cameras(self, path: Path, options: ReadingOptions) -> dict[str, tuple[Path, ReadingOptions]]:
        """Return the cameras of the bag by the names of their topics; the one topic that is named, if any.

        Raises
        ------
        RecordingError
            If it is no bag, damaged, ends early, or has no such images.
        MissingExtraError
            If the optional dependency for its format is not installed.
        """
        bag = Bag.at(path)
        topics = image_topics(bag) if options.image_topic is None else []
        return camera_names(topics or [image_topic(bag, options)[0]], path, options)


@dataclass(frozen=True, eq=False)
class BagRecording:
    """Images of one topic of a bag, each read when it is asked for.

    Attributes
    ----------
    path
        The bag.
    bag
        Its files.
    topic
        The topic with the images.
    options
        What the user says about it.
    exposures_ms
        Exposure of every frame in milliseconds times linear gain, shape (frames,).
    stamps_s
        Time stamp of every frame in seconds, shape (frames,).
    layout
        What its images have in common.
    kept
        Number of the message of every frame, shape (frames,).
    times
        When the messages of the topic were sent and recorded.
    notes
        What a user should know about how it was read.
    """

    path: Path
    bag: Bag = field(repr=False)
    topic: Topic
    options: ReadingOptions
    exposures_ms: FloatArray = field(repr=False)
    stamps_s: FloatArray = field(repr=False)
    layout: PixelLayout
    kept: npt.NDArray[np.int64] = field(repr=False)
    times: Times = field(repr=False)
    notes: tuple[str, ...] = ()
    kind: str = "rosbag"

    @property
    def channel(self) -> Channel | None:
        """Channel taken of colour images; None where the user did not say."""
        return self.options.channel

    @property
    def size(self) -> ImageSize:
        """Width and height of its frames in pixels."""
        return self.layout.size

    @property
    def max_grey(self) -> int:
        """Largest grey value the sensor delivers."""
        return self.layout.depth.max_grey

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.kept)

    def __iter__(self) -> Iterator[Frame]:
        """Give the frames one by one, none decoded; they share one way through the bag."""
        stream = ImageStream(self.bag, self.topic, self.times.log_ns)
        for index in range(len(self)):
            stamp_s, exposure_ms = float(self.stamps_s[index]), float(self.exposures_ms[index])
            name = _label(self.topic, int(self.kept[index]))
            yield Frame(index, stamp_s, exposure_ms, name, partial(self._load, stream, index), self.max_grey)

    def stored_bytes(self, index: int) -> bytes:
        """Return the message of a frame, to recognise the recording by.

        Raises
        ------
        FrameError
            If it cannot be read.
        """
        stream = ImageStream(self.bag, self.topic, self.times.log_ns)
        return _read(stream, int(self.kept[index]))

    def _load(self, stream: ImageStream, index: int) -> Image:
        number = int(self.kept[index])
        stored = _load(stream, self.topic, self.options, number)
        return self.layout.grey(stored.pixels, _label(self.topic, number))


@dataclass(frozen=True)
class _Contents:
    """What going through a bag gave."""

    images: Times
    exposures: Times
    values: FloatArray
    gains: FloatArray


def camera_names(
    topics: Sequence[Topic], path: Path, options: ReadingOptions
) -> dict[str, tuple[Path, ReadingOptions]]:
    """Name cameras by their topics: ``/cam0/image_raw`` is ``cam0`` unless another topic is, too."""
    short = [_short_name(topic.name) for topic in topics]
    full = [topic.name.strip("/").replace("/", "_") for topic in topics]
    names = [name if short.count(name) == 1 else long for name, long in zip(short, full, strict=True)]
    return {name: (path, replace(options, image_topic=topic.name)) for name, topic in zip(names, topics, strict=True)}


def _short_name(topic: str) -> str:
    parts = topic.strip("/").split("/")
    named = [part for part in parts if not part.startswith("image") and part != "compressed"]
    return "_".join(named or parts)


def _go_through(bag: Bag, images: Topic, carrying: Topic, carrier: Carrier) -> _Contents:
    """Collect times of images, and exposures; one message at a time is in memory."""
    image_times, exposure_times = (array("q"), array("q")), (array("q"), array("q"))
    values, gains = array("d"), array("d")
    read = carrier.readings(carrying)
    for message in bag.messages({images.name, carrying.name}):
        try:
            if message.topic == images.name:
                image_times[0].append(_stamp(message.data, images))
                image_times[1].append(message.log_ns)
            if message.topic == carrying.name:
                reading: Reading | None = read(message.data)
                if reading is not None:
                    exposure_times[0].append(reading.stamp_ns or 0)
                    exposure_times[1].append(message.log_ns)
                    values.append(reading.exposure)
                    gains.append(reading.gain)
        except (DamagedMessageError, OverflowError) as error:
            raise RecordingError(
                f"{bag.path}: a message of {escaped(message.topic)} cannot be read: {error}"
            ) from None
    return _Contents(
        Times(*(np.array(column, dtype=np.int64) for column in image_times)),
        Times(*(np.array(column, dtype=np.int64) for column in exposure_times)),
        np.array(values, dtype=np.float64),
        np.array(gains, dtype=np.float64),
    )


def _stamp(data: bytes, topic: Topic) -> int:
    try:
        return max(0, read_stamp_ns(data, topic.encoding))
    except DamagedMessageError:
        # The image is unreadable, which is said when it is asked for.
        return 0


def _increasing(
    times: Times, kept: npt.NDArray[np.int64], path: str
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], list[str]]:
    """Return time stamps that increase, the images they belong to, and what was left out."""
    stamps, notes = times.stamp_ns[kept], []
    if np.any(stamps <= 0):
        stamps = times.log_ns[kept]
        notes.append(f"{path}: some images have no time stamp; the times at which they were recorded are taken")
    # An image is kept if it is later than all before it.
    latest = np.maximum.accumulate(stamps)
    late = np.concatenate([[True], stamps[1:] > latest[:-1]])
    if not late.all():
        notes.append(
            f"{path}: {np.count_nonzero(~late)} images whose time stamp is not after the one before are left out"
        )
    return stamps[late], kept[late], notes


def _interval_ms(stamps_ns: npt.NDArray[np.int64]) -> float | None:
    return float(np.median(np.diff(stamps_ns))) / 1e6 if len(stamps_ns) > 1 else None


def _in_ms(
    contents: _Contents, carrier: Carrier, interval_ms: float | None, source: str
) -> tuple[FloatArray, list[str]]:
    """Return exposure times gain in milliseconds, and how that was found."""
    unit = carrier.unit or infer_unit(contents.values, interval_ms, source)
    how = "" if carrier.unit is not None else f" taken as {unit.value}, by their size and the frame rate"
    notes = [f"{source}: exposures are {carrier.says}{how}"]
    gain_unit = carrier.gain_unit
    if gain_unit is None:
        if np.ptp(contents.gains) > 0:
            raise ExposureError(
                f"{source}: the gain changes from {contents.gains.min():g} to {contents.gains.max():g} in the "
                f"camera's own unit; state the unit with --gain-unit (linear, db, iso, or none to ignore it)"
            )
        gain_unit = GainUnit.NONE
        notes.append(f"{source}: the gain is constant and left out of account")
    return unit.to_ms(contents.values) * gain_unit.linear(contents.gains), notes


def _checked(values: FloatArray, source: str) -> FloatArray:
    low, high = EXPOSURE_RANGE_MS
    bad = np.flatnonzero(~((values >= low) & (values <= high)))
    if bad.size:
        raise ExposureError(
            f"{source}: exposure times gain must be a positive number of milliseconds, not {values[bad[0]]:g} as for "
            f"image {listed([int(i) for i in bad])}; state unit or gain, or leave the gain out with --gain-unit none"
        )
    values.setflags(write=False)
    return values


def _load(stream: ImageStream, topic: Topic, options: ReadingOptions, number: int) -> StoredImage:
    label = _label(topic, number)
    try:
        return read_image(_read(stream, number), topic.type, topic.encoding, label, options.channel)
    except DamagedMessageError as error:
        raise FrameError(f"{label}: {error}") from None


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
