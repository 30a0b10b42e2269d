"""times.txt: valid lines are read, and anything else is an error that names the line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from list_samples import table_of

from ospc.errors import ExposureError, OspcError, RecordingError
from ospc.recording.exposure_lists import read_times
from ospc.recording.exposure_units import ExposureUnit
from ospc.recording.options import ReadingOptions
from ospc.recording.table_text import MAX_LINE_CHARACTERS, lines_of, read_table_text


def test_columns_are_id_stamp_exposure() -> None:
    table = table_of("00000 10.5 1.25\n00001 10.75 2.5\n", "times.txt")
    assert table.ids == ("00000", "00001")
    assert table.stamps_s.tolist() == [10.5, 10.75]
    assert table.exposures_ms.tolist() == [1.25, 2.5]


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_comments_blank_lines_tabs_and_line_ends_are_no_content(end: str) -> None:
    text = end.join(["\ufeff# id stamp exposure", "", "1\t0.5\t2", "   ", "# more", "  2 0.75  4e0  "])
    table = table_of(text.removeprefix("\ufeff"), "times.txt")
    assert table.ids == ("1", "2")
    assert table.exposures_ms.tolist() == [2, 4]


def test_the_table_cannot_be_changed() -> None:
    table = table_of("1 0.5 2\n", "times.txt")
    with pytest.raises(ValueError, match="read-only"):
        table.exposures_ms[0] = 3


@pytest.mark.parametrize("unit", [1e-9, 1e-6, 1e-3])
def test_stamps_since_1970_in_finer_units_become_seconds_with_a_note(unit: float) -> None:
    seconds = 1_520_531_829.25
    table = table_of(f"1 {seconds / unit:.0f} 2\n2 {(seconds + 1) / unit:.0f} 2\n", "times.txt")
    np.testing.assert_allclose(table.stamps_s, [seconds, seconds + 1], atol=1e-3)
    assert "inferred from their size" in table.notes[0]


BROKEN = {
    "two columns on one line": ("1 0.1 1\n2 0.2\n", ExposureError, "line 2: has no exposure"),
    "two columns everywhere": ("1 0.1\n2 0.2\n", ExposureError, "line 1: has no exposure"),
    "one column": ("1\n", RecordingError, "line 1: has 1 column, not 3"),
    "four columns": ("1 0.1 1 9\n", RecordingError, "line 1: has 4 columns, not 3"),
    "commas": ("1,0.1,1\n", RecordingError, "line 1: has 1 column"),
    "text as exposure": (
        "1 0.1 1\n2 0.2 fast\n",
        RecordingError,
        "line 2: the exposure must be a number, not 'fast'",
    ),
    "decimal comma": ("1 0,1 2\n", RecordingError, "not '0,1'; write it like 1234.5, without a unit or commas$"),
    "text as stamp": ("1 now 1\n", RecordingError, "line 1: the time stamp must be a number, not 'now'"),
    "python's digits": ("1 0.1 1_000\n", RecordingError, "line 1: the exposure must be a number"),
    "other digits": ("1 0.1 ٣\n", RecordingError, "line 1: the exposure must be a number"),
    "fraction": ("1 0.1 1/500\n", RecordingError, "'1/500' is a fraction, .* or add --exposure-unit s if all"),
    "not available": (
        "1 0.1 N/A\n",
        RecordingError,
        "not 'N/A'; write .*, or write nan if it is unknown$",
    ),
    "thousands": ("1 0.1 2,000\n", RecordingError, "not '2,000'; write it like 1234.5, without a unit or commas"),
    "unit": ("1 0.1 2.0ms\n", RecordingError, "not '2.0ms'; write it like 1234.5, without a unit"),
    "hexadecimal": ("1 0.1 0x10\n", RecordingError, "line 1: the exposure must be a number"),
    "zero": ("1 0.1 1\n\n2 0.2 0\n", ExposureError, "line 3: the exposure must be a positive number"),
    "several zeros": ("1 1 0\n2 2 0\n3 3 0\n4 4 0\n5 5 0", ExposureError, "lines 1, 2, 3 and 2 more"),
    "negative": ("1 0.1 -1\n", ExposureError, "line 1: the exposure must be a positive number"),
    "nan only": ("1 0.1 nan\n\n2 0.2 nan\n", ExposureError, "lines 1, 3: no exposure is known; .* give its exposure"),
    "infinite": ("1 0.1 inf\n", ExposureError, "line 1: the exposure must be a positive number"),
    "too large to be": ("1 0.1 1e300\n", ExposureError, "line 1"),
    "in another unit": (
        "1 0.1 13067100000000\n",
        ExposureError,
        "a positive number of milliseconds and at most 1000000000, not 13067100000000; ",
    ),
    "too small to be": ("1 0.1 1e-300\n", ExposureError, "line 1"),
    "nan stamp": ("1 nan 1\n", RecordingError, "line 1: nan is not a time stamp"),
    "infinite stamp": ("1 1e999 1\n", RecordingError, "line 1: inf is not a time stamp"),
    "stamp twice": ("1 0.1 1\n# x\n2 0.1 1\n", RecordingError, "lines 1, 3: the same time stamp"),
    "time goes back": ("1 0.2 1\n2 0.1 1\n", RecordingError, "lines 1, 2: time goes back"),
    "id twice": ("7 0.1 1\n7 0.2 1\n", RecordingError, "lines 1, 2: both name the image '7'"),
    "nothing": ("", RecordingError, "has no frames"),
    "comments only": ("# 1 2 3\n\n", RecordingError, "has no frames"),
    "endless line": ("1 " * MAX_LINE_CHARACTERS, RecordingError, "line 1: longer than"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_line_is_named_with_what_is_wrong(case: str) -> None:
    text, error, message = BROKEN[case]
    with pytest.raises(error, match=message) as caught:
        table_of(text, "some/times.txt")
    assert str(caught.value).startswith("some/times.txt")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "data",
    [
        b"\x89PNG\r\n\x1a\n\xff\xfe",
        "1 0.1 1\n".encode("utf-16-le"),  # without a byte order mark
        "1 0.1 1\n".encode("utf-32"),
        b"\xff\xfe1",
        b"1 0.1 1\n\0\0\0",
        b"# caf\xe9 \x81\n1 0.1 1\n",
        bytes(range(256)),
    ],
)
def test_a_binary_file_is_not_text(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "times.txt"
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=r"times\.txt: not a text file in UTF-8, .*; save it as UTF-8"):
        read_times(path)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1", "cp1252"])
def test_text_is_read_in_every_encoding_that_spreadsheets_write(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "times.txt"
    path.write_bytes("# Müller, 3 µs\r\n1 0.5 2\r\n".encode(encoding))
    assert read_table_text(path) == "# Müller, 3 µs\r\n1 0.5 2\r\n"
    assert read_times(path).exposures_ms.tolist() == [2]


@pytest.mark.parametrize(
    ("scale", "options", "said"),
    [
        (1, ReadingOptions(), None),
        (1e3, ReadingOptions(), "exposures of 8000 ms are longer than the 50 ms between frames; if they are in us"),
        (
            1e6,
            ReadingOptions(),
            "exposures of 8000000 ms are longer than the 50 ms between frames; if they are in n",
        ),
        (1e-3, ReadingOptions(), "exposures of 0.008 ms are very short; if they are in s, add --exposure-unit s"),
        (1e-9, ReadingOptions(), "exposures of 8e-09 ms are very short; check the column, or give their unit"),
        (1e6, ReadingOptions(exposure_unit=ExposureUnit.NS), None),
    ],
)
def test_exposures_that_are_implausible_in_ms_get_a_note_with_the_likely_unit(
    scale: float, options: ReadingOptions, said: str | None
) -> None:
    notes = table_of("".join(f"{i} {i * 0.05} {8 * scale}\n" for i in range(4)), "times.txt", options).notes
    doubts = [note for note in notes if "exposures of" in note]
    assert len(doubts) == (said is not None)
    assert all(note.startswith(f"times.txt: {said}") for note in doubts)


def test_fractions_are_read_if_the_user_states_seconds() -> None:
    table = table_of("1 0.1 1/500\n2 0.2 0.5\n", "times.txt", ReadingOptions(exposure_unit=ExposureUnit.S))
    assert table.exposures_ms.tolist() == [2, 500]


def test_a_folder_in_place_of_the_file_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot be read"):
        read_times(tmp_path)


def test_too_many_lines_are_refused_before_they_are_split() -> None:
    with pytest.raises(RecordingError, match="lines allowed"):
        lines_of("\n" * 2_000_001, "times.txt")


@given(st.text(alphabet=st.characters(exclude_categories=["Cs"]), max_size=200))
def test_any_text_is_parsed_or_refused(text: str) -> None:
    try:
        table = table_of(text, "times.txt")
    except OspcError as error:
        assert "\n" not in str(error)  # noqa: PT017
    else:
        assert np.all(table.exposures_ms > 0)
        assert np.all(np.diff(table.stamps_s) > 0)


fields = st.one_of(
    st.from_regex(r"[-+]?[0-9]{1,4}(\.[0-9]{0,3})?(e[-+]?[0-9]{1,3})?", fullmatch=True),
    st.sampled_from(["nan", "-inf", "0", "1e999", "#", "x", "1_0", "\x1b[31m", "\u2028"]),
)


@given(st.lists(st.lists(fields, min_size=1, max_size=4).map(" ".join), max_size=5).map("\n".join))
def test_near_misses_are_parsed_or_refused(text: str) -> None:
    try:
        table = table_of(text, "times.txt")
    except OspcError as error:
        assert str(error).isprintable()  # noqa: PT017
    else:
        known_ms = table.exposures_ms[~np.isnan(table.exposures_ms)]
        assert known_ms.size
        assert np.all(np.isfinite(known_ms) & (known_ms > 0))
        assert np.all(np.isfinite(table.stamps_s))


def test_a_real_auto_exposure_course(real_data: Path) -> None:
    table = read_times(real_data / "params" / "tum_vi_times.txt")
    assert len(table) == 5990
    assert table.exposures_ms.min() == pytest.approx(0.51, abs=0.005)
    assert table.exposures_ms.max() == pytest.approx(19.25, abs=0.005)
    assert table.ids[0] == "1520531829251142058"
