"""Lists of exposures in the folder of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ospc.errors import ExposureError, RecordingError, listed
from ospc.recording.exposure_lists import IMAGE_LIST
from ospc.recording.list_columns import columns_of
from ospc.recording.table_text import read_table_text

_NAMES = ("times.txt", "exposures.txt", "exposures.csv", IMAGE_LIST)
TEXT_SUFFIXES = (".csv", ".txt", ".json")
"""Suffixes of files that the user may take for a list of exposures."""

_MAX_CSV_FILES = 32
"""Maximum number of CSV files in a folder that are searched for exposures."""


def lists_in(folder: Path) -> list[Path]:
    """Return the lists of exposures in a folder, recognised by name or header."""
    named = [folder / name for name in _NAMES if (folder / name).is_file()]
    csv_files = [p for p in sorted(folder.glob("*.csv")) if p.is_file() and p not in named][:_MAX_CSV_FILES]
    return named + [p for p in csv_files if names_exposures(p)]


def names_exposures(path: Path) -> bool:
    """Return whether a file exists whose header, which may be a comment, names a column of exposures."""
    try:
        columns, _ = columns_of(read_table_text(path), str(path))
    except ExposureError:
        return True
    except RecordingError:
        return False
    return columns.named and columns.exposure is not None


def only_list(found: Sequence[Path], place: Path, advice: str) -> Path:
    """Return the only list of exposures; ExposureError if there are several or, with ``advice``, if there is none."""
    if len(found) > 1:
        named = [path.name if path.parent in (place, place.parent) else path for path in found]
        raise ExposureError(f"{place}: has several lists of exposures ({listed(named)}); keep only the right one")
    if not found:
        folder = place if place.is_dir() else place.parent
        others = sorted(p.name for p in folder.iterdir() if p.suffix.lower() in TEXT_SUFFIXES)
        needed = "a list is a CSV file with a column such as exposure_ms"
        unused = f" (not used: {listed(others)}; {needed})" if others else ""
        raise ExposureError(f"{place}: has no list of exposures{unused}; {advice}")
    return found[0]
