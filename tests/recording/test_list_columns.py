"""Columns of lists: those that name images, gains, and fractions of a second, whatever the headers are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest
from image_samples import encoded, grey
from list_samples import table_of

from ospc.errors import ExposureError, RecordingError, SettingError
from ospc.recording import open_recording
from ospc.recording.exposure_units import GainUnit
from ospc.recording.frame_matching import match_images
from ospc.recording.frame_table import FrameTable
from ospc.recording.options import ReadingOptions

NAMES = ("00000.png", "00001.png", "00002.png", "00003.png")
SHUFFLED = (2, 0, 3, 1)


def matched(text: str, names: Sequence[str] = NAMES) -> tuple[list[str], tuple[str, ...]]:
    """Return the image of each row and the notes about matching."""
    images, notes = match_images(table_of(text, "e.csv", images=names), names, "images")
    return list(images), notes


def table(header: str, *rows: str, unit: GainUnit | None = None) -> FrameTable:
    return table_of("\n".join([header, *rows, ""]), "e.csv", ReadingOptions(gain_unit=unit))


@pytest.mark.parametrize("header", ["SourceFile", "image_path", "uri", "left_image", "photo", "Datei", "index"])
@pytest.mark.parametrize("written", ["{i:05d}.png", "./{i:05d}.png", "C:\\rec\\{i:05d}.png", "{i:05d}", "{i}"])
def test_the_column_with_the_names_of_the_images_is_used_whatever_its_header(header: str, written: str) -> None:
    rows = "".join(f"{written.format(i=i)},{7 - i},{i + 1}\n" for i in SHUFFLED)
    assert matched(f"{header},gps,exposure_ms\n{rows}") == ([NAMES[i] for i in SHUFFLED], ())


def test_names_are_used_even_where_another_column_has_the_header() -> None:
    rows = "".join(f"{row},{NAMES[i]},{i + 1}\n" for row, i in enumerate(SHUFFLED, start=1))
    assert matched(f"id,SourceFile,exposure_ms\n{rows}") == ([NAMES[i] for i in SHUFFLED], ())


def test_a_header_for_names_decides_between_columns_with_names() -> None:
    rows = "".join(f"{NAMES[max(i - 1, 0)]},{i},{i + 1}\n" for i in SHUFFLED)
    assert matched(f"before,frame,exposure_ms\n{rows}") == ([NAMES[i] for i in SHUFFLED], ())


@pytest.mark.parametrize(
    ("column", "said"),
    [
        (("00000.png", "00001.png", "00002.png", "00009.png"), "no image for 00009.png; no line for 00003.png"),
        (("00000.jpg", "00001.jpg", "00002.jpg", "00003.jpg"), "no image for 00000.jpg, 00001.jpg"),
        (("00000.png", "00001.png", "00001.png", "00003.png"), "both name the image '00001.png'"),
    ],
)
def test_rows_with_names_are_never_matched_by_order(column: Sequence[str], said: str) -> None:
    rows = "".join(f"{name},1\n" for name in column)
    with pytest.raises(RecordingError, match=said):
        matched(f"SourceFile,exposure_ms\n{rows}")


@pytest.mark.parametrize("other", ["lux", "comment"])
def test_rows_without_names_are_matched_by_order_with_a_note(other: str) -> None:
    rows = "".join(f"{7 * i},{i + 1}\n" for i in range(4))
    assert matched(f"{other},exposure_ms\n{rows}") == (
        list(NAMES),
        ("e.csv: has no image names; images are matched in the order of their names",),
    )


def test_names_of_other_images_do_not_keep_rows_from_their_order() -> None:
    rows = "".join(f"right_{i}.png,{i + 1}\n" for i in range(4))
    images, notes = matched(f"right_image,exposure_ms\n{rows}")
    assert images == list(NAMES)
    assert "order of their names" in notes[0]


def test_time_stamps_still_find_images_named_by_them() -> None:
    names = tuple(f"{1695668703000000000 + 50_000_000 * i}.png" for i in range(4))
    rows = "".join(f"{1695668703 + 0.05 * i:.2f},R{i}.png,{i + 1}\n" for i in range(4))
    images, notes = matched(f"timestamp,right,exposure_ms\n{rows}", names)
    assert images == list(names)
    assert "matched by the times" in notes[0]


def test_names_under_an_unknown_header_decide_in_a_folder(tmp_path: Path) -> None:
    for i in range(3):
        (tmp_path / f"{i}.png").write_bytes(encoded(grey(i)))
    (tmp_path / "exif.csv").write_text("SourceFile,ExposureTime\n./2.png,1/77\n./0.png,1/250\n./1.png,0.5\n")
    recording = open_recording(tmp_path)
    assert [frame.name for frame in recording] == ["0.png", "1.png", "2.png"]
    assert recording.exposures_ms == pytest.approx([4, 500, 1000 / 77])
    assert any("exposures are in s, because some are fractions" in note for note in recording.notes)


@pytest.mark.parametrize("header", ["exposure_s", "ExposureTime", "shutter", "shutter_speed"])
def test_fractions_are_seconds(header: str) -> None:
    assert table(f"file,{header}", "a,1/250", "b,2", "c,0.5").exposures_ms.tolist() == [4, 2000, 500]


def test_fractions_are_no_header() -> None:
    assert table_of("a 1/250\nb 1/500\n", "e.txt").exposures_ms.tolist() == [4, 2]


LINEAR = (
    *("gain", "Gains", "again", "dgain", "master_gain", "MasterGain", "sensor_gain", "camera_gain", "analog_gain"),
    *("analogueGain", "digital_gain", "total_gain", "gain_linear", "gain factor", "Gain (linear)"),
)


@pytest.mark.parametrize("column", LINEAR)
def test_linear_gains(column: str) -> None:
    assert table(f"file,exposure_ms,{column}", "a,1,1", "b,1,2.5").exposures_ms == pytest.approx([1, 2.5])


@pytest.mark.parametrize(
    "column",
    ["ISO", "iso_speed", "ISOSpeedRatings", "ISO value", "sensitivity", "PhotographicSensitivity", "gain_iso"],
)
def test_gains_as_iso(column: str) -> None:
    assert table(f"file,exposure_ms,{column}", "a,1,100", "b,1,400").exposures_ms == pytest.approx([1, 4])


@pytest.mark.parametrize("column", ["master_gain_db", "Gain dB", "sensor gain [dB]", "GainDB"])
def test_gains_in_decibels(column: str) -> None:
    assert table(f"file,exposure_ms,{column}", "a,1,0", "b,1,20").exposures_ms == pytest.approx([1, 10])


def test_all_parts_of_a_gain_multiply_and_a_total_does_not_count_twice() -> None:
    header = "file,exposure_ms,AnalogGain,SensorGain,total_gain,iso_speed"
    assert table(header, "a,1,2,3,6,100", "b,1,1,5,5,200").exposures_ms == pytest.approx([6, 10])


def test_of_several_columns_that_state_the_iso_one_is_used() -> None:
    header = "file,exposure_ms,ISO,ISOSpeedRatings,SensitivityType,AutoISO,GainControl"
    rows = ("a,1,100,100,1,100,None", "b,1,400,400,2,200,Low gain up")
    assert table(header, *rows).exposures_ms == pytest.approx([1, 4])


@pytest.mark.parametrize("column", ["gain_percent", "Gain [%]", "gain_raw", "gain_level"])
def test_a_gain_in_a_unit_of_its_own_has_to_be_stated_if_it_changes(column: str) -> None:
    header = f"file,exposure_ms,{column}"
    with pytest.raises(
        ExposureError, match=r"e\.csv: the gain in column '.*' changes from 100 to 200 in .*--gain-unit"
    ):
        table(header, "a,1,100", "b,1,200")
    assert table(header, "a,1,100", "b,1,200", unit=GainUnit.LINEAR).exposures_ms.tolist() == [100, 200]
    assert table(header, "a,1,100", "b,1,200", unit=GainUnit.NONE).exposures_ms.tolist() == [1, 1]
    constant = table(header, "a,1,0", "b,1,0")
    assert constant.exposures_ms.tolist() == [1, 1]
    assert constant.notes == (f"e.csv: the gain in '{column}' is constant and ignored",)


@pytest.mark.parametrize("column", ["isp_gain", "gain_setting", "gain_mode", "iso_equivalent", "boost gain"])
def test_a_column_that_looks_like_a_gain_and_changes_is_an_error(column: str) -> None:
    header = f"file,exposure_ms,{column}"
    with pytest.raises(ExposureError, match=rf"e\.csv: the column '{column}' looks like a gain and changes.*none"):
        table(header, "a,1,100", "b,1,200")
    assert table(header, "a,1,100", "b,1,100").exposures_ms.tolist() == [1, 1]
    assert table(header, "a,1,100", "b,1,200", unit=GainUnit.NONE).exposures_ms.tolist() == [1, 1]
    with pytest.raises(SettingError, match="has no gains"):
        table(header, "a,1,100", "b,1,100", unit=GainUnit.DB)


@pytest.mark.parametrize("column", ["red_gain", "b_gain", "awb_gains", "colour gain", "iso_time", "isotropy", "bias"])
def test_other_columns_may_change(column: str) -> None:
    assert table(f"file,exposure_ms,{column}", "a,1,100", "b,1,200").exposures_ms.tolist() == [1, 1]


@pytest.mark.parametrize("column", ["FNumber", "f-stop", "Aperture"])
def test_a_changing_aperture_gets_a_note(column: str) -> None:
    header = f"file,exposure_ms,{column}"
    assert any("f-number changes" in note for note in table(header, "a,1,2.8", "b,1,4").notes)
    assert table(header, "a,1,2.8", "b,1,2.8").notes == ()


@pytest.mark.parametrize(
    ("name", "doubtful"), [("gain", True), ("Analogue Gain", True), ("gain_db", False), ("gain_linear", False)]
)
def test_a_gain_without_a_unit_is_linear_and_a_note_says_what_else_it_may_be(name: str, doubtful: bool) -> None:
    (note, *_) = table_of(f"file,exposure_ms,{name}\na,1,10\nb,2,20\n", "list.csv").notes
    assert "multiplied by the gain" in note
    assert ("add --gain-unit db if it is in decibels" in note) == doubtful


@pytest.mark.parametrize(
    ("pattern", "counted"),
    [("img_{i}.png", True), ("{i:05d}.png", True), ("a{i}b{i}.png", True), ("{i}_{letter}.png", False)],
)
@pytest.mark.parametrize("stamped", [False, True])
def test_without_time_stamps_frames_are_in_the_order_of_the_images_numbers(
    tmp_path: Path, pattern: str, counted: bool, stamped: bool
) -> None:
    numbers = [9, 10, 11, 100]
    names = {i: pattern.format(i=i, letter="wxyz"[k]) for k, i in enumerate(numbers)}
    for name in names.values():
        (tmp_path / name).write_bytes(encoded(grey(8)))
    listed = [10, 100, 11, 9]
    rows = [f"{names[i]},{row},{i}" if stamped else f"{names[i]},{i}" for row, i in enumerate(listed)]
    header = "file,timestamp_s,exposure_ms" if stamped else "file,exposure_ms"
    (tmp_path / "exposures.csv").write_text("\n".join([header, *rows, ""]), encoding="utf-8")
    recording = open_recording(tmp_path)
    expected = numbers if counted and not stamped else listed
    assert recording.exposures_ms.tolist() == expected
    assert [frame.name for frame in recording] == [names[i] for i in expected]
    assert any("in the order of the numbers" in note for note in recording.notes) == (expected == numbers)


@pytest.mark.parametrize("separator", [";", "\t"])
def test_numbers_may_have_a_decimal_comma_where_commas_do_not_separate(separator: str) -> None:
    rows = [
        separator.join(row) for row in (("0.png", "0,05", "8,25"), ("1.png", "0,1", "9"), ("a,b.png", "1", "+1,5"))
    ]
    read = table(*(row.replace(";", separator) for row in ("file;time_s;exposure_ms", *rows)))
    assert read.exposures_ms.tolist() == [8.25, 9, 1.5]
    assert read.stamps_s.tolist() == [0.05, 0.1, 1]
    assert read.ids == ("0.png", "1.png", "a,b.png")
