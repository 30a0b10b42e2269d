"""Lists of exposures, read from a text."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import chdir
from pathlib import Path
from tempfile import TemporaryDirectory

from ospc.recording.exposure_lists import read_list, read_times
from ospc.recording.frame_table import FrameTable
from ospc.recording.options import DEFAULT, ReadingOptions


def table_of(
    text: str,
    name: str,
    options: ReadingOptions = DEFAULT,
    *,
    images: Sequence[str] = (),
    numbered: bool = False,
) -> FrameTable:
    """Return the table of a list, which messages call by this name."""
    path = Path(name)
    with TemporaryDirectory() as folder, chdir(folder):
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8", newline="")
        if path.name == "times.txt":
            return read_times(path, options)
        return read_list(path, options, images=images, numbered=numbered)
