"""The container returns exactly what was stored, and refuses everything else."""

from __future__ import annotations

import hashlib
import io
import json
import os
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

import ospc.batch.store
import ospc.pooling.pool
import ospc.state.run
from ospc.errors import FormatError
from ospc.state import container
from ospc.state.container import Container

DTYPES = st.sampled_from(["<f8", "<f4", "<i8", "|u1", "<u2", "|b1"])
ARRAYS = DTYPES.flatmap(lambda dtype: arrays.arrays(dtype, arrays.array_shapes(min_dims=0, max_dims=3, min_side=0)))
NAMES = st.from_regex(r"[\w.-]{1,5}", fullmatch=True).filter(str.isascii)
CONTENT = st.dictionaries(st.text(), st.none() | st.booleans() | st.integers() | st.text(), max_size=4)


@pytest.fixture
def saved(tmp_path):
    content = Container("calibrator", 3, {"a": [1, "ä"]}, {"x": np.arange(300.0) / 7, "y": np.arange(5)})
    return container.save(content, tmp_path / "a.ospc")


@pytest.mark.parametrize("module", [ospc.state.run, ospc.pooling.pool, ospc.batch.store])
def test_the_documentation_states_the_versions(module):
    text = (Path(__file__).parents[2] / "docs" / "state.md").read_text(encoding="utf-8")
    assert f"| `{module.KIND}` | {module.VERSION} |" in text


@given(content=CONTENT, stored=st.dictionaries(NAMES, ARRAYS, max_size=3))
def test_what_goes_in_comes_out_bit_for_bit(content, stored):
    data = container.to_bytes(Container("any", 1, content, stored))
    found = container.from_bytes(data, "it")
    assert (found.kind, found.version, found.content) == ("any", 1, content)
    assert list(found.arrays) == list(stored)
    for name, array in stored.items():
        assert found.arrays[name].dtype == array.dtype
        assert found.arrays[name].shape == array.shape
        assert found.arrays[name].tobytes() == array.tobytes()
    assert container.to_bytes(found) == data


@given(data=st.data())
def test_a_file_cut_short_or_changed_anywhere_is_refused(data):
    whole = container.to_bytes(Container("any", 1, {"a": 1}, {"x": np.arange(50.0) / 7}))
    cut = data.draw(st.integers(0, len(whole) - 1))
    changed = bytearray(whole)
    changed[data.draw(st.integers(0, len(whole) - 1))] ^= data.draw(st.integers(1, 255))
    for bad in (whole[:cut], bytes(changed), whole + b"\0"):
        with pytest.raises(FormatError, match=r"^it: "):
            container.from_bytes(bad, "it")


def test_files_of_other_kinds_and_versions_are_refused_by_name(saved, tmp_path):
    assert container.load(saved, "calibrator", 3).content == {"a": [1, "ä"]}
    with pytest.raises(FormatError, match="contains a calibrator state, but a pooled state is needed"):
        container.load(saved, "pooled", 3)
    with pytest.raises(FormatError, match=r"an older version.*create it again"):
        container.load(saved, "calibrator", 4)
    with pytest.raises(FormatError, match="a newer version"):
        container.load(saved, "calibrator", 2)
    other = tmp_path / "calibration.json"
    other.write_text("{}")
    with pytest.raises(FormatError, match=r"not a state file.*; give the state\.ospc of 'ospc calibrate'"):
        container.load(other, "calibrator", 3)
    foreign = tmp_path / "foreign.npz"
    np.savez(foreign, x=np.arange(3))
    with pytest.raises(FormatError, match=r"not a state file.*; give the state\.ospc of 'ospc calibrate'"):
        container.load(foreign, "calibrator", 3)
    with pytest.raises(FormatError, match="there is no such state; give the folder of 'ospc calibrate'"):
        container.load(tmp_path / "none", "calibrator", 3)
    with pytest.raises(FormatError, match="there is no such state"):
        container.load(tmp_path, "calibrator", 3)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / container.STATE_NAME)
    pipe = container.state_in(tmp_path)
    assert container.kind_of(pipe) == ""
    with pytest.raises(FormatError, match="there is no such state"):
        container.load(pipe, "calibrator", 3)


