"""DSO's parameter files: written files meet its rules and are read back unchanged."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from log_polynomials import log_polynomial
from ospc.errors import ExposureError, FormatError, SettingError
from ospc.formats.dso import (
    read_pcalib,
    read_vignette,
    write_pcalib,
    write_times,
    write_vignette,
)
from ospc.formats.rules_pcalib import strictly_increasing_float32
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette, RasterVignette


def as_dso_reads(text: str) -> np.ndarray:
    """Return the table DSO would use: first line, 32-bit floats, strictly increasing, remapped with its rounding."""
    values = np.array([float(word) for word in text.split("\n", maxsplit=1)[0].split()]).astype(np.float32)
    assert values.size >= 256
    assert np.all(np.diff(values) > 0)
    span = values[-1] - values[0]
    remapped = (255.0 * (values - values[0]).astype(np.float64) / float(span)).astype(np.float32)
    assert np.all(np.diff(remapped) > 0)
    return remapped


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32), decades=st.floats(0, 30), ordered=st.sampled_from([0, 1, -1]))
def test_any_strictly_increasing_curve_survives(seed, decades, ordered):
    steps = 10 ** np.random.default_rng(seed).uniform(-decades, 0, 255)
    steps = np.sort(steps)[::ordered] if ordered else steps
    curve = np.cumsum(np.concatenate([[0.0], steps / steps.sum()]))
    assume(np.all(np.diff(curve) > 0))
    response = Response.from_values(curve)
    # neighbours closer than the 32-bit resolution (6e-8 at the top) must be spread; there are at most 255
    tolerance = 1e-6 if np.diff(response.inverse_table).min() > 1e-7 else 1e-5
    with TemporaryDirectory() as folder:
        place = write_pcalib(response, Path(folder) / "pcalib.txt")
        table = as_dso_reads(place.read_text())
        assert np.abs(table / 255 - response.inverse_table).max() < tolerance
        assert np.abs(read_pcalib(place).inverse_table - table / 255).max() < 1e-7


@pytest.mark.parametrize("exponent", [0.05, 0.45, 1.0, 2.05, 5.0, 20.0, 100.0])
@pytest.mark.parametrize("values", [256, 4096, 65536])
def test_steep_and_flat_curves_survive(tmp_path, exponent, values):
    # the lower half of x**100 underflows in 32 bits; only the lift keeps it increasing
    levels = np.linspace(0, 1, 256)
    curve = np.maximum(levels**exponent, np.arange(256) * 1e-300)
    response = Response(curve / curve[-1])
    table = as_dso_reads(write_pcalib(response, tmp_path / "pcalib.txt", values).read_text())
    assert table.size == values
    assert np.abs(table / 255 - response.resampled(values)).max() < 1e-6


def test_curve_near_the_top_is_lowered_if_there_is_no_room_above():
    flat_top = np.concatenate([[0.0], 255 - np.linspace(1e-9, 0, 255)])
    mended = strictly_increasing_float32(flat_top)
    assert np.all(np.diff(mended) > 0)
    assert mended[0] == 0
    assert mended[-1] == 255
    assert np.abs(mended - flat_top).max() < 255 * 2**-24 * 256


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(0, 255), min_size=10, max_size=300))
def test_lift_is_the_identity_on_what_needs_none(values):
    curve = np.unique(np.array([0.0, 255.0, *values]).astype(np.float32))
    curve = curve[(curve == 0) | (curve > 1e-29)]
    np.testing.assert_array_equal(strictly_increasing_float32(curve), curve)


def test_values_have_nine_significant_digits(tmp_path):
    text = write_pcalib(Response.gamma(2.2), tmp_path / "pcalib.txt").read_text()
    stored = np.array([float(word) for word in text.split()])
    expected = strictly_increasing_float32(255 * Response.gamma(2.2).inverse_table)
    np.testing.assert_array_equal(stored.astype(np.float32), expected)
    assert text.count("\n") == 1


@pytest.mark.parametrize("values", [0, 255, 65537])
def test_numbers_of_values_that_no_program_reads_are_refused(tmp_path, values):
    with pytest.raises(SettingError, match=str(values)):
        write_pcalib(Response.gamma(2.2), tmp_path / "pcalib.txt", values)


def test_only_the_first_line_counts_and_a_black_level_is_lost(tmp_path):
    place = tmp_path / "pcalib.txt"
    place.write_text(" ".join(str(17 + 3 * i) for i in range(256)) + " end\r\nvis_exponent: 1.0\n")
    np.testing.assert_allclose(read_pcalib(place).inverse_table, np.linspace(0, 1, 256), atol=1e-12)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "there are 0"),
        (" ".join(map(str, range(255))), "there are 255"),
        ("\n".join(map(str, range(256))), "255 lines too many"),
        (" ".join(map(str, range(100))) + " nan " + " ".join(map(str, range(100, 300))), "value 101 is 'nan'"),
        (",".join(map(str, range(256))), "value 2 is"),
        (" ".join(map(str, [*range(128), 127, *range(129, 256)])), "after grey level 127"),
        (" ".join(f"{1e6 + i * 1e-3:.9f}" for i in range(256)), "strictly increasing"),
        (" ".join(map(str, [*range(255), 1e60])), "value 256 is '1e\\+60'"),
        (" ".join(map(str, range(65537))), "there are 65537"),
    ],
)
def test_tables_that_dso_refuses_or_misreads_are_refused(tmp_path, text, complaint):
    place = tmp_path / "pcalib.txt"
    place.write_text(text)
    with pytest.raises(FormatError, match=complaint) as caught:
        read_pcalib(place)
    assert str(place) in str(caught.value)


def test_missing_file_is_one_clear_error(tmp_path):
    with pytest.raises(FormatError, match="No such file"):
        read_pcalib(tmp_path / "nowhere.txt")
    with pytest.raises(FormatError, match="cannot be written"):
        write_pcalib(Response.gamma(1.0), tmp_path / "no" / "pcalib.txt")


@pytest.mark.parametrize(
    "vignette",
    [
        PolynomialVignette((64, 48), (-0.3, 0.1, -0.15)),
        log_polynomial((63, 49), (-0.4, -0.2), (0.1, -0.05), (0.01, -0.02, 0.02, 0.01, 0.0, 0.03, 0.02, -0.01)),
    ],
)
def test_vignette_survives_to_its_resolution(tmp_path, vignette):
    back = read_vignette(write_vignette(vignette, tmp_path / "vignette.png"))
    expected = vignette.image() / vignette.image().max()
    assert back.size == vignette.size
    assert np.abs(back.image() - expected).max() <= 0.51 / 65535


def test_vignette_file_is_grey_16_bit_and_never_zero(tmp_path):
    values = np.ones((40, 50), np.float32)
    values[:5] = 0
    place = write_vignette(RasterVignette(values), tmp_path / "vignette.png")
    stored = cv2.imread(str(place), cv2.IMREAD_UNCHANGED)
    assert stored.dtype == np.uint16
    assert stored.shape == (40, 50)
    assert stored.min() == 1
    assert stored.max() == 65535


def test_a_description_that_is_not_unicode_is_written_as_far_as_it_is(tmp_path):
    path = write_vignette(PolynomialVignette((40, 30), (-0.2,)), tmp_path / "vignette.png", "half a \ud800 character")
    assert b"half a ? character" in path.read_bytes()
    assert read_vignette(path).size == (40, 30)


def test_negative_vignette_is_not_written(tmp_path):
    with pytest.raises(FormatError, match="negative"):
        write_vignette(PolynomialVignette((64, 48), (-1.5,)), tmp_path / "vignette.png")
    assert list(tmp_path.iterdir()) == []


def test_vignettes_that_are_none_are_refused(tmp_path):
    place = tmp_path / "vignette.png"
    cv2.imwrite(str(place), np.full((10, 12, 3), 200, np.uint8))
    with pytest.raises(FormatError, match="3 channels"):
        read_vignette(place)
    cv2.imwrite(str(place), np.zeros((10, 12), np.uint8))
    with pytest.raises(FormatError, match="black"):
        read_vignette(place)
    place.write_bytes(b"no picture")
    with pytest.raises(FormatError, match="not a PNG"):
        read_vignette(place)


def test_damaged_pictures_are_refused(tmp_path):
    whole = write_vignette(PolynomialVignette((64, 48), (-0.3,)), tmp_path / "vignette.png").read_bytes()
    damaged = tmp_path / "damaged.png"
    for content in (whole[: len(whole) // 2], whole[:20], whole[:200] + b"\x00\x01\x02" + whole[203:]):
        damaged.write_bytes(content)
        with pytest.raises(FormatError, match="damaged"):
            read_vignette(damaged)


def test_picture_of_absurd_size_is_refused_before_it_is_decoded(tmp_path):
    import struct
    import zlib

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 2**20, 2**20, 16, 0, 0, 0, 0))
    place = tmp_path / "vignette.png"
    place.write_bytes(b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", b"") + chunk(b"IEND", b""))
    with pytest.raises(FormatError, match="1048576×1048576"):
        read_vignette(place)


def test_times_lines_are_what_dso_scans(tmp_path):
    stamps = 1695668703.271420717 + np.arange(3) / 20
    place = write_times(tmp_path / "times.txt", [0, 1, 2], stamps, [2.0, 0.018, 1e-7])
    words = [line.split(" ") for line in place.read_text().splitlines()]
    assert [int(w[0]) for w in words] == [0, 1, 2]
    np.testing.assert_array_equal([float(w[1]) for w in words], stamps)
    np.testing.assert_allclose([float(w[2]) for w in words], [2.0, 0.018, 1e-7], rtol=1e-8)


@pytest.mark.parametrize(
    ("ids", "stamps", "exposures", "error"),
    [
        ([0, 1], [0.0], [1.0, 1.0], FormatError),
        ([0, 2**31], [0.0, 1.0], [1.0, 1.0], FormatError),
        ([0, 1.5], [0.0, 1.0], [1.0, 1.0], FormatError),
        ([0, 1], [0.0, np.nan], [1.0, 1.0], FormatError),
        ([0, 1], [0.0, 1.0], [1.0, 0.0], ExposureError),
        ([0, 1], [0.0, 1.0], [1.0, np.nan], ExposureError),
        ([0, 1], [0.0, 1.0], [1.0, 1e-60], ExposureError),
    ],
)
def test_times_that_dso_would_drop_are_refused(tmp_path, ids, stamps, exposures, error):
    with pytest.raises(error):
        write_times(tmp_path / "times.txt", ids, stamps, exposures)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["shuttum_gamma_cam1.txt", "denguetim_pcalib.txt", "tum_vi_pcalib_65536.txt"])
def test_real_tables_are_read(real_data, name):
    place = real_data / "params" / name
    values = np.array([float(word) for word in place.read_text().split("\n")[0].split()])
    expected = (values - values[0]) / (values[-1] - values[0])
    np.testing.assert_allclose(read_pcalib(place).inverse_table, expected, atol=1e-12)


def test_real_table_that_falls_is_refused(real_data):
    with pytest.raises(FormatError, match="grey level 54 "):
        read_pcalib(real_data / "params" / "dji_pcalib.txt")


def test_real_vignettes_are_read(real_data):
    sizes = {
        "shuttum_vignette_1280x1024.png": (1280, 1024),
        "denguetim_vignette.png": (752, 480),
        "tum_vi_vignette_fisheye_512.png": (512, 512),
    }
    for name, size in sizes.items():
        assert read_vignette(real_data / "params" / name).size == size
