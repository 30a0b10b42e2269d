"""Bags, which are a file or a folder of consecutive files, and the selection of their topics."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from ospc.errors import ExposureError, RecordingError, escaped, listed, quoted
from ospc.formats.files import beginning, by_name
from ospc.recording.bags.carriers import candidates, gains_in
from ospc.recording.bags.container import ROS1_START, SQLITE_START, BagFile, Message, Ros1File, Sqlite3File, Topic
from ospc.recording.bags.mcap_file import MCAP_START, McapFile
from ospc.recording.list_search import check_text
from ospc.recording.options import ReadingOptions

RAW, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
IMAGE_TYPES = (RAW, COMPRESSED)

_SUFFIXES = (".bag", ".mcap", ".db3")
_COMPRESSED_SUFFIXES = (".mcap.zstd", ".db3.zstd", ".mcap.zst", ".db3.zst")
_MAX_FILES = 10_000
"""Maximum number of files in a folder; a day in files of one minute has 1440."""

_OPENERS = {MCAP_START: McapFile, ROS1_START: Ros1File, SQLITE_START: Sqlite3File}
"""Class for each magic number at the beginning of a file."""


@dataclass(frozen=True)
class Bag:
    """A bag with its path and its files, sorted by name."""

    path: Path
    files: tuple[BagFile, ...]

    @classmethod
    def at(cls, path: Path) -> Bag:
        """Open a file or folder; RecordingError if it is not a bag or is damaged."""
        if not path.is_dir():
            return cls(path, (_file(path),))
        paths = _files_of(path)
        if not paths:
            packed = [p for p in sorted(path.iterdir()) if p.name.endswith(_COMPRESSED_SUFFIXES)]
            if packed:
                raise RecordingError(f"{packed[0]}: is a compressed file; unpack it with 'zstd -d {packed[0].name}'")
            raise RecordingError(f"{path}: has no bag; it must contain .bag, .mcap or .db3 files")
        if len({p.suffix for p in paths}) > 1:
            raise RecordingError(f"{path}: contains bags of several formats; open one of its files")
        return cls(path, tuple(_file(p) for p in paths))

    @property
    def exposure_list(self) -> Path:
        """Place of a list of exposures for the bag: next to it, or next to the only file in its folder."""
        own = self.files[0].path.with_suffix(".csv")
        if len(self.files) == 1 and own.is_file():
            return own
        place = self.path.resolve() if self.path.name in ("", "..") else self.path  # such as '.'
        return place.with_name(f"{place.name if place.is_dir() else place.stem}.csv")

    @cached_property
    def topics(self) -> tuple[Topic, ...]:
        """The topics of all files, sorted by name."""
        found: dict[str, Topic] = {}
        for file in self.files:
            for topic in file.topics:
                have = found.get(topic.name)
                if have is None:
                    found[topic.name] = topic
                elif topic.type == have.type:
                    counted = have.messages is not None and topic.messages is not None
                    total = (have.messages or 0) + (topic.messages or 0) if counted else None
                    found[topic.name] = replace(have, messages=total, definition=have.definition or topic.definition)
                else:
                    raise RecordingError(
                        f"{file.path}: the topic {quoted(topic.name)} has type {quoted(topic.type)} here and "
                        f"{quoted(have.type)} in another file; open one of the files"
                    )
        return tuple(sorted(found.values(), key=lambda topic: by_name(topic.name)))

    def messages(self, names: Collection[str], start_ns: int | None = None) -> Iterator[Message]:
        """Yield the :meth:`~ospc.recording.bags.container.BagFile.messages` of all files."""
        for file in self.files:
            yield from file.messages(names, start_ns)


def is_bag(path: Path) -> bool:
    """Return whether a path is a bag: a file with a known magic number, or a folder with such files."""
    if path.is_dir():
        names = (p.name for p in path.iterdir())
        return bool(_files_of(path)) or any(name.endswith(_COMPRESSED_SUFFIXES) for name in names)
    return _opener(path) is not None


def _files_of(folder: Path) -> list[Path]:
    paths = sorted(
        (p for p in folder.iterdir() if p.suffix in _SUFFIXES and p.is_file()), key=lambda p: by_name(p.name)
    )
    if len(paths) > _MAX_FILES:
        raise RecordingError(f"{folder}: has more than the {_MAX_FILES} files allowed; open one of them")
    return paths


def _opener(path: Path) -> Callable[[Path], BagFile] | None:
    head = beginning(path)
    return next((opener for start, opener in _OPENERS.items() if head.startswith(start)), None)


def _file(path: Path) -> BagFile:
    opener = _opener(path)
    if opener is None:
        what = "is empty" if path.is_file() and path.stat().st_size == 0 else "is not a ROS bag"
        raise RecordingError(f"{path}: {what}; expected a ROS 1 .bag, or a ROS 2 .mcap or .db3 file")
    return opener(path)


_NOT_PHOTOGRAPHS = ("depth", "disparity", "segmentation", "mask", "label")
"""Words in the names of image topics whose pixels are not grey values."""


def image_topic(bag: Bag, options: ReadingOptions) -> tuple[Topic, list[str]]:
    """Return the topic of the images, and notes about the choice; RecordingError if there is none."""
    if options.image_topic is not None:
        topic = _named(bag, options.image_topic)
        if topic.type not in IMAGE_TYPES:
            raise RecordingError(f"{bag.path}: {topic.name} has {topic.type} instead of images; see --list-topics")
        return topic, []
    found = image_topics(bag)
    if not found:
        raise RecordingError(f"{bag.path}: has no topic with images; it has {_names(bag.topics)}")
    first, *others = found
    names = listed([topic.name for topic in others])
    return first, [f"reading {escaped(first.name)}; choose {names} with --image-topic"] if others else []


def image_topics(bag: Bag) -> list[Topic]:
    """Return the topics of camera images, one per camera, without depth; raw images before compressed ones."""
    images = [t for t in bag.topics if t.type in IMAGE_TYPES and t.messages != 0]
    grey = [t for t in images if not any(word in t.name.lower() for word in _NOT_PHOTOGRAPHS)] or images
    raw = [t for t in grey if t.type == RAW]
    bases = {t.name for t in raw}
    return raw + [t for t in grey if t.type != RAW and not any(t.name.startswith(f"{base}/") for base in bases)]


def uses(bag: Bag) -> list[tuple[Topic, str]]:
    """Return every topic with its possible use: ``images``, ``exposures``, ``gain``, or an empty text."""
    known = {topic.name: "gain" for topic in gains_in(bag.topics)}
    known |= {topic.name: "exposures" for topic in candidates(bag.topics)}
    return [(topic, "images" if topic.type in IMAGE_TYPES else known.get(topic.name, "")) for topic in bag.topics]


def exposure_topic(bag: Bag, images: Topic, options: ReadingOptions) -> Topic:
    """Return the topic with the exposures of images on another topic.

    Raises
    ------
    ExposureError
        If there is none, or several have names equally similar to the topic of the images.
    """
    if options.exposure_topic is not None:
        return _named(bag, options.exposure_topic)
    found = _closest(bag, candidates(bag.topics), images)
    if not found:
        check_text(bag.exposure_list, bag.path)
        raise ExposureError(
            f"{bag.path}: no topic is known to have the exposures of {images.name}; name it with "
            f"--exposure-topic and --exposure-field, or give a list, {bag.exposure_list}, with a header "
            f"'timestamp_ns,exposure_ms'; topics are {_names(bag.topics)}"
        )
    if len(found) > 1:
        raise ExposureError(
            f"{bag.path}: several topics may have the exposures of {images.name} "
            f"({listed([t.name for t in found])}); name one with --exposure-topic"
        )
    return found[0]


def gain_topics(bag: Bag, images: Topic) -> list[Topic]:
    """Return the topics with gains of images on another topic."""
    return _closest(bag, gains_in(bag.topics), images)


def _closest(bag: Bag, topics: Iterable[Topic], images: Topic) -> list[Topic]:
    """Return the topics with messages for the camera of some images whose names are closest to that of the images."""
    cameras = image_topics(bag)
    own = [t for t in topics if t.messages != 0 and own_exposure_topic(bag, t.name, images, cameras) == t.name]
    most = max((_shared(t.name, images.name) for t in own), default=0)
    return [t for t in own if _shared(t.name, images.name) == most]


def own_exposure_topic(bag: Bag, stated: str, images: Topic, cameras: Sequence[Topic]) -> str | None:
    """Return the exposure topic of one of several cameras, given the topic that the user stated for all.

    A topic below the name of a camera, such as ``/cam0/exposure``, belongs to this camera. Another camera has its own
    topic at the same position below its name; if that does not exist, the result is None. A topic that belongs to no
    particular camera is used for all.
    """
    shared = {camera.name: _shared(camera.name, stated) for camera in (images, *cameras)}
    owner = max(shared, key=shared.__getitem__)
    if shared[images.name] == shared[owner]:
        return stated
    differing = _shared(owner, images.name)
    parts, own = stated.strip("/").split("/"), images.name.strip("/").split("/")
    sibling = "/".join([*own[: differing + 1], *parts[differing + 1 :]])
    return next((topic.name for topic in bag.topics if topic.name.strip("/") == sibling), None)


def _shared(name: str, other: str) -> int:
    """Return how many leading parts two topic names have in common."""
    pairs = list(zip(name.strip("/").split("/"), other.strip("/").split("/"), strict=False))
    return next((count for count, (part, other_part) in enumerate(pairs) if part != other_part), len(pairs))


def _named(bag: Bag, name: str) -> Topic:
    for topic in bag.topics:
        if topic.name.strip("/") == name.strip("/"):
            return topic
    raise RecordingError(f"{bag.path}: has no topic {quoted(name)}; it has {_names(bag.topics)}")


def _names(topics: tuple[Topic, ...]) -> str:
    return listed([f"{t.name} ({t.type})" for t in topics]) if topics else "none"
