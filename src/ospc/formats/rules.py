"""Rules of parameter files: each is stated once, and ``validate`` and ``repair`` walk over the same ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Generic, Literal, TypeAlias, TypeVar

from ospc.arrays import ImageSize
from ospc.errors import FormatError

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

_REPAIR = "run with --repair for a repaired copy"


@dataclass(frozen=True)
class Finding:
    """A rule that a parameter file breaks.

    Attributes
    ----------
    severity
        How serious it is.
    rule
        The rule and what breaks it, with figures.
    effect
        What the program does with the file; continues a sentence that begins with "it".
    remedy
        What to do; empty if nothing needs to be done.
    file
        The file; filled in by :meth:`Format.findings`.
    """

    severity: Severity
    rule: str
    effect: str
    remedy: str = ""
    file: str = ""


@dataclass(frozen=True)
class Context:
    """What a rule knows besides the file itself.

    Attributes
    ----------
    program
        The program whose rules apply.
    size
        Width and height of the images in pixels; None if unknown.
    images
        File names of the recording's images, sorted; None if unknown.
    """

    program: Program
    size: ImageSize | None = None
    images: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Rule(Generic[Document]):
    """One rule of a format.

    Attributes
    ----------
    check
        Returns a finding if a document breaks the rule, else None.
    repair
        Returns a document that keeps the rule, and a sentence about what was changed. Raises FormatError, without
        the file's name, if content would have to be invented. None if the rule has no repair.
    """

    check: Callable[[Document, Context], Finding | None]
    repair: Callable[[Document, Context], tuple[Document, str]] | None = None


@dataclass(frozen=True)
class Format(Generic[Document]):
    """One kind of parameter file: how to read and write it, and the rules it must keep.

    Attributes
    ----------
    read
        Reads a file; raises FormatError if it is unreadable.
    write
        Writes a document.
    rules
        Checked independently of each other, repaired in this order.
    """

    read: Callable[[Path], Document]
    write: Callable[[Document, Path], object]
    rules: tuple[Rule[Document], ...]

    def findings(self, path: Path, context: Context) -> tuple[Finding, ...]:
        """Return the findings about a file, in the order of the rules.

        A finding proposes a repair only if the file as a whole can be repaired. An unreadable file is one finding.
        """
        try:
            document = self.read(path)
        except FormatError as error:
            reason = str(error).removeprefix(f"{path}: ")
            return (Finding("error", reason, UNCORRECTED[context.program], file=str(path)),)
        broken = [(rule, finding) for rule in self.rules if (finding := rule.check(document, context)) is not None]
        try:
            repairable = bool(self._repaired(document, context)[1])
        except FormatError:
            repairable = False
        return tuple(
            replace(
                finding,
                remedy=", or ".join(filter(None, (finding.remedy, _REPAIR)))
                if repairable and rule.repair is not None and finding.severity != "note"
                else finding.remedy,
                file=str(path),
            )
            for rule, finding in broken
        )

    def repaired(self, path: Path, context: Context) -> tuple[Document, tuple[str, ...]]:
        """Return a document that breaks no rule with an error, and what was changed, one sentence each.

        Notes alone do not call for a repair: they are repaired only along with something more serious.

        Raises
        ------
        FormatError
            If the file is unreadable, or a repair would have to invent its content.
        """
        document = self.read(path)
        try:
            return self._repaired(document, context)
        except FormatError as error:
            raise FormatError(f"{path}: {error}") from None

    def _repaired(self, document: Document, context: Context) -> tuple[Document, tuple[str, ...]]:
        found = [(rule, rule.check(document, context)) for rule in self.rules]
        serious = any(rule.repair and finding and finding.severity != "note" for rule, finding in found)
        changes: list[str] = []
        for rule in self.rules:
            finding = rule.check(document, context)
            if finding is None or (finding.severity == "note" and not serious):
                continue
            if rule.repair is not None:
                document, change = rule.repair(document, context)
                changes.append(change)
            elif finding.severity == "error":
                raise FormatError("; ".join(filter(None, (finding.rule, finding.remedy))))
        return document, tuple(changes)
