"""Measured responses are read, and broken databases raise errors."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest
from scipy.io import savemat

from ospc.errors import FormatError
from ospc.research.accuracy.design import FILE, read_database

LIGHT = np.linspace(0, 1, 1024)


def write(path, brightness, light=LIGHT):
    savemat(path, {"I": np.atleast_2d(light), "B": np.atleast_2d(brightness)})
    return path


def test_curve_is_inverted(tmp_path):
    (found,) = read_database(write(tmp_path / "a.mat", np.sqrt(LIGHT)))
    grey = np.linspace(0, 1, 200)
    assert found.inverse(grey) == pytest.approx(grey**2, abs=5e-4)


def test_flat_ends_are_cut_off(tmp_path):
    brightness = np.clip((LIGHT - 0.1) / 0.7, 0, 1)
    (found,) = read_database(write(tmp_path / "a.mat", brightness))
    grey = np.linspace(0, 1, 200)
    assert found.inverse(grey) == pytest.approx(grey, abs=2e-3)


@pytest.mark.parametrize(
    ("brightness", "light"),
    [
        (1 - LIGHT, LIGHT),
        (np.where(LIGHT > 0.5, np.nan, LIGHT), LIGHT),
        (np.zeros(1024), LIGHT),
        (LIGHT, 1 - LIGHT),
        (LIGHT, LIGHT[:5]),
    ],
    ids=["decreasing", "not finite", "flat", "light decreasing", "shapes differ"],
)
def test_what_is_no_response_is_refused(tmp_path, brightness, light):
    with pytest.raises(FormatError, match=r"a\.mat"):
        read_database(write(tmp_path / "a.mat", brightness, light))


@pytest.mark.parametrize("content", [b"", b"no such file at all" * 20, b"MATLAB 5.0 MAT-file" + bytes(200)])
def test_what_is_no_database_is_refused(tmp_path, content):
    (tmp_path / "a.mat").write_bytes(content)
    with pytest.raises(FormatError, match=r"a\.mat"):
        read_database(tmp_path / "a.mat")
    with pytest.raises(FormatError, match="missing"):
        read_database(tmp_path / "missing.mat")


def test_damage_anywhere_is_an_error_or_a_response(tmp_path):
    whole = write(tmp_path / "a.mat", np.sqrt(LIGHT)).read_bytes()
    random = np.random.default_rng(0)
    for _ in range(60):
        damaged = bytearray(whole[: random.integers(1, len(whole) + 1)])
        for place in random.integers(0, min(len(damaged), 400), 3):
            damaged[place] = random.integers(256)
        (tmp_path / "b.mat").write_bytes(damaged)
        with contextlib.suppress(FormatError):
            assert len(read_database(tmp_path / "b.mat")) >= 1


def test_a_database_that_would_fill_memory_is_refused(tmp_path):
    savemat(tmp_path / "a.mat", {"I": np.zeros((2001, 3000)), "B": np.zeros((1, 1))}, do_compression=True)
    with pytest.raises(FormatError, match="more than"):
        read_database(tmp_path / "a.mat")


def test_database_without_the_two_arrays_is_refused(tmp_path):
    savemat(tmp_path / "a.mat", {"X": LIGHT})
    with pytest.raises(FormatError, match="I and B"):
        read_database(tmp_path / "a.mat")


def test_the_real_database_reads(real_data):
    if not (real_data / FILE).is_file():
        pytest.skip(f"no database of responses at {real_data / FILE}")
    curves = read_database(real_data / FILE)
    assert len(curves) == 201
    assert len({curve.inverse_table.tobytes() for curve in curves}) > 180
