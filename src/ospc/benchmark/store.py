"""Finished results on disk, so that a benchmark can be interrupted, resumed and repeated for what has changed."""

from __future__ import annotations

import json
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import scipy

import ospc
from ospc.atomic import write_atomically
from ospc.benchmark.case import Case, Row
from ospc.errors import SettingError
from ospc.settings import as_dict, preset

_SCHEMA = "ospc-benchmark-rows/1"
_DEPENDED_ON = (
    "arrays.py",
    "calibrator.py",
    "settings.py",
    "methods",
    "correspondence",
    "estimation",
    "photometry",
    "simulation",
    "evaluation/metrics.py",
    "benchmark/charts.py",
    "benchmark/chart_photographs.py",
    "benchmark/flat_matches.py",
    "benchmark/held_out.py",
    "benchmark/measured_responses.py",
    "benchmark/real_video.py",
    "benchmark/running.py",
    "benchmark/scoring.py",
    "benchmark/simulated.py",
)
"""Parts of the package whose source a result depends on: what estimates, what simulates, and what judges."""


class Store:
    """Results in a folder, one file each, found again only for the same recording, settings and source.

    Parameters
    ----------
    folder
        Where; it is made when the first result is put there.
    """

    def __init__(self, folder: str | Path) -> None:
        self._folder = Path(folder)

    def get(self, case: Case, preset_name: str) -> list[Row] | None:
        """Return the rows of a case and a preset; None where there are none, or they cannot be read."""
        try:
            content = json.loads(self._place(case, preset_name).read_text(encoding="utf-8"))
            if content["schema"] != _SCHEMA:
                return None
            return [Row.from_dict(row) for row in content["rows"]]
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return None

    def put(self, case: Case, preset_name: str, rows: list[Row]) -> Path:
        """Keep the rows of a case and a preset, and return the path of their file.

        Raises
        ------
        SettingError
            If it cannot be written.
        """
        place = self._place(case, preset_name)
        content = {
            "schema": _SCHEMA,
            "case": case.name,
            "recording": case.describe(),
            "preset": as_dict(preset(preset_name)),
            "source_sha256": source_hash(),
            "rows": [row.as_dict() for row in rows],
        }
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
            return write_atomically(place, (json.dumps(content, indent=1, allow_nan=False) + "\n").encode())
        except OSError as error:
            raise SettingError(f"{place}: cannot be written ({error.strerror}); choose another folder") from None

    def _place(self, case: Case, preset_name: str) -> Path:
        key = key_of(case, preset_name)
        return self._folder / f"{case.name.replace('/', '_')}.{preset_name}.{key[:16]}.json"


def key_of(case: Case, preset_name: str) -> str:
    """Return a hash of all that a result depends on: recording, settings, package, source, libraries."""
    return sha256(
        json.dumps(
            {
                "recording": case.describe(),
                "preset": as_dict(preset(preset_name)),
                "ospc": ospc.__version__,
                "source": source_hash(),
                **_libraries(),
            },
            sort_keys=True,
        ).encode()
    ).hexdigest()


@cache
def source_hash() -> str:
    """Return a hash of the source of all parts that a result depends on, as it was when first asked."""
    root = Path(ospc.__file__).parent
    total = sha256()
    for name in _DEPENDED_ON:
        part = root / name
        for path in sorted(part.rglob("*.py")) if part.is_dir() else [part]:
            total.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return total.hexdigest()


def _libraries() -> dict[str, Any]:
    import cv2

    return {"numpy": np.__version__, "scipy": scipy.__version__, "opencv": cv2.__version__}