def test_an_earlier_file_survives_a_failure_to_write(saved, monkeypatch):
    before = saved.read_bytes()

    def full(_descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(FormatError, match="No space left on device"):
        container.save(Container("calibrator", 3, {"a": 2}), saved)
    assert saved.read_bytes() == before
    assert [place.name for place in saved.parent.iterdir()] == [saved.name]


def forged(*entries, method=zipfile.ZIP_DEFLATED):
    """Return an archive of entries (name, bytes) with a valid checksum."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", method) as archive:
        for name, data in entries:
            archive.writestr(name, data)
        archive.comment = bytes(64)
    return signed(packed.getvalue())


def signed(data):
    return data[:-64] + hashlib.sha256(data[:-64]).hexdigest().encode()


def array_file(shape, dtype="<f8", data=b"", by_columns=False):
    """Return an .npy file with an arbitrary header."""
    stream = io.BytesIO()
    header = {"descr": dtype, "fortran_order": by_columns, "shape": shape}
    np.lib.format.write_array_header_1_0(stream, header)
    return stream.getvalue() + data


HEAD = {"version": 1, "content": {}}


@pytest.mark.parametrize("head", [b"{}", b"[]", b"", b"{", b"\xff", b"[" * 100_000])
def test_forged_content_is_refused(head):
    with pytest.raises(FormatError, match=r"^it: not readable as a state"):
        container.from_bytes(forged(("any.json", head)), "it")


@pytest.mark.parametrize("change", [{"content": []}, {"version": True}, {"version": "1"}])
def test_content_of_the_wrong_types_is_refused(change):
    with pytest.raises(FormatError, match=r"^it: not readable as a state"):
        container.from_bytes(forged(("any.json", json.dumps(HEAD | change))), "it")


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x93NUMPY\x03\x00",
        array_file((4,)),
        array_file((1,), data=bytes(16)),
        array_file((2**40,)),
        array_file((2**62, 4)),
        array_file((-1,)),
        array_file((1,) * 80, data=bytes(8)),
        array_file((2, 2), by_columns=True, data=bytes(32)),
        array_file((1,), "|O", bytes(8)),
        array_file((1,), "|V8", bytes(8)),
        array_file((1,), [("a", "<f8")], bytes(8)),
    ],
)
def test_forged_arrays_are_refused(data):
    with pytest.raises(FormatError, match=r"^it: not readable as a state"):
        container.from_bytes(forged(("any.json", json.dumps(HEAD)), ("x.npy", data)), "it")


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_other_compressions_are_refused(method):
    with pytest.raises(FormatError, match="is not deflated"):
        container.from_bytes(forged(("any.json", json.dumps(HEAD)), method=method), "it")


def test_content_that_would_fill_the_memory_is_never_unpacked(monkeypatch):
    monkeypatch.setattr("ospc.state.container._MAX_UNPACKED_BYTES", 10**6)
    bomb = forged(("any.json", json.dumps(HEAD)), ("x.npy", bytes(10**7)))
    with pytest.raises(FormatError, match="its content is too large"):
        container.from_bytes(bomb, "it")
    # The same archive, with a central directory that claims a smaller size.
    honest, claimed = (10**7).to_bytes(4, "little"), (10**3).to_bytes(4, "little")
    assert bomb.count(honest) >= 2
    with pytest.raises(FormatError, match="not readable as a state"):
        container.from_bytes(signed(bomb.replace(honest, claimed)), "it")


def test_files_that_are_too_large_are_not_read(saved, monkeypatch):
    monkeypatch.setattr("ospc.state.container._MAX_FILE_BYTES", saved.stat().st_size - 1)
    with pytest.raises(FormatError, match="no state is larger than"):
        container.load(saved, "calibrator", 3)


@pytest.mark.parametrize(("name", "array"), [("../x", np.zeros(1)), ("x", np.array([None])), ("x", np.array(["a"]))])
def test_what_no_file_may_hold_is_refused(name, array):
    with pytest.raises(TypeError, match="cannot be stored"):
        container.to_bytes(Container("any", 1, {}, {name: array}))


def test_bytes_do_not_depend_on_the_day(monkeypatch):
    content = Container("any", 1, {"a": 1}, {"x": np.arange(5)})
    today = container.to_bytes(content)
    monkeypatch.setattr("time.time", lambda: 2e9)
    assert container.to_bytes(content) == today
    with zipfile.ZipFile(io.BytesIO(today)) as archive:
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_the_format_can_be_read_by_its_description_alone(saved):
    """Read the file as the module's documentation describes, without the module."""
    data = saved.read_bytes()
    assert hashlib.sha256(data[:-64]).hexdigest() == data[-64:].decode()
    with np.load(saved, allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["x"], np.arange(300.0) / 7)
    with zipfile.ZipFile(saved) as archive:
        assert archive.namelist() == ["calibrator.json", "x.npy", "y.npy"]
        assert json.loads(archive.read("calibrator.json")) == {"version": 3, "content": {"a": [1, "ä"]}}
    assert container.kind_of(saved) == "calibrator"
