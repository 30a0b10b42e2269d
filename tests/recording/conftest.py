"""Sample recordings."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from image_samples import encoded, grey

TIMES = "00000 10.0 1.5\n00001 10.1 3.0\n00002 10.2 6.0\n"


@pytest.fixture
def tum_folder(tmp_path: Path) -> Callable[..., Path]:
    """Make a folder with images/ and times.txt."""

    def make(times: str | bytes | None = TIMES, images: dict[str, bytes] | None = None) -> Path:
        place = tmp_path / "made"
        (place / "images").mkdir(parents=True)
        if images is None:
            images = {f"{i:05d}.png": encoded(grey(i)) for i in range(3)}
        for name, data in images.items():
            (place / "images" / name).write_bytes(data)
        if times is not None:
            (place / "times.txt").write_bytes(times.encode() if isinstance(times, str) else times)
        return place

    return make


@pytest.fixture
def tum_archive(tmp_path: Path) -> Callable[..., Path]:
    """Make a folder with images.zip and times.txt."""

    def make(members: dict[str | zipfile.ZipInfo, bytes] | None = None, times: str = TIMES, method: int = 0) -> Path:
        place = tmp_path / "zipped"
        place.mkdir()
        if members is None:
            members = {f"{i:05d}.png": encoded(grey(i)) for i in range(3)}
        with zipfile.ZipFile(place / "images.zip", "w", method) as archive:
            for name, data in members.items():
                archive.writestr(name, data)
        (place / "times.txt").write_text(times)
        return place

    return make
