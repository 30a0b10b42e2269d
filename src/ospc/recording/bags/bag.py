"""A bag: one file, or several of a folder that follow each other; and which of its topics are read if nobody says."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ospc.errors import ExposureError, RecordingError, escaped, listed, quoted
from ospc.formats.files import by_name
from ospc.recording.bags.carriers import candidates
from ospc.recording.bags.container import ROS1_START, SQLITE_START, BagFile, Message, Ros1File, Sqlite3File, Topic
from ospc.recording.bags.mcap_file import MCAP_START, McapFile
from ospc.recording.options import ReadingOptions

RAW, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
IMAGE_TYPES = (RAW, COMPRESSED)

_SUFFIXES = (".bag", ".mcap", ".db3")
_COMPRESSED_SUFFIXES = (".mcap.zstd", ".db3.zstd", ".mcap.zst", ".db3.zst")
_MAX_FILES = 10_000
"""Folders with more files are refused; a day in files of a minute has 1440."""

_HEAD_BYTES = 16
"""Read to recognise the format of a file."""

_OPENERS = {MCAP_START: McapFile, ROS1_START: Ros1File, SQLITE_START: Sqlite3File}
"""Class of the files that begin with each magic number."""


@dataclass(frozen=True)
class Bag:
    """A bag: its path, and its files in the order of their names."""

    path: Path
    files: tuple[BagFile, ...]

    @classmethod
    def at(cls, path: Path) -> Bag:
        """Open a file or folder; RecordingError if it is not a bag, or damaged."""
        if not path.is_dir():
            return cls(path, (_file(path),))
        paths = _files_of(path)
        if not paths:
            packed = [p for p in sorted(path.iterdir()) if p.name.endswith(_COMPRESSED_SUFFIXES)]
            if packed:
                raise RecordingError(f"{packed[0]}: is a compressed file; unpack it with 'zstd -d {packed[0].name}'")
            raise RecordingError(f"{path}: holds no bag; it must hold .bag, .mcap or .db3 files")
        if len({p.suffix for p in paths}) > 1:
            raise RecordingError(f"{path}: holds bags of several formats; open one of its files")
        return cls(path, tuple(_file(p) for p in paths))

    @property
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
        """Yield messages as :meth:`~ospc.recording.bags.container.BagFile.messages` of all files."""
        for file in self.files:
            yield from file.messages(names, start_ns)


def is_bag(path: Path) -> bool:
    """Tell whether a path is a bag: a file that begins like one, or a folder with such files."""
    if path.is_dir():
        names = (p.name for p in path.iterdir())
        return bool(_files_of(path)) or any(name.endswith(_COMPRESSED_SUFFIXES) for name in names)
    return _opener(path) is not None


def _files_of(folder: Path) -> list[Path]:
    paths = sorted(
        (p for p in folder.iterdir() if p.suffix in _SUFFIXES and p.is_file()), key=lambda p: by_name(p.name)
    )
    if len(paths) > _MAX_FILES:
        raise RecordingError(f"{folder}: holds more than the {_MAX_FILES} files allowed; open one of them")
    return paths


def _opener(path: Path) -> Callable[[Path], BagFile] | None:
    if not path.is_file():
        return None
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    return next((opener for start, opener in _OPENERS.items() if head.startswith(start)), None)


def _file(path: Path) -> BagFile:
    opener = _opener(path)
    if opener is None:
        what = "is empty" if path.is_file() and path.stat().st_size == 0 else "is not a ROS bag"
        raise RecordingError(f"{path}: {what}; expected a .bag of ROS 1, or .mcap or .db3 of ROS 2")
    return opener(path)


_NOT_PHOTOGRAPHS = ("depth", "disparity", "segmentation", "mask", "label")
"""Topics of images whose names contain one of these hold something other than grey values."""


def image_topic(bag: Bag, options: ReadingOptions) -> tuple[Topic, list[str]]:
    """Return the topic with the images, and notes about the choice; RecordingError if there is none."""
    if options.image_topic is not None:
        topic = _named(bag, options.image_topic)
        if topic.type not in IMAGE_TYPES:
            raise RecordingError(f"{bag.path}: {topic.name} has no images but {topic.type}; see --list-topics")
        return topic, []
    found = image_topics(bag)
    if not found:
        raise RecordingError(f"{bag.path}: has no topic with images; it has {_names(bag.topics)}")
    first, *others = found
    names = listed([topic.name for topic in others])
    return first, [f"{escaped(first.name)} is read; choose {names} with --image-topic"] if others else []


def image_topics(bag: Bag) -> list[Topic]:
    """Return the topics with images of cameras, one per camera, without depth; raw images before compressed ones."""
    images = [t for t in bag.topics if t.type in IMAGE_TYPES and t.messages != 0]
    grey = [t for t in images if not any(word in t.name.lower() for word in _NOT_PHOTOGRAPHS)] or images
    raw = [t for t in grey if t.type == RAW]
    bases = {t.name for t in raw}
    return raw + [t for t in grey if t.type != RAW and not any(t.name.startswith(f"{base}/") for base in bases)]


def uses(bag: Bag) -> list[tuple[Topic, str]]:
    """Return every topic with what it can be used for: ``images``, ``exposures``, or an empty text."""
    carriers = {topic.name for topic in candidates(bag.topics)}
    return [
        (topic, "images" if topic.type in IMAGE_TYPES else "exposures" if topic.name in carriers else "")
        for topic in bag.topics
    ]


def exposure_topic(bag: Bag, images: Topic, options: ReadingOptions) -> Topic:
    """Return the topic with the exposures of the images on another topic.

    ExposureError if there is none, or several with names equally similar to that of the images.
    """
    if options.exposure_topic is not None:
        return _named(bag, options.exposure_topic)
    cameras = image_topics(bag)
    carriers = (t for t in candidates(bag.topics) if t.messages != 0)
    found = [t for t in carriers if own_exposure_topic(bag, t.name, images, cameras) == t.name]
    if not found:
        raise ExposureError(
            f"{bag.path}: no topic is known to hold the exposures of {images.name}; state it with "
            f"--exposure-topic and --exposure-field; there are {_names(bag.topics)}"
        )
    shared = [_shared(t.name, images.name) for t in found]
    best = [t for t, count in zip(found, shared, strict=True) if count == max(shared)]
    if len(best) > 1:
        raise ExposureError(
            f"{bag.path}: several topics may hold the exposures of {images.name} "
            f"({listed([t.name for t in best])}); state one with --exposure-topic"
        )
    return best[0]


def own_exposure_topic(bag: Bag, stated: str, images: Topic, cameras: Sequence[Topic]) -> str | None:
    """Return the topic with the exposures of one of several cameras, when the user stated one topic for all.

    Exposures below the name of one camera, such as ``/cam0/exposure``, are those of this camera; others have them at
    the same place below their own name, otherwise None. A topic of no particular camera serves all.
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
    """Return how many leading parts two names of topics have in common."""
    pairs = list(zip(name.strip("/").split("/"), other.strip("/").split("/"), strict=False))
    return next((count for count, (part, other_part) in enumerate(pairs) if part != other_part), len(pairs))


def _named(bag: Bag, name: str) -> Topic:
    for topic in bag.topics:
        if topic.name.strip("/") == name.strip("/"):
            return topic
    raise RecordingError(f"{bag.path}: has no topic {quoted(name)}; it has {_names(bag.topics)}")


def _names(topics: tuple[Topic, ...]) -> str:
    return listed([f"{t.name} ({t.type})" for t in topics]) if topics else "none at all"
