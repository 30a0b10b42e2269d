"""Damaged files that once ended in an error of Python's own; found by ``benchmarks/fuzz_parsers.py``."""

from __future__ import annotations

import pytest

from ospc.batch.manifest import read_manifest
from ospc.errors import SettingError
from ospc.formats.validation import validate
from ospc.photometry.calibration import Calibration


def test_a_setting_of_hundreds_of_digits_is_refused(tmp_path):
    table = tmp_path / "batch.csv"
    table.write_text(f"recording,options\na,rounds={'9' * 400}\n")
    with pytest.raises(SettingError, match="takes a positive number"):
        read_manifest(str(table))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("times.txt", f"0 {'9' * 400} 1.0\n1 {'9' * 400} 2.0\n"),
        ("camera.txt", f"Pinhole 100 100 48 36 0\n{'9' * 400} 72\ncrop\n96 72\n"),
    ],
)
def test_infinite_numbers_are_findings(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    assert validate([tmp_path / name], "dso", (96, 72)).findings


def test_what_a_message_quotes_is_on_one_line(tmp_path):
    from ospc.errors import OspcError

    place = tmp_path / "calibration.json"
    place.write_text('{"schema": "\\u001b[31m\\n"}')
    with pytest.raises(OspcError) as caught:
        Calibration.load(place)
    assert str(caught.value).isprintable()
    assert str(OspcError("a\x1b[31m\nb")).isprintable()


@pytest.mark.parametrize(
    "error",
    [MemoryError(), RuntimeError("std::bad_alloc"), ImportError("x.so: failed to map segment from shared object")],
)
def test_too_little_memory_is_said_as_such(error):
    from ospc.errors import one_line

    assert one_line(error).startswith("there is not enough memory")
