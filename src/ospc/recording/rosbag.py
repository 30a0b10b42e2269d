"""ROS 1 and ROS 2 bags with a topic for images and a topic for exposures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from ospc.arrays import FloatArray, Image, IntArray, read_only
from ospc.errors import ExposureError, escaped, listed
from ospc.recording.bags.bag import (
    Bag,
    exposure_topic,
    gain_topics,
    image_topic,
    image_topics,
    is_bag,
    own_exposure_topic,
)
from ospc.recording.bags.carriers import Carrier, carrier_of, gain_carrier
from ospc.recording.bags.container import Topic
from ospc.recording.bags.image_messages import ImageStream
from ospc.recording.bags.messages import NS_PER_S
from ospc.recording.bags.timing import Carried, Times, match_times, read_through, without_steps_back
from ospc.recording.exposure_lists import read_list
from ospc.recording.exposure_units import ExposureUnit, GainUnit, infer_unit, known_gain_unit
from ospc.recording.frame import Frame
from ospc.recording.frame_table import FrameTable, checked_exposures, placeholder_table
from ospc.recording.list_columns import columns_of
from ospc.recording.list_search import names_exposures
from ospc.recording.options import DEFAULT, ReadingOptions
from ospc.recording.pixel_layout import PixelLayout, find_layout
from ospc.recording.recording import StoredRecording
from ospc.recording.table_text import read_table_text


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
            log_ns, numbers, table = _exposed(bag, topic, options)
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


def _unexposed(bag: Bag, images: Topic) -> tuple[IntArray, IntArray, FrameTable]:
    """Return recording times and message numbers of all images, and their table with unknown exposures."""
    times, _ = read_through(bag, images)
    numbers, stamps_ns, notes = without_steps_back(times, np.arange(len(times.log_ns)), str(bag.path))
    table = placeholder_table(str(bag.path), stamps_ns / NS_PER_S, stamped=True)
    return times.log_ns, numbers, replace(table, notes=(*table.notes, *notes))


def _exposed(bag: Bag, images: Topic, options: ReadingOptions) -> tuple[IntArray, IntArray, FrameTable]:
    """Return recording times of all images, message numbers of those with an exposure, and their table."""
    topics = [] if options.gain_unit is GainUnit.NONE else gain_topics(bag, images)
    gains = [gain_carrier(topic, options) for topic in topics]
    if options.exposure_topic is None and names_exposures(bag.exposure_list):
        table, has_gain = _listed(bag.exposure_list, options, gain_elsewhere=bool(gains))
        source, notes = table.source, [f"{table.source}: exposures are read from this list", *table.notes]
        gains = [] if has_gain else gains
        times, carried = read_through(bag, images, gains)
        at_ns = np.rint(table.stamps_s * NS_PER_S).astype(np.int64)
        exposure_times, values_ms = Times(at_ns, at_ns), table.exposures_ms
    else:
        topic = exposure_topic(bag, images, options)
        source = f"{bag.path}: {escaped(topic.name)}"
        carrier = carrier_of(topic, options, source)
        gains = [] if carrier.has_gain else gains
        times, ((exposure_times, readings), *carried) = read_through(bag, images, (carrier, *gains))
        values_ms, notes = _in_ms(readings, carrier, times, source)
    exposure, match_notes = match_times(times, exposure_times, source)
    factors, gain_notes = _gain_factors(bag, times, gains, carried)
    known = (exposure >= 0) & np.isfinite(factors)
    numbers, stamps_ns, stamp_notes = without_steps_back(times, np.flatnonzero(known), str(bag.path))
    exposures_ms = checked_exposures(
        values_ms[exposure[numbers]] * factors[numbers],
        lambda frames: f"{source}, image {listed(frames)}",
        "give the unit or the gain, or ignore it with --gain-unit none",
    )
    notes += [*gain_notes, *match_notes, *stamp_notes]
    table = FrameTable(source, (), read_only(stamps_ns / NS_PER_S), exposures_ms, tuple(notes))
    return times.log_ns, numbers, table


def _listed(path: Path, options: ReadingOptions, *, gain_elsewhere: bool) -> tuple[FrameTable, bool]:
    """Return the list of exposures of a bag, and whether it includes the gain."""
    has_gain = bool(columns_of(read_table_text(path), str(path))[0].gains)
    table = read_list(path, replace(options, gain_unit=None) if gain_elsewhere and not has_gain else options)
    if not table.stamped:
        raise ExposureError(f"{table.source}: has no time stamps; add a column timestamp_s or timestamp_ns")
    return table, has_gain


def _gain_factors(
    bag: Bag, images: Times, carriers: Sequence[Carrier], carried: Sequence[Carried]
) -> tuple[FloatArray, list[str]]:
    """Return the product of the gains on topics of their own for each image, NaN for an unknown one, and notes."""
    factors, notes = np.ones(len(images.log_ns)), list[str]()
    for carrier, (gain_times, (gains, _)) in zip(carriers, carried, strict=True):
        source = f"{bag.path}: {escaped(carrier.topic.name)}"
        if not gains.size or np.ptp(gains) == 0:
            notes.append(f"{source}: the gain is constant and ignored")
            continue
        unit = known_gain_unit(carrier.gain_unit, gains, f"{source}: the gain")
        gain, match_notes = match_times(images, gain_times, source, "gain")
        factors *= np.where(gain >= 0, unit.linear(gains)[gain], np.nan)
        notes += [f"{source}: exposures are multiplied by this gain{carrier.summary}", *match_notes]
    return factors, notes


def _in_ms(readings: FloatArray, carrier: Carrier, images: Times, source: str) -> tuple[FloatArray, list[str]]:
    """Return exposure times gain in milliseconds, and notes about the units."""
    if not readings.size:
        raise ExposureError(f"{source}: has no exposures ({carrier.summary}); choose another topic")
    values, gains = readings
    unit, how = carrier.unit, ""
    if unit is None:
        _, stamps_ns, _ = without_steps_back(images, np.arange(len(images.log_ns)), source)
        unit = infer_unit(values, stamps_ns / NS_PER_S, source)
        how = f", in {unit.value}, inferred from their size and the frame rate"
    if unit is not ExposureUnit.LOG2_S:
        values = np.where(values <= 0, np.nan, values)  # drivers send 0 or -1 while they do not know the exposure
    notes = [f"{source}: exposures are {carrier.summary}{how}"]
    # A gain that drivers do not set is often zero.
    doubtful = carrier.gain_unit is None or (carrier.gain_assumed and np.ptp(gains) == 0)
    gain_unit = known_gain_unit(None if doubtful else carrier.gain_unit, gains, f"{source}: the gain")
    if doubtful:
        notes.append(f"{source}: the gain is constant and ignored")
    return unit.to_ms(values) * gain_unit.linear(gains), notes


KIND = _Rosbag()
