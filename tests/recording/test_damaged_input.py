"""A few damaged inputs for every parser; ``benchmarks/fuzz_parsers.py`` tries many more."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest
from hypothesis import given, settings
from parser_targets import LIBRARIES, Target, attempt, damaged, targets

NAMES = (
    "times.txt",
    "exposures.csv",
    "image_list.txt",
    "image file",
    "images.zip",
    "EXIF",
    "HEIC photograph",
    "raw photograph",
    "ROS 1 bag",
    "ROS 2 bag, sqlite3",
    "ROS 2 bag, mcap",
    "recording in mcap",
    "image message",
    "image message of ROS 1",
    "exposure message",
    "description of messages",
    "video",
    "region",
    "calibration.json",
    "calibration.json to start from",
    "vignette map",
    "state.ospc",
    "values of a state",
    "arrays of a state",
    "result of a batch",
    "pcalib.txt",
    "vignette.png",
    "hugin .pto",
    "Adobe .lcp",
    "lensfun .xml",
    "OpenCV .yml",
    "table of a batch",
    "trajectory",
    "exposures of a program",
    "validate pcalib.txt",
    "validate vignette.png",
    "validate times.txt",
    "validate camera.txt",
    "camera.txt",
    "mask",
)

MISSING = {name for name, library in LIBRARIES.items() if find_spec(library) is None}
"""Parsers whose library is not installed."""


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Target]:
    return targets(tmp_path_factory.mktemp("samples"))


def test_every_parser_is_tried(known: dict[str, Target]) -> None:
    assert set(known) == set(NAMES) - MISSING


TRIED = [
    pytest.param(name, marks=pytest.mark.skipif(name in MISSING, reason="needs an extra that is not installed"))
    for name in NAMES
]


@pytest.mark.parametrize("name", TRIED)
def test_undamaged_samples_are_accepted(known: dict[str, Target], name: str, tmp_path: Path) -> None:
    accepted = [attempt(known[name], sample, tmp_path) for sample in known[name].samples]
    assert any(accepted)


@pytest.mark.parametrize("name", TRIED)
def test_any_input_is_read_or_refused(known: dict[str, Target], name: str, tmp_path: Path) -> None:
    @settings(max_examples=30, database=None)
    @given(damaged(known[name]))
    def one(data: bytes) -> None:
        attempt(known[name], data, tmp_path)

    one()
