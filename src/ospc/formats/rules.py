"""Rules of parameter files: each is stated once, and ``validate`` and ``repair`` both follow it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Generic, Literal, TypeAlias, TypeVar

from ospc.arrays import ImageSize
from ospc.errors import FormatError
from ospc.formats.files import BYTE_ORDER_MARK

Program: TypeAlias = Literal["dso", "mono"]
"""``dso``: DSO and its descendants; ``mono``: the tools of the TUM monocular data set."""

Kind: TypeAlias = Literal["pcalib", "vignette", "times", "camera"]
"""The kinds of parameter files."""

Severity: TypeAlias = Literal["error", "warning", "note"]
"""``error``: the program refuses the file or computes nonsense with it; ``warning``: it accepts the file but hardly
uses it as intended; ``note``: worth knowing."""

Document = TypeVar("Document")
"""What a file of one kind is read into before its rules are checked."""

UNCORRECTED = {
    "dso": "prints one line and runs on uncorrected images, although mode 0 assumes that they are corrected",
    "mono": "prints one line and corrects neither response nor vignette",
}
"""What each program does when it rejects a response or vignette."""

MOST_INTERPOLATED = 0.1
"""Largest share of the values of a file that a repair interpolates."""

_WITHOUT_MARK = "save it as UTF-8 without byte order mark (BOM)"
_REPAIR = "run with --repair for a repaired copy"


@dataclass(frozen=True)
class Finding:
    """A rule that a parameter file breaks.

    ``rule`` says what it is and what breaks it, with figures, ``effect`` what the program does with the file, as the
    rest of a sentence that begins with "it", and ``remedy`` what to do; it is empty if nothing needs to be done.
    """

    severity: Severity
    rule: str
    effect: str
    remedy: str
    file: str


@dataclass(frozen=True)
class Context:
    """What a rule knows besides the file: size and sorted file names of the recording's images, None if unknown."""

    program: Program
    size: ImageSize | None = None
    images: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Broken:
    """A rule that a document breaks: a :class:`Finding` without its file, and how to repair the document.

    ``repair``, None if there is none, returns a document that keeps the rule, and a sentence about what was changed.
    It raises FormatError, without the file's name, if content would have to be invented.
    """

    severity: Severity
    rule: str
    effect: str
    remedy: str = ""
    repair: Callable[[Any, Context], tuple[Any, str]] | None = None


def mark_before(text: str, effect: str, repair: Callable[[Any, Context], tuple[Any, str]]) -> Iterator[Broken]:
    """Yield the rule that a text with a byte order mark breaks; ``repair`` removes it."""
    if text.startswith(BYTE_ORDER_MARK):
        rule = "no byte order mark before the first number; there is one"
        yield Broken("error", rule, effect, _WITHOUT_MARK, repair)


@dataclass(frozen=True)
class Format(Generic[Document]):
    """One kind of parameter file: how to read and write it, and the rules it must keep.

    ``read`` raises FormatError if a file is unreadable; ``checks`` yield the rules that a document breaks, in the
    order in which they must be repaired.
    """

    read: Callable[[Path], Document]
    write: Callable[[Document, Path], object]
    checks: tuple[Callable[[Document, Context], Iterator[Broken]], ...]

    def findings(self, path: Path, context: Context) -> tuple[Finding, ...]:
        """Return the findings about a file; they propose a repair only if the file as a whole can be repaired."""
        try:
            document = self.read(path)
        except FormatError as error:
            reason = str(error).removeprefix(f"{path}: ")
            return (Finding("error", reason, UNCORRECTED[context.program], "", str(path)),)
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
            found.append(Finding(broken.severity, broken.rule, broken.effect, remedy, str(path)))
        return tuple(found)

    def repaired(self, path: Path, context: Context) -> tuple[Document, tuple[str, ...]]:
        """Return a document that breaks no rule with an error, and what was changed, one sentence each.

        Notes alone do not call for a repair: they are repaired only along with something more serious. FormatError if
        the file is unreadable, or a repair would have to invent its content.
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
