"""Damaged files that once raised a built-in exception; found by ``benchmarks/fuzz_parsers.py``."""

from __future__ import annotations

import os
import struct
import threading
import tracemalloc
import zipfile

import pytest

from ospc.batch.manifest import read_manifest
from ospc.errors import FormatError, OspcError, SettingError
from ospc.formats.files import json_object, read_bytes
from ospc.formats.validation import validate
from ospc.photometry.calibration import Calibration
from ospc.photometry.vignette import RasterVignette
from ospc.recording.list_search import is_output


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


def test_quoted_text_in_messages_is_on_one_line(tmp_path):
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
def test_too_little_memory_is_reported_as_such(error):
    from ospc.errors import one_line

    assert one_line(error).startswith("not enough memory")


@pytest.mark.parametrize(
    "header", ["{'descr': '<f4', 'shape': (2, 2), }   }", "{" * 3000, "{'descr': '<f4', 'shape': ("]
)
def test_a_vignette_map_whose_header_is_no_header_is_refused(tmp_path, header):
    place = tmp_path / "raster.vignette.npz"
    with zipfile.ZipFile(place, "w") as archive:
        archive.writestr("vignette.npy", b"\x93NUMPY\1\0" + struct.pack("<H", len(header)) + header.encode())
    with pytest.raises(FormatError, match="the vignette map cannot be read"):
        RasterVignette.read_map(place, (2, 2), {})


def test_the_middle_of_long_messages_is_left_out(tmp_path):
    place = tmp_path / "raster.vignette.npz"
    with zipfile.ZipFile(place, "w") as archive:
        archive.writestr("vignette.npy", b"")
    forged = place.read_bytes().replace(b"\x0c\0", b"\x00\x40", 1).replace(b"vignette.npyPK", bytes(2**14) + b"PK", 1)
    place.write_bytes(forged)  # the name in the member's own header is different, and long
    with pytest.raises(FormatError) as caught:
        RasterVignette.read_map(place, (2, 2), {})
    assert len(str(caught.value)) < 2000
    assert len(str(OspcError("a" * 10**6 + "; do this"))) < 2000
    assert str(OspcError("a" * 10**6 + "; do this")).endswith("; do this")


def test_what_states_no_size_takes_no_more_memory_than_it_holds(tmp_path):
    (tmp_path / "empty").write_bytes(b"")
    tracemalloc.start()
    assert read_bytes(tmp_path / "empty", 2**30) == b""
    assert tracemalloc.get_traced_memory()[1] < 2**23
    tracemalloc.stop()
    os.mkfifo(tmp_path / "pipe")
    content = bytes(range(256)) * 10**4
    writer = threading.Thread(target=(tmp_path / "pipe").write_bytes, args=(content,))
    writer.start()
    assert read_bytes(tmp_path / "pipe") == content
    writer.join()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_in_the_place_of_a_json_file_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "calibration.json")
    assert json_object(tmp_path / "calibration.json") == {}
    assert not is_output(tmp_path)
