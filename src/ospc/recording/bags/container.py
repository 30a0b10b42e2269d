"""What all files of bags have in common, whatever their format."""

from __future__ import annotations

import bz2
import sys
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple

from ospc.errors import OspcError, RecordingError, needs_extra, quoted, said_by

MAX_CHUNK_BYTES = 256 * 2**20
"""Larger chunks and messages are refused, before and after decompression."""

MAX_TOPICS = 20_000
"""Bags with more topics are refused; large robots have a few hundred."""

_QUOTED_CHARACTERS = 120
"""Characters of a library's own message that an error quotes."""

Encoding = Literal["ros1", "cdr"]
"""Serialisation of messages: that of ROS 1, or the Common Data Representation of ROS 2."""


@dataclass(frozen=True)
class Topic:
    """A topic of a bag: name and type such as ``/camera/image_raw`` and ``sensor_msgs/msg/Image``, as in ROS 2.

    ``messages`` is None if the bag does not state their number; ``definition`` is that of the type, empty if the bag
    does not include it, and ``idl`` whether it is in IDL.
    """

    name: str
    type: str
    messages: int | None
    encoding: Encoding
    definition: str = ""
    idl: bool = False


class Message(NamedTuple):
    """A serialised message, the name of its topic, and when it was recorded."""

    topic: str
    log_ns: int
    data: bytes


class BagFile(ABC):
    """One file of a bag, and its topics.

    RecordingError if it is damaged or ends early; MissingExtraError without the optional dependency for bags.
    """

    _ADVICE: ClassVar[str]

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._reader(()) as reader:
            self.topics = tuple(self._topics(reader))

    def messages(self, names: Collection[str], start_ns: int | None = None) -> Iterator[Message]:
        """Yield the messages of the named topics one by one, in the same order every time.

        Those recorded before ``start_ns`` are skipped. RecordingError if the file is damaged.
        """
        with self._reader(names) as reader:
            yield from self._messages(reader, names, start_ns)

    @abstractmethod
    def _open(self, names: Collection[str]) -> AbstractContextManager[Any]:
        """Open a reader of the file that needs messages of these topics only."""

    @abstractmethod
    def _topics(self, reader: Any) -> Iterator[Topic]: ...

    @abstractmethod
    def _messages(self, reader: Any, names: Collection[str], start_ns: int | None) -> Iterator[Message]: ...

    @contextmanager
    def _reader(self, names: Collection[str]) -> Iterator[Any]:
        """Open a reader; turn every error of a library for a damaged file into one error that names the file."""
        try:
            with self._open(names) as reader:
                yield reader
        except RecordingError as error:
            # Inner functions do not know the file.
            if str(error).startswith(str(self.path)):
                raise
            raise RecordingError(f"{self.path}: {error}; {self._ADVICE}") from None
        except OspcError:
            raise
        except OSError as error:
            raise RecordingError(
                f"{self.path}: cannot be read ({error.strerror}); check the file and its rights"
            ) from None
        except Exception as error:
            said = said_by(error, _QUOTED_CHARACTERS)
            why = f" ({said})" if said else ""
            raise RecordingError(f"{self.path}: the bag is damaged or ends early{why}; {self._ADVICE}") from None


def expand(data: bytes, compression: str, size: int | None = None) -> bytes:
    """Decompress ``zstd``, ``lz4``, ``bz2``, or ``none``, to exactly ``size`` bytes if it is stated.

    RecordingError if another number comes out, or more than
    :data:`~ospc.recording.bags.container.MAX_CHUNK_BYTES`, or the compression is unknown.
    """
    limit = MAX_CHUNK_BYTES if size is None else size
    if limit > MAX_CHUNK_BYTES:
        raise RecordingError(f"a chunk expands to more than the {MAX_CHUNK_BYTES} bytes allowed")
    if compression in ("", "none"):
        expanded = data
    elif compression in ("zstd", "lz4", "bz2"):
        expanded = _decompressor(compression).decompress(data, max_length=limit + 1)
    else:
        raise RecordingError(f"its compression {quoted(compression)} is unknown")
    if len(expanded) > limit or (size is not None and len(expanded) != size):
        raise RecordingError("a chunk does not expand to its stated size")
    return bytes(expanded)


def _decompressor(compression: str) -> bz2.BZ2Decompressor:
    """Return an incremental decompressor; all have the interface of that in bz2."""
    if compression == "bz2":
        return bz2.BZ2Decompressor()
    with needs_extra("reading compressed bags", "ros"):
        if compression == "lz4":
            from lz4.frame import LZ4FrameDecompressor as Decompressor
        elif sys.version_info >= (3, 14):
            from compression.zstd import ZstdDecompressor as Decompressor
        else:
            from backports.zstd import ZstdDecompressor as Decompressor
    decompressor: bz2.BZ2Decompressor = Decompressor()
    return decompressor
