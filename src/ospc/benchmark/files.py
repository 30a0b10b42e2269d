"""The files a benchmark leaves: everything for machines, tables for people."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import ospc
from ospc.atomic import write_atomically
from ospc.benchmark.picture import draw_errors
from ospc.benchmark.store import source_hash
from ospc.benchmark.summary import METRICS, CaseResult, groups_of, methods_of, spread
from ospc.benchmark.tables import all_tables, as_csv, as_markdown
from ospc.errors import SettingError
from ospc.settings import as_dict, preset
from ospc.versions import versions

SCHEMA = "ospc-benchmark-accuracy/1"


def as_json(results: Sequence[CaseResult], presets: Sequence[str], notes: Sequence[str]) -> dict[str, Any]:
    """Return everything as JSON-compatible values: the content of ``results.json``, but for the curves."""
    return {
        "schema": SCHEMA,
        "versions": versions(),
        "source_sha256": source_hash(),
        "presets": {name: as_dict(preset(name)) for name in presets},
        "notes": list(notes),
        "summary": {group: _summary([r for r in results if r.case.group == group]) for group in groups_of(results)},
        "cases": [
            {
                "name": result.case.name,
                "group": result.case.group,
                "factors": result.case.factors,
                "rows": [{k: v for k, v in row.as_dict().items() if k != "curves"} for row in result.rows],
            }
            for result in results
        ],
    }


def _summary(results: Sequence[CaseResult]) -> dict[str, dict[str, Any]]:
    return {
        method: {m.figure: vars(found) for m in METRICS if (found := spread(results, method, m)) is not None}
        for method in methods_of(results)
    }


def write_results(
    folder: str | Path, results: Sequence[CaseResult], presets: Sequence[str], notes: Sequence[str]
) -> tuple[list[Path], list[str]]:
    """Write ``results.json``, ``results.csv``, ``table.md`` and, where possible, ``errors.png``.

    Parameters
    ----------
    folder
        Where; it is made.
    results
        What is finished.
    presets
        The presets that were run.
    notes
        What was left out or replaced.

    Returns
    -------
    tuple
        The files, and why the picture is missing if it is.

    Raises
    ------
    SettingError
        If they cannot be written.
    """
    place = Path(folder)
    contents = {
        "results.json": json.dumps(as_json(results, presets, notes), indent=1, allow_nan=False) + "\n",
        "results.csv": as_csv(results),
        "table.md": as_markdown(all_tables(results), [*notes, _made_with()]),
    }
    written: list[Path] = []
    try:
        place.mkdir(parents=True, exist_ok=True)
        for name, content in contents.items():
            written.append(write_atomically(place / name, content.encode()))
        return [*written, draw_errors(results, place / "errors.png")], []
    except OSError as error:
        raise SettingError(f"{place}: cannot be written ({error}); choose another folder") from None


def _made_with() -> str:
    made = ", ".join(f"{name} {version}" for name, version in versions().items())
    return f"Made with {made}; source {source_hash()[:12]}; {ospc.__name__} bench accuracy."
