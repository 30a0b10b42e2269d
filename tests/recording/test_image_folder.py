"""Folders of images with a list of exposures: columns, units, and ambiguous lists, which are refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from image_samples import encoded, grey
from list_samples import table_of

from ospc import calibrate
from ospc.errors import ExposureError, FrameError, OspcError, RecordingError
from ospc.recording import Recording, open_recording
from ospc.recording.exposure_lists import read_list
from ospc.recording.exposure_units import GainUnit
from ospc.recording.options import ReadingOptions
from ospc.simulation import SimulationSettings, simulate

Open = Callable[..., Recording]


@pytest.fixture
def opened(tmp_path: Path) -> Open:
    """Open a folder with three images and the given text files."""

    def make(files: dict[str, str], names: tuple[str, ...] = ("a.png", "b.png", "c.png")) -> Recording:
        for i, name in enumerate(names):
            (tmp_path / name).write_bytes(encoded(grey(i)))
        for name, text in files.items():
            (tmp_path / name).write_text(text)
        return open_recording(tmp_path)

    return make


@pytest.mark.parametrize(
    ("header", "exposure_ms"),
    [
        ("file,exposure_ms", 2),
        ("file,exposure[ms]", 2),
        ("file,Exposure Time [us]", 0.002),
        ("file,exposure_time_us", 0.002),
        ("file,exposure (µs)", 0.002),
        ("file,exposure_s", 2000),
        ("file,exposure_ns", 2e-6),
        ("file,shutter_seconds", 2000),
        ("Filename,Shutter Time (microseconds)", 0.002),
        ("image,integration_time_ms", 2),
        ("image,exposure_time_absolute", 0.2),
        ("image,ActualExposure[us]", 0.002),
    ],
)
def test_units_come_from_the_header(opened: Open, header: str, exposure_ms: float) -> None:
    recording = opened({"exposures.csv": f"{header}\na.png,2\nb.png,4\nc.png,8\n"})
    assert recording.kind == "image_folder"
    assert recording.exposures_ms == pytest.approx([exposure_ms, 2 * exposure_ms, 4 * exposure_ms], rel=1e-12)
    assert not any("assumed to be in ms" in note for note in recording.notes)


def test_umlauts_match_however_they_are_composed(opened: Open) -> None:
    listed, stored = "Z\u00fcrich 1.png", "Zu\u0308rich 1.png"  # as typed, and as macOS names the file
    recording = opened({"exposures.csv": f"file,exposure_ms\n{listed},2\nb.png,4\n"}, (stored, "b.png"))
    assert [frame.name for frame in recording] == [stored, "b.png"]


def test_a_missing_unit_is_stated_as_assumed(opened: Open) -> None:
    recording = opened({"anything.csv": "file;exposure\na.png;2\nb.png;4\nc.png;8\n"})
    assert recording.exposures_ms.tolist() == [2, 4, 8]
    assert any("exposures are assumed to be in ms: no other unit is stated" in note for note in recording.notes)


def test_times_as_in_the_tum_datasets(opened: Open) -> None:
    recording = opened({"times.txt": "# made by hand\na 0.5 2\nb 1.5 4\nc 2.5 8\n"})
    assert recording.exposures_ms.tolist() == [2, 4, 8]
    assert recording.stamps_s.tolist() == [0.5, 1.5, 2.5]
    assert any("read as id, stamp[s], exposure" in note for note in recording.notes)


def test_a_commented_header_counts(opened: Open) -> None:
    recording = opened({"times.txt": "# hello\n# filename timestamp [ns] [exposuretime[us]]\na 1 2\nb 2 4\nc 3 8\n"})
    assert recording.exposures_ms == pytest.approx([0.002, 0.004, 0.008])
    assert recording.stamps_s == pytest.approx([1e-9, 2e-9, 3e-9])
    assert recording.notes == ()


@pytest.mark.parametrize(
    ("unit", "unit_s"), [("s", 1.0), ("msec", 1e-3), ("µs", 1e-6), ("nanoseconds", 1e-9), ("100us", 1e-4)]
)
def test_time_stamps_may_have_the_units_of_exposures(opened: Open, unit: str, unit_s: float) -> None:
    recording = opened({"exposures.csv": f"file,time_{unit},exposure_ms\na.png,1,1\nb.png,3,2\nc.png,4,4\n"})
    assert recording.stamps_s == pytest.approx([unit_s, 3 * unit_s, 4 * unit_s], rel=1e-12)


def test_columns_may_come_in_any_order_among_others(opened: Open) -> None:
    text = "brightness\texposure_us\tcomment\tfile\ttimestamp_ms\n1\t1000\tx\tc.png\t10\n1\t2000\tx\ta.png\t20\n"
    recording = opened({"exposures.csv": text}, ("a.png", "c.png"))
    assert [frame.name for frame in recording] == ["c.png", "a.png"]
    assert recording.exposures_ms == pytest.approx([1, 2])
    assert recording.stamps_s == pytest.approx([0.01, 0.02])


def test_quotes_and_folders_around_names_are_taken_off(opened: Open) -> None:
    text = 'file,exposure_ms\n"images/a.png",1\n"C:\\x\\b.png",2\nc,3\n'
    assert [frame.name for frame in opened({"exposures.csv": text})] == ["a.png", "b.png", "c.png"]


def test_bare_exposures_belong_to_the_images_in_order_of_their_numbers(opened: Open) -> None:
    recording = opened({"exposures.txt": "1\n2\n4\n"}, ("1.png", "10.png", "2.png"))
    assert [frame.name for frame in recording] == ["1.png", "2.png", "10.png"]
    assert recording.exposures_ms.tolist() == [1, 2, 4]
    assert any("order of their names" in note for note in recording.notes)
    assert any("no time stamps" in note for note in recording.notes)


def test_time_stamps_find_images_named_by_them(opened: Open) -> None:
    stamps = ("1695668703271420672", "1695668703318191104")
    text = "timestamp,exposure_ms\n" + "".join(f"{stamp},2\n" for stamp in stamps)
    recording = opened({"exposures.csv": text}, tuple(f"{stamp}.png" for stamp in stamps))
    assert recording.stamps_s[0] == pytest.approx(1695668703.2714, abs=1e-4)
    assert any("nanoseconds" in note for note in recording.notes)


@pytest.mark.parametrize(
    ("unit", "factor", "said"), [(GainUnit.DB, 10, ["'Gain' (dB)"]), (GainUnit.LINEAR, 20, ["'Gain' (linear)"])]
)
def test_a_stated_unit_of_gains_is_in_the_note(unit: GainUnit, factor: float, said: list[str]) -> None:
    table = table_of("file,exposure_ms,Gain\na,1,20\n", "e.csv", ReadingOptions(gain_unit=unit))
    assert table.exposures_ms == pytest.approx([factor])
    assert [note.partition("gain in ")[2] for note in table.notes] == said


def test_ignored_gains_may_be_zero_and_are_not_in_the_notes() -> None:
    table = table_of("file,exposure_ms,gain\na,1,0\n", "e.csv", ReadingOptions(gain_unit=GainUnit.NONE))
    assert table.exposures_ms == pytest.approx([1])
    assert not table.notes


@pytest.mark.parametrize(("unit_s", "name"), [(1e-9, "nanoseconds"), (1e-6, "microseconds")])
@pytest.mark.parametrize("fps", [1, 30, 200])
def test_stamps_of_a_clock_that_begins_at_zero_are_read_by_their_frame_rate(
    unit_s: float, name: str, fps: int
) -> None:
    rows = "".join(f"{i},{i / fps / unit_s:.0f},900\n" for i in range(4))
    table = table_of("id,timestamp,exposure\n" + rows, "e.csv")
    np.testing.assert_allclose(table.stamps_s, np.arange(4) / fps, atol=1e-5)
    assert table.exposures_ms == pytest.approx(900 if fps == 1 else 0.9)
    assert f"e.csv: time stamps are assumed to be in {name}, inferred from the frame rate, {fps} per second" in (
        table.notes
    )


@pytest.mark.parametrize(("column", "step"), [("timestamp", 30), ("timestamp", 900), ("time_s", 5e7)])
def test_slow_and_stated_seconds_are_kept(column: str, step: float) -> None:
    table = table_of(f"id,{column},exposure_ms\n0,0,1\n1,{step:.0f},2\n", "e.csv")
    assert table.stamps_s.tolist() == [0, step]


@pytest.mark.parametrize("column", ["frame", "frame_number", "Frame Index", "image_number"])
def test_numbers_of_frames_find_their_images(opened: Open, column: str) -> None:
    text = f"{column},exposure_ms\n2,4\n0,1\n1,2\n"
    recording = opened({"exposures.csv": text}, ("000.png", "001.png", "002.png"))
    assert [(frame.name, frame.exposure_ms) for frame in recording] == [
        ("000.png", 1),
        ("001.png", 2),
        ("002.png", 4),
    ]


def test_lists_without_exposures_are_no_lists_of_exposures(opened: Open) -> None:
    files = {
        "imu.csv": "timestamp,ax\n1,2\n",
        "poses.csv": "1,2,3\n4,5,6\n",
        "e.csv": "file,exposure_ms\na,1\nb,2\nc,3\n",
    }
    assert opened(files).exposures_ms.tolist() == [1, 2, 3]


BROKEN: dict[str, tuple[dict[str, str], type[Exception], tuple[str, ...]]] = {
    "no list": ({}, ExposureError, ("no list of exposures; ", "exposures.csv")),
    "unknown lists": (
        {"log.csv": "name,time\na,1\n", "run.json": "{}"},
        ExposureError,
        (
            "no list of exposures (not used: log.csv, run.json; a list is a CSV file with a column such",
            "; add times.txt",
        ),
    ),
    "set and actual exposures": (
        {"e.csv": "file,SetExposure,ActualExposure\na,1,1\n"},
        ExposureError,
        ("e.csv, line 1", "'SetExposure', 'ActualExposure'", "keep one of them and name it 'exposure_ms'"),
    ),
    "fraction of another unit": (
        {"e.csv": "file,shutter_ms\na,1/618\n"},
        RecordingError,
        ("e.csv, line 2", "'1/618' is a fraction, but fractions are read in seconds only; write it as a decimal"),
    ),
    "fraction of nothing": ({"e.csv": "file,shutter\na,1/0\n"}, ExposureError, ("e.csv, line 2", "positive")),
    "two lists": (
        {"times.txt": "a 1 1\n", "x.csv": "file,exposure\na,1\n"},
        ExposureError,
        ("times.txt, x.csv", "keep"),
    ),
    "two exposures": (
        {"e.csv": "file,exposure_ms,exposure_us\na,1,1\n"},
        ExposureError,
        ("e.csv, line 1", "'exposure_ms', 'exposure_us'", "name it 'exposure_ms'"),
    ),
    "two stamps": (
        {"e.csv": "stamp_s,timestamp_ns,exposure_ms\n1,1,1\n"},
        ExposureError,
        ("e.csv, line 1", "name it 'timestamp'"),
    ),
    "two columns of numbers": (
        {"times.txt": "1 1\n2 2\n3 3\n"},
        ExposureError,
        ("times.txt", "which of the 2 columns", "name the columns"),
    ),
    "no such column": ({"times.txt": "file,stamp\na,1\n"}, ExposureError, ("times.txt", "which of the 2 columns")),
    "empty cell": (
        {"e.csv": "file,exposure_ms\na,1\nb,\n"},
        RecordingError,
        ("line 3: the exposure is missing", "nan"),
    ),
    "ragged": ({"e.csv": "file,exposure_ms\na,1\nb\n"}, RecordingError, ("e.csv, line 3", "has 1 column, but")),
    "text": ({"e.csv": "file,exposure_ms\na,1\nb,soon\n"}, RecordingError, ("e.csv, line 3", "'soon'")),
    "gain is text": (
        {"e.csv": "file,exposure_ms,gain\na,1,auto\n"},
        RecordingError,
        ("line 2", "the gain", "'auto'"),
    ),
    "zero": ({"e.csv": "file,exposure_ms\na,1\nb,0\nc,1\n"}, ExposureError, ("e.csv, line 3", "positive")),
    "zero gain": (
        {"e.csv": "file,exposure_ms,Gain\na,1,0\nb,1,0\n"},
        ExposureError,
        ("e.csv, lines 2, 3: the gain in column 'Gain' is 0", "--gain-unit db"),
    ),
    "absurd gain": ({"e.csv": "file,exposure_ms,gain_db\na,1,1e9\n"}, ExposureError, ("e.csv, line 2", "positive")),
    "image unnamed": (
        {"e.csv": "file,exposure_ms\n,1\n"},
        RecordingError,
        ("e.csv, line 2", "does not name its image"),
    ),
    "quotes": ({"exposures.csv": 'file,exposure_ms\n"a"b,1\n'}, RecordingError, ("exposures.csv, line 2", "quotes")),
    "empty": ({"exposures.txt": ""}, RecordingError, ("exposures.txt", "has no frames")),
    "header only": ({"exposures.csv": "file,exposure_ms\n"}, RecordingError, ("exposures.csv", "has no frames")),
    "too few": ({"exposures.txt": "1\n2\n"}, RecordingError, ("exposures.txt", "2 frames", "3 images")),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_list_is_one_error_with_a_remedy(opened: Open, case: str) -> None:
    files, error, parts = BROKEN[case]
    with pytest.raises(error) as caught:
        opened(files)
    assert all(part in str(caught.value) for part in parts), str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_kind_given_by_name_says_what_it_needs(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(RecordingError, match="give a folder"):
        open_recording(tmp_path / "file", "image_folder")
    with pytest.raises(RecordingError, match="has no images"):
        open_recording(tmp_path, "image_folder")


cells = st.sampled_from(
    [
        "",
        "1",
        "nan",
        "1/8",
        "a.png",
        "exposure",
        "exposure_us",
        "stamp[ns]",
        "gain_db",
        "gain_raw",
        "iso",
        "#",
        '"',
        "\x1b",
    ]
)


@given(
    st.lists(st.lists(cells, min_size=1, max_size=5), max_size=5),
    st.sampled_from([",", ";", "\t", " "]),
    st.sampled_from([(), ("a.png",), ("1.png", "a.png")]),
    st.booleans(),
)
def test_any_table_is_parsed_or_refused(
    rows: list[list[str]], separator: str, images: tuple[str, ...], numbered: bool
) -> None:
    text = "\n".join(separator.join(row) for row in rows)
    try:
        table = table_of(text, "list.csv", images=images, numbered=numbered)
    except OspcError as error:
        assert str(error).isprintable()  # noqa: PT017
    else:
        assert (table.exposures_ms > 0).all()


@given(st.text(max_size=100))
def test_any_text_is_parsed_or_refused_as_an_image_list(text: str) -> None:
    try:
        table_of(text, "image_list.txt")
    except OspcError as error:
        assert "\n" not in str(error)  # noqa: PT017


def test_an_image_list_is_in_seconds_and_checked_against_its_inverse() -> None:
    table = table_of("# Filename exposure 1/shutter\na.png 32 0.03125\nb.png 0.5 2\n", "image_list.txt")
    assert table.ids == ("a.png", "b.png")
    assert table.exposures_ms.tolist() == [32000, 500]
    with pytest.raises(ExposureError, match=r"image_list\.txt, line 1: the exposure 2 s contradicts its inverse 2"):
        table_of("a.png 2 2\n", "image_list.txt")


def test_an_image_list_may_have_an_unknown_aperture() -> None:
    assert table_of("a.png 2 0.5 nan 0\nb.png 1 1 nan 0\n", "image_list.txt").ids == ("a.png", "b.png")


def test_an_image_list_with_changing_aperture_is_refused() -> None:
    with pytest.raises(ExposureError, match="line 2: f-stop, gain or filter differ"):
        table_of("a.png 1 1 8 0 0\nb.png 0.5 2 11 0 0\n", "image_list.txt")


def test_an_image_list_without_exposures_is_refused() -> None:
    with pytest.raises(ExposureError, match="line 1: has no exposure"):
        table_of("a.png\n", "image_list.txt")


@pytest.mark.parametrize(("name", "frames", "longest_ms"), [("taipei", 10, 32_000), ("memorial", 16, 32_000)])
def test_real_exposure_series(real_data: Path, name: str, frames: int, longest_ms: float) -> None:
    recording = open_recording(real_data / "brackets" / name)
    assert (len(recording), recording.exposures_ms[0]) == (frames, longest_ms)
    assert recording.exposures_ms[:-1] == pytest.approx(2 * recording.exposures_ms[1:])
    images = [frame.image.mean() for frame in recording][:10]
    assert images == sorted(images, reverse=True)


def test_real_auto_exposures_of_an_industrial_camera(real_data: Path) -> None:
    table = read_list(real_data / "params" / "fomo_basler_exposures.csv")
    assert (len(table), table.exposures_ms.min(), table.exposures_ms.max()) == (1692, 0.171, 0.516)
    assert any("assumed to be in us" in note for note in table.notes)
    assert any("microseconds" in note for note in table.notes)


def test_a_list_two_folders_above_is_not_read(tmp_path: Path) -> None:
    images = tmp_path / "undistorted_images" / "cam0"
    images.mkdir(parents=True)
    for name in ("1.png", "2.png"):
        (images / name).write_bytes(encoded(grey()))
    (tmp_path / "times.txt").write_text("1 0.0 8.0\n2 0.1 8.0\n")
    with pytest.raises(ExposureError, match=r"has no list of exposures; add times\.txt"):
        open_recording(images)


def test_a_folder_that_was_removed_after_opening_ends_the_run(tmp_path):
    simulate(tmp_path / "made", SimulationSettings(size=(96, 72), frames=8))
    recording = open_recording(tmp_path / "made")
    (tmp_path / "made" / "images").rename(tmp_path / "away")
    with pytest.raises(RecordingError, match=r"was removed while it was read; restore it") as caught:
        calibrate(recording)
    assert not isinstance(caught.value, FrameError)
