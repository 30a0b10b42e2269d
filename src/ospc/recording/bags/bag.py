"""A bag: one file, or a folder with several files that follow each other, of any format."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from ospc.errors import RecordingError, quoted
from ospc.recording.bags.container import BagFile, Message, Topic
from ospc.recording.bags.mcap_file import MCAP_START, McapFile
from ospc.recording.bags.rosbags_files import ROS1_START, SQLITE_START, Ros1File, Sqlite3File
from ospc.recording.image_source import by_name

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
