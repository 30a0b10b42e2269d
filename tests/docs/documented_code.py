"""The code blocks of the documentation."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"

_FENCE = re.compile(r"^(?P<indent> *)(?P<marks>`{3,})(?P<language>[\w+-]*)\s*$")
_NOTE = re.compile(r"^% (?P<what>exit|not run):? *(?P<text>.*)$")


@dataclass(frozen=True)
class Block:
    """A fenced block of a page.

    Attributes
    ----------
    page
        The page.
    line
        Line at which the block begins, from 1.
    language
        Language of the fence: ``console``, ``python``, …
    text
        Content of the block.
    exit_codes
        Accepted exit codes of the last command: 0 or 3, or those in a comment such as ``% exit 3`` before the block.
    not_run
        Reason why a test cannot run it, from ``% not run: …``; empty if it can.
    """

    page: Path
    line: int
    language: str
    text: str
    exit_codes: tuple[int, ...] = (0, 3)
    not_run: str = ""

    @property
    def place(self) -> str:
        """Page and line, for messages."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    @property
    def commands(self) -> list[list[str]]:
        """The ``ospc`` commands of a shell block, each as its arguments after ``ospc``."""
        if self.language not in ("console", "bash", "sh"):
            return []
        return [words[1:] for words in _command_lines(self.text, self.language) if words[:1] == ["ospc"]]


def _command_lines(text: str, language: str) -> Iterator[list[str]]:
    """Yield the words of every command; in ``console`` blocks, lines without ``$`` are output."""
    for line in text.replace("\\\n", " ").splitlines():
        if language == "console" and not line.startswith("$ "):
            continue
        yield shlex.split(line.removeprefix("$ "), comments=True)


def blocks(page: Path) -> list[Block]:
    """Return the fenced blocks of a page in order."""
    found: list[Block] = []
    lines = page.read_text(encoding="utf-8").splitlines()
    notes: dict[str, str] = {}
    number = 0
    while number < len(lines):
        note, fence = _NOTE.match(lines[number]), _FENCE.match(lines[number])
        number += 1
        if note:
            notes[note["what"]] = note["text"]
        elif fence and fence["language"]:
            first = number
            while lines[number].strip() != fence["marks"]:
                number += 1
            inner = [line.removeprefix(fence["indent"]) for line in lines[first:number]]
            number += 1
            found.append(
                Block(
                    page,
                    first,
                    fence["language"],
                    "\n".join(inner) + "\n",
                    tuple(map(int, notes.get("exit", "0 or 3").split(" or "))),
                    notes.get("not run", ""),
                )
            )
            notes = {}
        elif lines[number - 1].strip():
            notes = {}
    return found


def pages() -> list[Path]:
    """Return every page of the documentation."""
    return sorted(p for p in DOCS.rglob("*.md") if "_build" not in p.parts)
