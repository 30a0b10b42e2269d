"""Rules of parameter files, which ``validate`` and ``repair`` share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any, Generic, Literal, TypeAlias, TypeVar

from ospc.arrays import ImageSize
from ospc.errors import FormatError, escaped
from ospc.formats.files import BYTE_ORDER_MARK

Program: TypeAlias = Literal["dso", "mono"]
"""``dso``: DSO and its descendants; ``mono``: the tools of the TUM monocular data set."""

Kind: TypeAlias = Literal["pcalib", "vignette", "times", "camera"]
"""The kinds of parameter files."""

Severity: TypeAlias = Literal["error", "warning", "note"]
"""``error``: the program rejects the file or computes nonsense with it; ``warning``: it accepts the file but probably
does not use it as intended; ``note``: worth knowing."""

Document = TypeVar("Document")
"""Type of the content of a file whose rules are checked."""

UNCORRECTED = {
    "dso": "prints one line and continues with uncorrected images, although mode 0 assumes that they are corrected",
    "mono": "prints one line and corrects neither response nor vignette",
}
"""Effect of a rejected response or vignette in each program."""

MOST_INTERPOLATED = 0.1
"""Largest share of the values in a file that a repair interpolates."""

_WITHOUT_MARK = "save it as UTF-8 without a byte order mark (BOM)"
_REPAIR = "run 'ospc validate --repair FILE' for a repaired copy"


@dataclass(frozen=True)
class Context:
    """The context of a file: the program, and size and sorted file names of the images, None if unknown."""

    program: Program
    size: ImageSize | None = None
    images: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Finding:
    """A rule that a parameter file breaks.

    ``rule`` states the rule and how the file breaks it. ``effect`` states what the program does with the file,
    continuing a sentence that begins with "it". ``remedy`` states what to do; it is empty if nothing is needed.
    """

    severity: Severity
    rule: str
    effect: str
    remedy: str = ""
    file: str = field(default="", kw_only=True)


@dataclass(frozen=True)
class Broken(Finding):
    """A rule that a document breaks, and a repair.

    ``repair``, or None, returns a document that follows the rule, and a sentence about the change. It raises
    FormatError, without the name of the file, if content would have to be invented.
    """

    repair: Callable[[Any, Context], tuple[Any, str]] | None = None


def mark_before(text: str, effect: str, document: Callable[[str], Document]) -> Iterator[Broken]:
    """Yield a broken rule if a text begins with a byte order mark; the repair makes the document without it.

    This must be the first rule, because its repair starts from the text as it was read.
    """

    def without(_document: Document, _context: Context) -> tuple[Document, str]:
        return document(text.removeprefix(BYTE_ORDER_MARK)), "removed the byte order mark"

    if text.startswith(BYTE_ORDER_MARK):
        rule = "no byte order mark at the beginning; there is one"
        yield Broken("error", rule, effect, _WITHOUT_MARK, without)


@dataclass(frozen=True)
class Format(Generic[Document]):
    """A kind of parameter file: how to read and write it, and its rules.

    ``read`` raises FormatError if a file is unreadable. ``checks`` yield the rules that a document breaks, in the
    order in which they must be repaired.
    """

    read: Callable[[Path], Document]
    write: Callable[[Document, Path], object]
    checks: tuple[Callable[[Document, Context], Iterator[Broken]], ...]

    def findings(self, path: Path, context: Context) -> tuple[Finding, ...]:
        """Return the findings about a file; they only suggest a repair if the entire file can be repaired."""
        try:
            document = self.read(path)
        except FormatError as error:
            reason = str(error).removeprefix(f"{escaped(str(path))}: ")
            return (Finding("error", reason, UNCORRECTED[context.program], file=str(path)),)
        return self.findings_in(document, path, context)

    def findings_in(self, document: Document, path: Path, context: Context) -> tuple[Finding, ...]:
        """Return the findings about a document that was read from a file."""
        try:
            repairable = bool(self._repaired(document, context)[1])
        except FormatError:
            repairable = False
        found = []
        for broken in self._broken(document, context):
            offered = repairable and broken.repair is not None and broken.severity != "note"
            remedy = ", or ".join(filter(None, (broken.remedy, _REPAIR if offered else "")))
            found.append(Finding(broken.severity, broken.rule, broken.effect, remedy, file=str(path)))
        return tuple(found)

    def repaired(self, path: Path, context: Context) -> tuple[Document, tuple[str, ...]]:
        """Return a document without errors, and a sentence about each change.

        Notes are only repaired together with something more serious.

        Raises
        ------
        FormatError
            If the file is unreadable, or a repair would have to invent content.
        """
        document = self.read(path)
        try:
            return self._repaired(document, context)
        except FormatError as error:
            raise FormatError(f"{path}: {error}") from None

    def _broken(self, document: Document, context: Context) -> Iterator[Broken]:
        return chain.from_iterable(check(document, context) for check in self.checks)

    def _repaired(self, document: Document, context: Context) -> tuple[Document, tuple[str, ...]]:
        serious = any(broken.repair and broken.severity != "note" for broken in self._broken(document, context))
        done: list[object] = []
        changes: list[str] = []

        def needs_action(broken: Broken) -> bool:
            if broken.repair is None:
                return broken.severity == "error"
            return broken.repair not in done and (serious or broken.severity != "note")

        while broken := next(filter(needs_action, self._broken(document, context)), None):
            if broken.repair is None:
                raise FormatError("; ".join(filter(None, (broken.rule, broken.remedy))))
            document, change = broken.repair(document, context)
            done.append(broken.repair)
            changes.append(change)
        return document, tuple(changes)
