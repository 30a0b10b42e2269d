"""The container: what was put in comes out, and nothing else ever does."""

from __future__ import annotations

import hashlib
import json
import re
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from ospc.errors import FormatError
from ospc.state import container
from ospc.state.container import Container

DTYPES = st.sampled_from(["<f8", "<f4", "<i8", "|u1", "<u2", "|b1"])
ARRAYS = DTYPES.flatmap(lambda dtype: arrays.arrays(dtype, arrays.array_shapes(min_dims=0, max_dims=3, min_side=0)))
CONTENT = st.dictionaries(st.text(), st.none() | st.booleans() | st.integers() | st.text(), max_size=4)


@pytest.fixture
def saved(tmp_path):
    content = Container("calibrator", 3, {"a": [1, "ä"]}, {"x": np.arange(300.0) / 7, "y": np.arange(5)})
    return container.save(content, tmp_path / "a.ospc")


@given(content=CONTENT, stored=st.dictionaries(st.text(max_size=5), ARRAYS, max_size=3))
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


def test_values_that_fit_a_narrower_type_take_less_room():
    grey = np.random.default_rng(0).random(10_000)
    sizes = [
        len(container.to_bytes(Container("any", 1, {}, {"grey": values})))
        for values in (grey, grey.astype(np.float32).astype(np.float64))
    ]
    assert sizes[1] < 0.6 * sizes[0]


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
    with pytest.raises(FormatError, match="holds a calibrator state, but a pooled state is needed"):
        container.load(saved, "pooled", 3)
    with pytest.raises(FormatError, match=r"an older version.*make it anew"):
        container.load(saved, "calibrator", 4)
    with pytest.raises(FormatError, match="a newer version"):
        container.load(saved, "calibrator", 2)
    other = tmp_path / "calibration.json"
    other.write_text("{}")
    with pytest.raises(FormatError, match="not a state file"):
        container.load(other, "calibrator", 3)
    future = tmp_path / "future.ospc"
    future.write_bytes(saved.read_bytes().replace(b"ospc-state 1", b"ospc-state 9", 1))
    with pytest.raises(FormatError, match="container of another version"):
        container.load(future, "calibrator", 3)
    with pytest.raises(FormatError, match="there is no such state"):
        container.load(tmp_path / "none", "calibrator", 3)
    with pytest.raises(FormatError, match="cannot be read"):
        container.load(tmp_path, "calibrator", 3)


def test_an_earlier_file_survives_a_failure_to_write(saved, monkeypatch):
    before = saved.read_bytes()

    def full(_descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(FormatError, match="No space left on device"):
        container.save(Container("calibrator", 3, {"a": 2}), saved)
    assert saved.read_bytes() == before
    assert [place.name for place in saved.parent.iterdir()] == [saved.name]


def forged(header, blobs=b""):
    body = json.dumps(header).encode() + b"\n" + blobs
    return b"ospc-state 1\n" + f"{hashlib.sha256(body).hexdigest()} {len(body)}\n".encode() + body


ENTRY = {"name": "x", "dtype": "<f8", "shape": [4], "stored": "<f8", "bytes": 0}
HEADER = {"kind": "any", "version": 1, "content": {}, "arrays": []}


@pytest.mark.parametrize(
    "header",
    [
        {},
        [],
        HEADER | {"content": []},
        HEADER | {"version": True},
        HEADER | {"arrays": 3},
        HEADER | {"arrays": [ENTRY]},
        HEADER | {"arrays": [ENTRY | {"dtype": "|O"}]},
        HEADER | {"arrays": [ENTRY | {"stored": "|O"}]},
        HEADER | {"arrays": [ENTRY | {"stored": "|u1"}]},
        HEADER | {"arrays": [ENTRY | {"shape": [-1]}]},
        HEADER | {"arrays": [ENTRY | {"shape": [2**40]}]},
        HEADER | {"arrays": [ENTRY | {"shape": [1] * 40}]},
        HEADER | {"arrays": [ENTRY | {"shape": 4}]},
        HEADER | {"arrays": [ENTRY | {"bytes": 5}, ENTRY | {"bytes": -5}]},
        HEADER | {"arrays": [ENTRY | {"bytes": 99}]},
    ],
)
def test_forged_headers_are_refused(header):
    with pytest.raises(FormatError, match=r"^it: not readable as a state"):
        container.from_bytes(forged(header), "it")


def test_an_array_that_unpacks_to_more_than_it_says_is_never_unpacked():
    bomb = zlib.compress(bytes(10**7))
    header = HEADER | {"arrays": [ENTRY | {"bytes": len(bomb)}]}
    with pytest.raises(FormatError, match="not as many values"):
        container.from_bytes(forged(header, bomb), "it")


def test_the_format_can_be_read_by_its_description_alone(saved):
    """As the documentation of the module has it, without the module."""
    magic, line, body = saved.read_bytes().split(b"\n", 2)
    assert magic == b"ospc-state 1"
    digest, length = line.decode().split(" ")
    assert re.fullmatch("[0-9a-f]{64}", digest)
    assert len(body) == int(length)
    text, blobs = body.split(b"\n", 1)
    header = json.loads(text)
    entry = header["arrays"][0]
    raw = np.frombuffer(zlib.decompress(blobs[: entry["bytes"]]), np.uint8)
    width = np.dtype(entry["stored"]).itemsize
    values = np.ascontiguousarray(raw.reshape(width, -1).T).view(entry["stored"]).astype(entry["dtype"])
    np.testing.assert_array_equal(values.reshape(entry["shape"]), np.arange(300.0) / 7)
