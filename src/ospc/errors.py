"""The exceptions of the library, and helpers for their messages.

Every error the library raises on purpose derives from :class:`OspcError`. The message is one sentence that names
the file or value, says what is wrong with it and what to do. The command line prints it unchanged.
"""

from __future__ import annotations

import difflib
import errno
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import SupportsIndex, TypeVar

Named = TypeVar("Named")

UNREADABLE = (
    *(LookupError, TypeError, ValueError, RecursionError, MemoryError, EOFError, OverflowError),
    *(NotImplementedError, RuntimeError, SyntaxError, tokenize.TokenError),
    *(struct.error, zlib.error, zipfile.BadZipFile),
)
"""Exceptions that zipfile, numpy and json raise for malformed content."""

_MESSAGE_CHARACTERS = 1500
"""Longest message before its middle is cut: some libraries quote entire files."""

_SHOWN_CHARACTERS, _SHOWN_ITEMS = 40, 3
"""Longest quotation, and most items of a list, that a message shows."""

_EXTREME = 1e15
"""Magnitude above which numbers in messages are written with an exponent."""

_CLOSE = 0.75
"""Similarity of names, from 0 to 1, above which one is probably a misspelling of the other."""

_NO_SPACE, _FREE_SPACE = (errno.ENOSPC, errno.EDQUOT), "free some space"
"""Errors of a full disk or quota, and what to do about them."""

_NO_MEMORY = ("std::bad_alloc", "Failed to allocate", "failed to map segment", "Cannot allocate memory")
"""How libraries and the loader report running out of memory."""


class OspcError(Exception):
    """Base of all errors raised by the library.

    The message is one sentence. It is escaped, so that it stays on one line and contains no control sequences for
    the terminal. If it is very long, its middle is cut. A ``remedy`` follows the message after a semicolon;
    :attr:`problem` is the message without it.
    """

    def __init__(self, message: str = "", remedy: str = "") -> None:
        self.problem = _shortened(message)
        super().__init__(_shortened(f"{message}; {remedy}") if remedy else self.problem)


class RecordingError(OspcError):
    """A recording cannot be opened, or its content is not valid."""


class FrameError(RecordingError):
    """A frame cannot be read; others may still be usable."""


class ExposureError(RecordingError):
    """Exposures are missing or invalid, or do not match the images."""


class FormatError(OspcError):
    """A calibration or parameter file does not follow its format."""


class SettingError(OspcError):
    """A setting has an invalid value."""


class NotObservableError(OspcError):
    """The data do not determine the requested quantity."""


class MissingExtraError(OspcError):
    """A feature needs an optional dependency, which an extra of this package installs."""


@contextmanager
def needs_extra(feature: str, extra: str) -> Iterator[None]:
    """Turn an ImportError into a :class:`MissingExtraError`; ``feature`` is the subject of its message."""
    try:
        yield
    except ImportError:
        raise MissingExtraError(f"{feature} needs an optional dependency: pip install 'ospc[{extra}]'") from None


@contextmanager
def os_error_as(kind: type[OspcError], what: str, remedy: str = "") -> Iterator[None]:
    """Turn an OSError into an error of this kind with the message ``what (reason); remedy``."""
    try:
        yield
    except OSError as error:
        if error.errno in _NO_SPACE:
            remedy = _FREE_SPACE
        raise kind(f"{what} ({error.strerror or error})", remedy) from None


def path_of(value: object, kind: type[OspcError], what: str) -> Path:
    """Return a path given as text or path; an error of this kind, with ``what`` it should be, if it is neither."""
    if not isinstance(value, str | Path):
        raise kind(f"{what} must be given by its path, a text or pathlib.Path, not {type(value).__name__}")
    return Path(value)


def message_of(error: BaseException, most: int | None = None) -> str:
    """Return the message of an error on one line, or its type if it has none, cut after ``most`` characters."""
    return (" ".join(str(error).split()) or type(error).__name__)[:most]


def one_line(error: BaseException) -> str:
    """Return the message of an error on one line, with the type of the error if it is unexpected."""
    text = message_of(error)
    if isinstance(error, MemoryError) or any(sign in text for sign in _NO_MEMORY):
        return "not enough memory; close other programs, or raise the memory limit of this one (ulimit -v)"
    if isinstance(error, OSError) and error.strerror:
        reason = f"{error.strerror}; {_FREE_SPACE}" if error.errno in _NO_SPACE else error.strerror
        return reason if error.filename is None else f"{error.filename}: {reason}"
    name = type(error).__name__
    return text if isinstance(error, OspcError) else f"unexpected {name}: {text}".removesuffix(f": {name}")


def _shortened(message: str) -> str:
    text, half = escaped(message), _MESSAGE_CHARACTERS // 2
    return text if len(text) <= _MESSAGE_CHARACTERS else f"{text[:half]} … {text[-half:]}"


def quoted(text: str) -> str:
    """Return a text in quotes on one line, shortened and with control characters escaped."""
    if len(text) > _SHOWN_CHARACTERS:
        text = text[:_SHOWN_CHARACTERS] + "…"
    return f"'{escaped(text)}'"


def escaped(text: str) -> str:
    """Return a text on one line, with everything escaped that a terminal would interpret."""
    if text.isprintable():  # almost always, and some texts are entire images
        return text
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def listed(items: Sequence[object]) -> str:
    """Return the first few items as 'a, b, c and 7 more'."""
    shown = ", ".join(escaped(str(item)) for item in items[:_SHOWN_ITEMS])
    rest = len(items) - _SHOWN_ITEMS
    return f"{shown} and {rest} more" if rest > 0 else shown


def known_names(name: str, known: Sequence[str]) -> str:
    """Return which of the known names an unknown one resembles, or all of them if it resembles none."""
    close = difflib.get_close_matches(name, known, cutoff=_CLOSE)
    return f"did you mean {' or '.join(close)}?" if close else f"known: {', '.join(known)}"


def named(what: str, name: str, known: Mapping[str, Named]) -> Named:
    """Return the entry of a name; SettingError if there is none, with ``what`` it should be."""
    if name not in known:
        raise SettingError(f"no {what} is called '{name}'; {known_names(name, list(known))}")
    return known[name]


def counted(number: SupportsIndex, noun: str) -> str:
    """Return a number with its noun, such as '1 frame' and '2 frames'."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def plain(number: float, digits: int = 4) -> str:
    """Return a number with this many significant digits, and without an exponent unless it is extreme."""
    rounded = f"{number:.{digits}g}"
    return f"{float(rounded):.0f}" if "e+" in rounded and abs(number) < _EXTREME else rounded
