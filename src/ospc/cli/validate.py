"""``ospc validate``: check parameter files against the rules of the programs that read them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ospc.cli.options import AS_JSON, IMAGE_SIZE, argument, declared, option
from ospc.cli.terminal import print_json, say, styled

if TYPE_CHECKING:
    from ospc.formats.rules import Program
    from ospc.formats.validation import Repair, Validation

_COLOURS = {"error": "red", "warning": "yellow", "note": "blue"}


@declared("validate")
def command(
    *,
    files: tuple[Path, ...] = argument(required=True),
    program: Program = option(
        "Apply the rules of DSO and its descendants, or of the TUM monocular data set's own tools.",
        "--for",
        type=click.Choice(["dso", "mono"]),
        default="dso",
    ),
    size: tuple[int, int] | None = IMAGE_SIZE,
    mend: bool = option("Write repaired copies <name>.repaired.<ext>.", "--repair"),
    as_json: bool = AS_JSON,
) -> int:
    """Check pcalib.txt, vignette.png, times.txt and camera.txt, or folders that contain them.

    Reports what the program that reads the files would do with them, and how to fix problems. The exit code is 0 if
    all files are valid, even with warnings and notes; 1 if a file is invalid or unreadable; 2 for usage errors.
    """
    from ospc.errors import OspcError
    from ospc.formats.validation import repair, validate

    result = validate(files, program, size)
    repairs: list[Repair] = []
    failures: list[str] = []
    for file in result.files if mend else ():
        try:
            repairs.append(repair(file, program, result.size))
        except OspcError as error:
            failures.append(str(error))
    if as_json:
        content = {
            "program": result.program,
            "size": result.size,
            "valid": result.valid,
            "files": [{"path": str(file.path), "kind": file.kind} for file in result.files],
            "findings": [vars(finding) for finding in result.findings],
            "repairs": [
                {"source": str(r.source), "path": str(r.path) if r.changes else None, "changes": r.changes}
                for r in repairs
            ],
            "not_repaired": failures,
        }
        print_json(content)
    else:
        _print_text(result, repairs, failures)
    return 0 if result.valid else 1


def _print_text(result: Validation, repairs: list[Repair], failures: list[str]) -> None:
    reader = {"dso": "DSO", "mono": "the monocular data set's tools"}[result.program]
    for file in result.files:
        findings = [finding for finding in result.findings if finding.file == str(file.path)]
        broken = any(finding.severity == "error" for finding in findings)
        verdict = styled("invalid", fg="red") if broken else styled("valid", fg="green")
        say(f"{file.path}: ", verdict, f" {file.kind} for {reader}")
        for finding in findings:
            say("  ", styled(finding.severity, fg=_COLOURS[finding.severity]), f": {finding.rule}")
            say(f"    it {finding.effect}")
            if finding.remedy:
                say(f"    remedy: {finding.remedy}")
    for repair in repairs:
        if repair.changes:
            say(f"{repair.path}: repaired copy of {repair.source.name}")
            for change in repair.changes:
                say(f"  {change}")
        else:
            say(f"{repair.source}: nothing to repair")
    for failure in failures:
        say(f"not repaired: {failure}")
