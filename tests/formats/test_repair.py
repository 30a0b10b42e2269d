"""A repaired copy meets the rules, stays close to the original and lists its changes; the original is untouched."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ospc.errors import FormatError
from ospc.formats.dso import read_pcalib, read_vignette
from ospc.formats.validation import ParameterFile, Repair, kind_of, repair, validate

COUNTING = " ".join(map(str, range(256)))


def mended(path: Path, program="mono", size=None) -> Repair:
    before = path.read_bytes()
    result = repair(ParameterFile(path, kind_of(path)), program, size)
    assert path.read_bytes() == before
    if result.changes:
        assert result.path == path.with_name(f"{path.stem}.repaired{path.suffix}")
        assert validate([result.path], program, size).valid
        again = repair(ParameterFile(result.path, kind_of(path)), program, size)
        assert again.changes == ()
    else:
        assert not result.path.exists()
    return result


@pytest.mark.parametrize(
    ("text", "change"),
    [
        (COUNTING + "\n", None),
        (COUNTING + " scale: 1.0 2.0\n", "text after value 256"),
        (COUNTING + "\nscale: 1.0\n", "after the first line"),
        (COUNTING.replace(" ", "\n"), "values of 256 lines on one line"),
        (COUNTING.replace(" ", ", "), "commas"),
        (COUNTING.replace(" 100 ", " nan "), "interpolated 1 non-finite value"),
        (" ".join(str(i / 64) for i in range(65536 // 4)), "resampled 16384 values to 256"),
    ],
)
def test_damage_without_loss_is_mended_exactly(tmp_path, text, change):
    place = tmp_path / "pcalib.txt"
    place.write_text(text)
    result = mended(place)
    if change is None:
        assert result.changes == ()
    else:
        assert any(change in sentence for sentence in result.changes)
        np.testing.assert_allclose(read_pcalib(result.path).inverse_table, np.linspace(0, 1, 256), atol=1e-6)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32), noise=st.floats(0, 20), exponent=st.floats(0.3, 4))
def test_any_noisy_curve_becomes_valid_and_moves_no_further_than_the_noise(tmp_path_factory, seed, noise, exponent):
    random = np.random.default_rng(seed)
    truth = 255 * np.linspace(0, 1, 256) ** exponent
    curve = truth + random.uniform(-noise, noise, 256)
    curve[0], curve[-1] = truth.min() - noise, truth.max() + noise
    place = tmp_path_factory.mktemp("curve") / "pcalib.txt"
    place.write_text(" ".join(f"{value:.9g}" for value in curve))
    result = mended(place)
    after = (read_pcalib(result.path) if result.changes else read_pcalib(place)).inverse_table
    scaled = (truth - curve[0]) / (curve[-1] - curve[0])
    assert np.abs(after - scaled).max() <= (noise + 1e-3) / (curve[-1] - curve[0]) + 1e-5


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (" ".join(map(str, range(255))), "there are 255"),
        (" ".join(map(str, range(256, 0, -1))), "decreases from 256 to 1"),
        ("nan " + COUNTING, "first value"),
        ("", "there are 0"),
    ],
)
def test_content_is_not_invented(tmp_path, text, reason):
    place = tmp_path / "pcalib.txt"
    place.write_text(text)
    with pytest.raises(FormatError, match=reason):
        repair(ParameterFile(place, "pcalib"))
    assert list(tmp_path.iterdir()) == [place]


def test_vignette_is_made_grey_of_16_bit_without_zeros(tmp_path):
    values = np.full((48, 64, 3), 200, np.uint8)
    values[:4] = 0
    place = tmp_path / "vignette.png"
    cv2.imwrite(str(place), values)
    result = mended(place, size=(64, 48))
    stored = cv2.imread(str(result.path), cv2.IMREAD_UNCHANGED)
    assert stored.dtype == np.uint16
    assert set(np.unique(stored)) == {1, 200 * 257}
    assert len(result.changes) == 3


def test_vignette_is_resized_only_where_the_field_of_view_can_be_the_same(tmp_path):
    y, x = np.mgrid[:96, :128] / 96
    place = tmp_path / "vignette.png"
    cv2.imwrite(str(place), (65535 * (1 - 0.3 * ((x - 0.66) ** 2 + (y - 0.5) ** 2))).astype(np.uint16))
    result = mended(place, size=(64, 48))
    small, large = read_vignette(result.path), read_vignette(place)
    assert small.size == (64, 48)
    assert np.abs(small.image() - large.image().reshape(48, 2, 64, 2).mean(axis=(1, 3))).max() < 1e-3
    with pytest.raises(FormatError, match="aspect"):
        repair(ParameterFile(place, "vignette"), size=(64, 64))


def images(folder: Path, names: list[str]) -> None:
    (folder / "images").mkdir()
    for name in names:
        (folder / "images" / name).write_bytes(b"")


def test_lines_of_missing_images_are_dropped_and_exposures_filled(tmp_path):
    images(tmp_path, [f"{i:05d}.png" for i in range(20) if i != 7])
    lines = [f"{i:05d} {i / 10:.3f} {2 ** (i % 3) if i != 12 else 0}\n" for i in range(20)]
    place = tmp_path / "times.txt"
    place.write_text("# id stamp exposure\n" + "".join(lines))
    result = mended(place)
    assert [" ".join(sentence.split()[:2]) for sentence in result.changes] == ["dropped 1", "interpolated 1"]
    rows = [line.split() for line in result.path.read_text().splitlines()]
    assert [int(row[0]) for row in rows] == [i for i in range(20) if i != 7]
    assert float(rows[11][2]) == pytest.approx(np.sqrt(4 * 2))


def test_numbers_that_do_not_fit_32_bits_are_missing(tmp_path):
    images(tmp_path, [f"{i:05d}.png" for i in range(20)])
    exposures = ["1e-60" if i == 3 else "1e60" if i == 9 else "2" for i in range(20)]
    place = tmp_path / "times.txt"
    place.write_text("nan nan nan\n" + "".join(f"{i} {i} {e}\n" for i, e in enumerate(exposures)))
    assert {line.split()[2] for line in mended(place).path.read_text().splitlines()} == {"2"}


def test_an_exposure_hidden_by_text_at_the_stamp_is_filled(tmp_path):
    images(tmp_path, [f"{i:05d}.png" for i in range(20)])
    place = tmp_path / "times.txt"
    place.write_text("".join(f"{i} {i}.5{'x' * (i == 7)} 2\n" for i in range(20)))
    assert mended(place).path.read_text().splitlines()[7] == "7 7.500000000 2"


def test_names_and_commas_are_made_numbers_and_spaces(tmp_path):
    images(tmp_path, ["a.png", "b.png"])
    place = tmp_path / "times.txt"
    place.write_text("a.png,0.5,1\nb.png,0.6,2\n")
    assert mended(place).path.read_text().split() == ["0", "0.500000000", "1", "1", "0.600000000", "2"]


def test_without_exposures_only_ids_and_stamps_are_written(tmp_path):
    images(tmp_path, ["a.png", "b.png"])
    place = tmp_path / "times.txt"
    place.write_text("a.png 0.5\nb.png 0.6\n")
    assert repair(ParameterFile(place, "times")).path.read_text() == "0 0.500000000\n1 0.600000000\n"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("0 0.1 1\n", "cannot be matched with images"),
        ("0 0.1 0\n1 0.2 1\n", "1 of 2 exposures are missing"),
        ("0.5 33.3\n0.6 33.3\n", "unclear whether the two columns"),
        ("hello\n", "there is none"),
        ("0 0,1 1\n1 0,2 2\n", "decimal points"),
    ],
)
def test_times_are_not_invented(tmp_path, text, reason):
    images(tmp_path, ["00000.png", "00001.png"])
    place = tmp_path / "times.txt"
    place.write_text(text)
    with pytest.raises(FormatError, match=reason):
        repair(ParameterFile(place, "times"))


def test_line_ends_of_a_camera_file_are_mended(tmp_path):
    place = tmp_path / "camera.txt"
    place.write_bytes(b"0.5 0.6 0.5 0.5 0.9\r\n640 480\r\ncrop\r\n640 480\r\n")
    assert mended(place).path.read_bytes() == b"0.5 0.6 0.5 0.5 0.9\n640 480\ncrop\n640 480\n"


def test_real_files_are_mended(real_data, tmp_path):
    expected = {
        "dji_pcalib.txt": "0.664 %",
        "denguetim_pcalib.txt": "vis_exponent",
        "tum_vi_pcalib_65536.txt": "resampled 65536 values to 256",
        "tum_vi_vignette_fisheye_512.png": "16891 pixels",
        "tum_vi_times.txt": "32-bit integers",
    }
    for name, words in expected.items():
        place = Path(shutil.copyfile(real_data / "params" / name, tmp_path / name))
        assert any(words in sentence for sentence in mended(place).changes)
