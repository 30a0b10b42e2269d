"""What can go wrong, as one family of exceptions.

Every error the library raises on purpose derives from :class:`OspcError`. Its message is one sentence that names
the file or value, says what is wrong with it and what to do; the command prints it as it stands.
"""

from __future__ import annotations

import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import SupportsIndex

UNREADABLE = (
    *(LookupError, TypeError, ValueError, RecursionError, MemoryError, EOFError, OverflowError),
    *(NotImplementedError, RuntimeError, SyntaxError, tokenize.TokenError),
    *(struct.error, zlib.error, zipfile.BadZipFile),
)
"""What zipfile, numpy and json raise for content that somebody forged or another program wrote."""

_MESSAGE_CHARACTERS = 1500
"""Characters of a message before its middle is left out: libraries quote as much of a file as there is."""

_SHOWN_CHARACTERS, _SHOWN_ITEMS = 40, 3
"""Characters of a quotation before it is cut, and items of a list that a message names."""

_NO_MEMORY = ("std::bad_alloc", "Failed to allocate", "failed to map segment", "Cannot allocate memory")
"""What the libraries below, and the loader, say where memory ends."""


class OspcError(Exception):
    """Root of all errors raised by the library.

    The message is one sentence. What it quotes of a file or a name is escaped, so that it stays on one line and no
    terminal obeys it; of a very long one the middle is left out.
    """

    def __init__(self, message: str = "") -> None:
        text = escaped(message)
        half = _MESSAGE_CHARACTERS // 2
        super().__init__(text if len(text) <= _MESSAGE_CHARACTERS else f"{text[:half]} … {text[-half:]}")


class RecordingError(OspcError):
    """A recording cannot be opened or does not hold what a recording must hold."""


class FrameError(RecordingError):
    """One frame cannot be read; the others may still be good."""


class ExposureError(RecordingError):
    """Exposures are missing, invalid, or do not belong to the images."""


class FormatError(OspcError):
    """A calibration or parameter file breaks the rules of its format."""


class SettingError(OspcError):
    """A setting has a value the method cannot work with."""


class NotObservableError(OspcError):
    """What was asked for cannot be known from the data given."""


class MissingExtraError(OspcError):
    """An optional dependency, which an extra of this package brings, is needed for what was asked.

    ``feature`` is what the user asked for, as the subject of a sentence.
    """

    def __init__(self, feature: str, extra: str) -> None:
        super().__init__(f"{feature} needs an optional dependency: pip install 'ospc[{extra}]'")
        self.feature = feature
        self.extra = extra


@contextmanager
def needs_extra(feature: str, extra: str) -> Iterator[None]:
    """Raise a :class:`MissingExtraError` if something cannot be imported."""
    try:
        yield
    except ImportError:
        raise MissingExtraError(feature, extra) from None


@contextmanager
def os_error_as(kind: type[OspcError], what: str, remedy: str = "") -> Iterator[None]:
    """Raise an error of this kind, ``what (reason); remedy``, where the operating system refuses something."""
    try:
        yield
    except OSError as error:
        raise kind(f"{what} ({error.strerror or error}){remedy and f'; {remedy}'}") from None


def said_by(error: BaseException, most: int | None = None) -> str:
    """Return the message of an error on one line, cut after ``most`` characters."""
    return " ".join(str(error).split())[:most]


def one_line(error: BaseException) -> str:
    """Return what an error says on one line; one that nobody expected with its type."""
    text = said_by(error)
    if isinstance(error, MemoryError) or any(sign in text for sign in _NO_MEMORY):
        return "there is not enough memory; end other programs, or allow this one more (ulimit -v)"
    return text if isinstance(error, OspcError) else f"unexpected {type(error).__name__}: {text}".rstrip(": ")


def quoted(text: str) -> str:
    """Return a text from a file in quotes, shortened, on one line, with control characters escaped."""
    if len(text) > _SHOWN_CHARACTERS:
        text = text[:_SHOWN_CHARACTERS] + "…"
    return f"'{escaped(text)}'"


def escaped(text: str) -> str:
    """Return a text from a file on one line, with everything escaped that a terminal would interpret."""
    if text.isprintable():  # nearly always, and some texts are whole pictures
        return text
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def listed(items: Sequence[object]) -> str:
    """Return the first few of many as 'a, b, c and 7 more'."""
    shown = ", ".join(escaped(str(item)) for item in items[:_SHOWN_ITEMS])
    rest = len(items) - _SHOWN_ITEMS
    return f"{shown} and {rest} more" if rest > 0 else shown


def counted(number: SupportsIndex, noun: str) -> str:
    """Return a number with its noun, such as '1 frame' and '2 frames'."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
