"""What every file of a bag offers, whichever format it is in."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

from ospc.errors import OspcError, RecordingError, said_by
from ospc.recording.bags.wire import Encoding
from ospc.recording.wording import escaped

MAX_CHUNK_BYTES = 256 * 2**20
"""Chunks and messages that are, or expand to, more are refused."""


@dataclass(frozen=True)
class Topic:
    """A topic of a bag.

    Attributes
    ----------
    name
        Such as ``/camera/image_raw``.
    type
        Type of its messages as ROS 2 writes it, such as ``sensor_msgs/msg/Image``, whichever ROS made the bag.
    messages
        Number of messages; None where the bag does not say.
    encoding
        How they are serialised.
    description
        What their type is made of; empty where the bag does not say.
    idl
        Whether the description is in IDL.
    """

    name: str
    type: str
    messages: int | None
    encoding: Encoding
    description: str = ""
    idl: bool = False


class Message(NamedTuple):
    """A message as it is stored.

    Attributes
    ----------
    topic
        Name of its topic.
    log_ns
        When it was recorded, in nanoseconds.
    data
        The serialised message.
    """

    topic: str
    log_ns: int
    data: bytes


class BagFile(Protocol):
    """One file of a bag."""

    @property
    def path(self) -> Path:
        """The file."""
        ...

    @property
    def topics(self) -> tuple[Topic, ...]:
        """Its topics."""
        ...

    def messages(self, names: Collection[str], start_ns: int | None = None) -> Iterator[Message]:
        """Give the messages of some topics one by one, in an order that is always the same.

        Parameters
        ----------
        names
            Names of the topics.
        start_ns
            Leave out what was recorded before.

        Raises
        ------
        RecordingError
            If the file is damaged.
        """
        ...


@contextmanager
def refusing_damage(path: Path, advice: str) -> Iterator[None]:
    """Turn whatever goes wrong inside a reader of files of unknown origin into one error.

    Raises
    ------
    RecordingError
        If anything went wrong.
    """
    try:
        yield
    except RecordingError as error:
        # Only this place knows the file.
        if str(error).startswith(str(path)):
            raise
        raise RecordingError(f"{path}: {error}; {advice}") from None
    except OspcError:
        raise
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror}); check the file and its rights") from None
    except Exception as error:
        said = escaped(said_by(error, 120))
        why = f" ({said})" if said else ""
        raise RecordingError(f"{path}: the bag is damaged or ends early{why}; {advice}") from None


def as_ros2_type(name: str) -> str:
    """Return the name of a type as ROS 2 writes it: ``std_msgs/Float64`` becomes ``std_msgs/msg/Float64``."""
    package, _, rest = name.partition("/")
    return name if not rest or "/" in rest else f"{package}/msg/{rest}"
