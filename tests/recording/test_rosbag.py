"""ROS 1 and ROS 2 bags in every container, written by independent packages."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bag_samples import (
    ARAVIS,
    CUSTOM,
    FLIR,
    NAMED,
    REALSENSE,
    SEQUENCE,
    START_NS,
    STEP_NS,
    WRITERS,
    Sent,
    floats,
    header,
    image_message,
    images,
    metadata,
    write_bag1,
    write_bag2,
    write_mcap2,
)
from image_samples import encoded, grey
from test_bayer import mosaic, smooth

from ospc.errors import ExposureError, FrameError, RecordingError, escaped
from ospc.recording import open_recording
from ospc.recording.bags.mcap_file import McapFile
from ospc.recording.channel import Channel
from ospc.recording.exposure_units import ExposureUnit, GainUnit
from ospc.recording.options import ReadingOptions

MS = [1.5, 3.0, 6.0, 12.0]
FRAMES = [grey(i) for i in range(4)]


def assert_same(recording: Any, frames: list[Any] = FRAMES, ms: list[float] = MS) -> None:
    assert recording.exposures_ms == pytest.approx(ms)
    assert recording.stamps_s == pytest.approx([(START_NS + i * STEP_NS) / 1e9 for i in range(len(ms))], abs=1e-6)
    np.testing.assert_array_equal([frame.image for frame in recording], frames)


@pytest.mark.parametrize("writer", WRITERS)
def test_frames_and_exposures_are_the_same_from_every_container_and_writer(writer: str, tmp_path: Path) -> None:
    path = WRITERS[writer](tmp_path / "made", images(FRAMES) + floats(MS))
    recording = open_recording(path)
    assert recording.kind == "rosbag"
    assert_same(recording)
    assert any("in ms, inferred from their size" in note for note in recording.notes)


@pytest.mark.parametrize("writer", WRITERS)
def test_frames_may_be_read_in_any_order(writer: str, tmp_path: Path) -> None:
    frames = [grey(i) for i in range(80)]
    recording = open_recording(WRITERS[writer](tmp_path / "made", images(frames) + floats([2.0] * 80)))
    made = list(recording)
    for index in (70, 3, 4, 79, 0, 68):
        np.testing.assert_array_equal(made[index].image, frames[index])


ENCODINGS = {
    "mono8": (grey(0), {}, grey(0)),
    "padded rows": (grey(0), {"pad": 5}, grey(0)),
    "mono16": (grey(0, dtype=np.uint16, top=65536), {}, grey(0, dtype=np.uint16, top=65536)),
    "big-endian": (grey(0, dtype=np.uint16, top=65536), {"swapped": True}, grey(0, dtype=np.uint16, top=65536)),
    "left-aligned": (grey(0, dtype=np.uint16, top=4096) << 4, {}, grey(0, dtype=np.uint16, top=4096)),
    "yuv422_yuy2": (np.stack([grey(0), grey(9)], axis=2), {"encoding": "yuv422_yuy2"}, grey(0)),
    "uyvy": (np.stack([grey(9), grey(0)], axis=2), {"encoding": "uyvy"}, grey(0)),
    "grey as bgr8": (np.stack([grey(0)] * 3, axis=2), {"encoding": "bgr8"}, grey(0)),
    "grey as rgba8": (np.stack([grey(0)] * 4, axis=2), {"encoding": "rgba8"}, grey(0)),
}


@pytest.mark.parametrize("case", ENCODINGS)
@pytest.mark.parametrize("write", [write_bag1, write_mcap2])
def test_encodings(case: str, write: Any, tmp_path: Path) -> None:
    stored, how, expected = ENCODINGS[case]
    recording = open_recording(write(tmp_path / "made", images([stored], **how) + floats([2.0])))
    np.testing.assert_array_equal(next(iter(recording)).image, expected)


@pytest.mark.parametrize("write", [write_bag1, write_bag2, write_mcap2])
def test_a_path_may_have_any_characters(write: Any, tmp_path: Path) -> None:
    made = write(tmp_path / "made", images(FRAMES) + floats(MS))
    place = tmp_path / os.fsdecode(b"50% #1? \xff")
    assert len(open_recording(made.rename(place))) == len(FRAMES)


@pytest.mark.parametrize("channel", [Channel.RED, Channel.GREEN, Channel.BLUE])
@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "bgra8", "rgb16"])
def test_a_channel_of_colour(channel: Channel, encoding: str, tmp_path: Path) -> None:
    dtype = np.uint16 if encoding.endswith("16") else np.uint8
    stored = np.stack([grey(i, dtype=dtype, top=256) for i in range(4 if "a" in encoding else 3)], axis=2)
    stored[0, 0] = np.iinfo(dtype).max
    path = write_bag1(tmp_path / "made", images([stored], encoding=encoding) + floats([2.0]))
    recording = open_recording(path, options=ReadingOptions(channel=channel))
    expected = stored[:, :, encoding.index(channel.value[0])]
    np.testing.assert_array_equal(next(iter(recording)).image, expected)
    assert any(channel.value in note for note in recording.notes)


@pytest.mark.parametrize("channel", [None, *Channel])
def test_a_bayer_mosaic_gives_the_pixels_of_one_colour_or_all(channel: Channel | None, tmp_path: Path) -> None:
    scene = mosaic(smooth(0, np.uint8), "g..g")
    path = write_bag2(tmp_path / "made", images([scene], encoding="bayer_grbg8") + floats([2.0]))
    recording = open_recording(path, options=ReadingOptions(channel=channel))
    image = next(iter(recording)).image.astype(int)
    red, blue = scene[::2, 1::2].astype(int), scene[1::2, ::2].astype(int)
    green = np.rint((scene[::2, ::2].astype(int) + scene[1::2, 1::2]) / 2)
    luma = 0.299 * red + 0.587 * green + 0.114 * blue
    colour = np.dstack([blue, green, red])
    other = {Channel.RED: red, Channel.BLUE: blue, Channel.LUMINANCE: luma, Channel.ALL: colour}
    expected = other.get(channel or Channel.GREEN, green)
    np.testing.assert_allclose(image, expected, atol=0 if channel is not Channel.LUMINANCE else 0.51)


@pytest.mark.parametrize(("suffix", "said"), [(".png", "mono8; png compressed "), (".jpg", "jpeg")])
def test_compressed_images(suffix: str, said: str, tmp_path: Path) -> None:
    smooth_frames = [smooth(i, np.uint8) for i in range(4)]
    sent = [
        Sent(
            "/cam/image_raw/compressed",
            "sensor_msgs/msg/CompressedImage",
            {
                "header": header(START_NS + i * STEP_NS),
                "format": said,
                "data": np.frombuffer(encoded(image, suffix), np.uint8),
            },
            START_NS + i * STEP_NS,
        )
        for i, image in enumerate(smooth_frames)
    ]
    recording = open_recording(write_bag1(tmp_path / "made", sent + floats(MS)))
    got = np.array([frame.image for frame in recording]).astype(int)
    assert np.abs(got - np.array(smooth_frames)).max() <= (0 if suffix == ".png" else 6)


US = [1500, 3000, 6000, 12000]
CARRIERS: dict[str, tuple[list[Sent], list[float], str]] = {
    "flir": (
        metadata([{"exposure_time": us, "gain": 20.0} for us in US], FLIR, "/cam/meta"),
        [10 * ms for ms in MS],
        "gain in dB",
    ),
    "realsense": (
        metadata(
            [{"json_data": json.dumps({"actual_exposure": us, "gain_level": 32})} for us in US],
            REALSENSE,
            "/cam/metadata",
        ),
        [2 * ms for ms in MS],
        "gain_level / 16",
    ),
    "pointgrey": (
        metadata([{"shutter": [ms], "gain": 6.0205999} for ms in MS], SEQUENCE, "/cam/exposure_sequence"),
        [2 * ms for ms in MS],
        "shutter in ms",
    ),
    "aravis": (
        [
            Sent(
                "/cam/extended_camera_info",
                ARAVIS.kind,
                {
                    "camera_info": {"header": header(START_NS + i * STEP_NS)},
                    "exposure_time": us,
                    "gain": 7.0,
                },
                START_NS + i * STEP_NS,
            )
            for i, us in enumerate(US)
        ],
        MS,
        "the gain is constant",
    ),
    "libcamera": (
        [
            Sent(
                "/diagnostics",
                "diagnostic_msgs/msg/DiagnosticArray",
                {
                    "header": header(START_NS + i * STEP_NS),
                    "status": [
                        {"name": "disk", "values": [{"key": "free", "value": "many"}]},
                        {
                            "name": "camera",
                            "values": [
                                {"key": "ExposureTime", "value": str(us)},
                                {"key": "AnalogueGain", "value": "2.0"},
                                {"key": "DigitalGain", "value": "1.5"},
                            ],
                        },
                    ],
                },
                START_NS + i * STEP_NS,
            )
            for i, us in enumerate(US)
        ],
        [3 * ms for ms in MS],
        "AnalogueGain × DigitalGain",
    ),
}


@pytest.mark.parametrize("case", CARRIERS)
@pytest.mark.parametrize("write", [write_bag1, write_bag2])
def test_known_carriers_of_exposures(case: str, write: Any, tmp_path: Path) -> None:
    sent, expected, said = CARRIERS[case]
    recording = open_recording(write(tmp_path / "made", images(FRAMES) + sent))
    assert_same(recording, ms=expected)
    assert any(said in note for note in recording.notes), recording.notes


def test_a_gain_that_changes_in_a_unit_of_its_own_has_to_be_stated(tmp_path: Path) -> None:
    sent = CARRIERS["aravis"][0]
    changing = [Sent(s.topic, s.kind, s.content | {"gain": 6.0205999 * i}, s.log_ns) for i, s in enumerate(sent)]
    path = write_bag1(tmp_path / "made", images(FRAMES) + changing)
    with pytest.raises(ExposureError, match=r"gain changes from 0 to 18.06.*--gain-unit"):
        open_recording(path)
    recording = open_recording(path, options=ReadingOptions(gain_unit=GainUnit.DB))
    assert recording.exposures_ms == pytest.approx([ms * 2**i for i, ms in enumerate(MS)])


def test_any_field_can_be_named_with_its_unit(tmp_path: Path) -> None:
    sent = metadata([{"exposure_time": us, "gain": 2.0, "brightness": i} for i, us in enumerate(US)], FLIR, "/x/y")
    path = write_mcap2(tmp_path / "made", images(FRAMES) + sent + floats([9.0] * 4))
    options = ReadingOptions(
        exposure_topic="x/y", exposure_field="exposure_time", exposure_unit=ExposureUnit.US100, gain_field="gain"
    )
    assert open_recording(path, options=options).exposures_ms == pytest.approx([us / 10 * 2 for us in US])
    with pytest.raises(
        RecordingError,
        match=r"no field shutter; it has header, camera_time, brightness, exposure_time, max_exposure_time, gain$",
    ):
        open_recording(path, options=ReadingOptions(exposure_topic="/x/y", exposure_field="shutter"))
    sent = metadata([{"shutter": 1.0, "name": ""}] * 4, CUSTOM, "/own")
    options = ReadingOptions(exposure_topic="/own")
    with pytest.raises(
        ExposureError, match=r"own.*: /own has type .* with --exposure-field: shutter, window\.x_offset, "
    ):
        open_recording(write_mcap2(tmp_path / "own", images(FRAMES) + sent), options=options)
    with pytest.raises(RecordingError, match="has no topic '/z'; it has"):
        open_recording(path, options=ReadingOptions(exposure_topic="/z"))
    with pytest.raises(ExposureError, match="not a field name"):
        open_recording(path, options=ReadingOptions(exposure_topic="/x/y", exposure_field="a; b"))


def test_units_in_the_names_of_fields_are_used(tmp_path: Path) -> None:
    values = [{"shutter_100us": np.array([10 * ms]), "analog_gain_db": 6.0206 * i} for i, ms in enumerate(MS)]
    path = write_mcap2(tmp_path / "made", images(FRAMES) + metadata(values, NAMED, "/own"))
    stated: dict[str, Any] = {"exposure_topic": "/own", "exposure_field": "shutter_100us[0]"}
    for gain_field in ("analog_gain_db", None):
        recording = open_recording(path, options=ReadingOptions(**stated, gain_field=gain_field))
        assert recording.exposures_ms == pytest.approx([ms * 2**i for i, ms in enumerate(MS)], rel=1e-6)
        said = "exposures are the field shutter_100us[0] in 100us times the gain in field analog_gain_db (dB)"
        assert any(note.endswith(said) for note in recording.notes), recording.notes
    ignored = ReadingOptions(**stated, gain_unit=GainUnit.NONE)
    assert open_recording(path, options=ignored).exposures_ms == pytest.approx(MS)
    linear = ReadingOptions(**stated, gain_field="analog_gain_db", gain_unit=GainUnit.LINEAR)
    with pytest.raises(ExposureError, match="image 0: the exposure must be"):  # a linear gain of 0
        open_recording(path, options=linear)
    with pytest.raises(ExposureError, match="--gain-field needs --exposure-field"):
        open_recording(path, options=ReadingOptions(exposure_topic="/own", gain_field="analog_gain_db"))


def test_a_unit_in_the_name_of_a_topic_with_plain_numbers_is_used(tmp_path: Path) -> None:
    recording = open_recording(write_bag1(tmp_path / "made", images(FRAMES) + floats(MS, "/cam/exposure_us")))
    assert recording.exposures_ms == pytest.approx([ms / 1000 for ms in MS])
    assert any(note.endswith("exposures are its numbers in us") for note in recording.notes)


@pytest.mark.parametrize(
    ("values", "unit", "expected"),
    [
        ([0.0015, 0.003, 0.006, 0.012], "s", MS),
        ([1500.0, 3000.0, 6000.0, 12000.0], "us", MS),
        ([-8.0, -7.0, -6.0, -5.0], "log2s", [1000 * 2.0**e for e in (-8, -7, -6, -5)]),
    ],
)
def test_units_are_found_from_the_numbers(
    values: list[float], unit: str, expected: list[float], tmp_path: Path
) -> None:
    recording = open_recording(write_bag1(tmp_path / "made", images(FRAMES) + floats(values)))
    assert recording.exposures_ms == pytest.approx(expected)
    assert any(f"in {unit}, inferred from their size" in note for note in recording.notes)


def test_images_without_exposure_are_left_out(tmp_path: Path) -> None:
    sent = metadata([{"exposure_time": us, "gain": 0.0} for us in US], FLIR, "/cam/meta")
    recording = open_recording(write_bag2(tmp_path / "made", images(FRAMES) + sent[:1] + sent[2:]))
    assert recording.exposures_ms == pytest.approx([1.5, 6, 12])
    np.testing.assert_array_equal([f.image for f in recording], [FRAMES[i] for i in (0, 2, 3)])
    assert any("1 of 4 images left out, because no exposure" in note for note in recording.notes)
    with pytest.raises(ExposureError, match="exposures for only 1 of 4 images"):
        open_recording(write_bag1(tmp_path / "few", images(FRAMES) + sent[:1]))


def test_an_image_without_exposure_does_not_get_that_of_an_image_that_was_not_recorded(tmp_path: Path) -> None:
    sent = metadata([{"exposure_time": 1000 * (1 + i), "gain": 0.0} for i in range(12)], FLIR, "/cam/meta")
    recorded = images([FRAMES[i % 4] for i in range(12)])[::2]
    recording = open_recording(write_bag2(tmp_path / "made", recorded + sent[:6] + sent[7:]))
    assert recording.exposures_ms == pytest.approx([1, 3, 5, 9, 11])
    assert any("1 of 6 images left out, because no exposure has the same" in note for note in recording.notes)


@pytest.mark.parametrize("late_ns", [0, 3_000_000])  # the images are recorded 3 ms after their time stamps
@pytest.mark.parametrize("write", [write_bag1, write_bag2])
def test_exposures_may_be_in_a_list_next_to_the_bag(write: Any, late_ns: int, tmp_path: Path) -> None:
    path = write(tmp_path / "made", images(FRAMES, stamped=not late_ns) + floats([9.0] * 4))
    lines = [f"{START_NS + i * STEP_NS + late_ns},{us}" for i, us in enumerate(US)]
    own_list = tmp_path / "made.csv"
    own_list.write_text("\n".join(["timestamp_ns,exposure_us", "17,5", *lines, ""]))
    recording = open_recording(path)
    assert recording.exposures_ms == pytest.approx(MS)
    np.testing.assert_array_equal([frame.image for frame in recording], FRAMES)
    assert f"{own_list}: exposures are read from this list" in recording.notes
    stated = open_recording(path, options=ReadingOptions(exposure_topic="/cam/exposure"))
    assert stated.exposures_ms == pytest.approx([9.0] * 4)
    own_list.write_text("x,y\n1,2\n")  # another list
    assert open_recording(path).exposures_ms == pytest.approx([9.0] * 4)
    own_list.write_text("exposure_us\n1\n2\n")
    with pytest.raises(ExposureError, match="has no time stamps; add a column timestamp_s or timestamp_ns"):
        open_recording(path)
    own_list.write_text("timestamp_s,exposure_us\n1,1\n2,2\n")
    with pytest.raises(ExposureError, match="has exposures for only 0 of 4 images"):
        open_recording(path)


@pytest.mark.parametrize("days", [1, 60, 100, 20_000])  # since the computer was started, or since 1970
def test_time_stamps_of_a_list_are_equal_however_long_the_clock_runs(days: int, tmp_path: Path) -> None:
    stamps_ns = [days * 86400 * 10**9 + i * STEP_NS + i * i % 1009 for i in range(40)]
    sent = [
        Sent("/cam/image_raw", "sensor_msgs/msg/Image", image_message(FRAMES[i % 4], stamp), stamp)
        for i, stamp in enumerate(stamps_ns)
    ]
    lines = [f"{stamp},{1 + i}" for i, stamp in enumerate(stamps_ns) if i != 7]
    (tmp_path / "made.csv").write_text("\n".join(["timestamp_ns,exposure_ms", *lines, ""]))
    recording = open_recording(write_bag1(tmp_path / "made", sent))
    assert recording.exposures_ms == pytest.approx([1 + i for i in range(40) if i != 7])
    assert any("1 of 40 images left out, because no exposure has the same time" in note for note in recording.notes)


def test_a_list_of_a_bag_in_an_unknown_encoding_is_named(tmp_path: Path) -> None:
    path = write_bag1(tmp_path / "made", images(FRAMES))
    (tmp_path / "made.csv").write_bytes("timestamp_ns,exposure_us\n1,2\n".encode("utf-16-le"))
    with pytest.raises(ExposureError, match=r"made\.csv: not a text file in UTF-8.*; save it as UTF-8"):
        open_recording(path)


@pytest.mark.parametrize("write", [write_bag1, write_bag2])
def test_the_list_of_a_bag_may_be_next_to_its_file_in_a_folder(write: Any, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    folder = write(tmp_path / "folder" / "made", images(FRAMES))
    folder = folder if folder.is_dir() else folder.parent
    (file,) = (path for path in folder.iterdir() if path.suffix in (".bag", ".db3", ".mcap"))
    lines = [f"{START_NS + i * STEP_NS},{us}" for i, us in enumerate(US)]
    file.with_suffix(".csv").write_text("\n".join(["timestamp_ns,exposure_us", *lines, ""]))
    assert_same(open_recording(folder))


@pytest.mark.parametrize("place", [".", ".."])
def test_a_bag_may_be_the_current_folder(place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "made"
    (folder / "inner").mkdir(parents=True)
    write_bag1(folder / "part", images(FRAMES))
    lines = [f"{START_NS + i * STEP_NS},{us}" for i, us in enumerate(US)]
    (tmp_path / "made.csv").write_text("\n".join(["timestamp_ns,exposure_us", *lines, ""]))
    monkeypatch.chdir(folder if place == "." else folder / "inner")
    assert_same(open_recording(place))


def test_bags_that_are_joined_are_named_in_a_note(tmp_path: Path) -> None:
    sent = images(FRAMES) + floats(MS)
    (tmp_path / "made").mkdir()
    write_bag1(tmp_path / "made" / "b", sent[:2] + sent[4:6])
    write_bag1(tmp_path / "made" / "a", sent[2:4] + sent[6:])
    said = f"{tmp_path / 'made'}: 2 bags are read as one recording: a.bag, b.bag"
    assert said in open_recording(tmp_path / "made").notes
    (tmp_path / "made" / "a.bag").unlink()
    assert not any("as one recording" in note for note in open_recording(tmp_path / "made").notes)


@pytest.mark.parametrize("unknown", [0.0, -1.0])
def test_an_exposure_that_is_not_positive_is_unknown(unknown: float, tmp_path: Path) -> None:
    path = write_bag1(tmp_path / "made", images(FRAMES) + floats([unknown, *MS[1:]]))
    recording = open_recording(path, options=ReadingOptions(exposure_unit=ExposureUnit.MS))
    assert recording.exposures_ms == pytest.approx([np.nan, *MS[1:]], nan_ok=True)


def test_exposures_that_are_all_zero_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ExposureError, match="has no positive exposures; check that it is the right field"):
        open_recording(write_bag2(tmp_path / "all", images(FRAMES) + floats([0.0] * 4)))


def test_unusable_exposures_may_be_ignored(tmp_path: Path) -> None:
    few = metadata([{"exposure_time": US[0], "gain": 0.0}], FLIR, "/cam/meta")
    for number, sent in enumerate((few, floats([-500.0] * 4), [])):
        path = write_bag1(tmp_path / str(number), images(FRAMES) + sent)
        recording = open_recording(path, options=ReadingOptions(unknown_exposures=True))
        assert_same(recording, ms=[1.0] * 4)
        assert any("has no usable exposures" in note for note in recording.notes)


def test_stamps_of_another_clock_are_replaced_by_times_of_recording(tmp_path: Path) -> None:
    sent = metadata([{"exposure_time": us, "gain": 0.0} for us in US], FLIR, "/cam/meta")
    other = [Sent(s.topic, s.kind, s.content | {"header": header(10**9 + i)}, s.log_ns) for i, s in enumerate(sent)]
    recording = open_recording(write_mcap2(tmp_path / "made", images(FRAMES) + other))
    assert_same(recording)
    assert any("matched to images by time of recording" in note for note in recording.notes)


def test_images_out_of_order_are_left_out(tmp_path: Path) -> None:
    sent = images(FRAMES)
    early = image_message(FRAMES[2], START_NS)
    sent[2] = Sent(sent[2].topic, sent[2].kind, early, sent[2].log_ns)
    recording = open_recording(write_mcap2(tmp_path / "made", sent + floats(MS)))
    assert recording.exposures_ms == pytest.approx([1.5, 3, 12])
    np.testing.assert_array_equal([f.image for f in recording], [FRAMES[i] for i in (0, 1, 3)])


def test_of_several_cameras_the_first_is_read_with_its_own_exposures(tmp_path: Path) -> None:
    sent = images(FRAMES, "/cam1/image_raw") + images(FRAMES[::-1], "/cam0/image_raw")
    sent += floats([9.0] * 4, "/cam1/exposure_ms") + floats(MS, "/cam0/exposure_ms")
    path = write_bag1(tmp_path / "made", sent)
    first = open_recording(path)
    assert first.exposures_ms == pytest.approx(MS)
    assert "choose /cam1/image_raw with --image-topic" in first.notes[0]
    other = open_recording(path, options=ReadingOptions(image_topic="/cam1/image_raw"))
    assert_same(other, ms=[9.0] * 4)


def test_a_damaged_image_is_one_unreadable_frame(tmp_path: Path) -> None:
    sent = images(FRAMES)
    sent[1].content["height"] = 1000
    sent[2].content["encoding"] = "32FC1"
    made = list(open_recording(write_bag1(tmp_path / "made", sent + floats(MS))))
    for index, words in ((1, "are not 24×1000 pixels"), (2, "encoding '32FC1' are not supported")):
        with pytest.raises(FrameError, match=words):
            _ = made[index].image
    np.testing.assert_array_equal(made[3].image, FRAMES[3])


BROKEN: dict[str, tuple[list[Sent], str]] = {
    "no images": (floats(MS), "has no topic with images; it has /cam/exposure"),
    "no exposures": (images(FRAMES), "no topic is known to have the exposures of .*; name it with --exposure-topic"),
    "two exposures": (
        images(FRAMES) + floats(MS, "/a/exposure") + floats(MS, "/b/exposure"),
        "several topics may have the exposures of /cam/image_raw",
    ),
    "too short": (
        images(FRAMES) + floats([1e-12, 1, 2, 3]),
        "must be a positive number of milliseconds, not 1e-12",
    ),
    "nothing plausible": (images(FRAMES) + floats([-500.0] * 4), "not possible in any unit"),
}


@pytest.mark.parametrize("case", BROKEN)
@pytest.mark.parametrize("write", [write_bag1, write_bag2])
def test_what_is_missing_is_one_error(case: str, write: Any, tmp_path: Path) -> None:
    sent, words = BROKEN[case]
    with pytest.raises(RecordingError, match=words):
        open_recording(write(tmp_path / "made", sent))


@pytest.mark.parametrize("name", ["the", "a\a"])  # the beginning of a message, and a name that messages escape
@pytest.mark.parametrize("damage", [None, b"\x89MCAP0\r\n"])
def test_errors_name_the_file_once(
    name: str, damage: bytes | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    if damage is not None:
        Path(name).write_bytes(damage)
    with pytest.raises(RecordingError) as caught:
        McapFile(Path(name))
    assert str(caught.value).startswith(f"{escaped(name)}: ")
    assert str(caught.value).count(escaped(name) + ":") == 1


@pytest.mark.parametrize("writer", WRITERS)
@pytest.mark.parametrize("share", [0.99, 0.6, 0.2, 0.01])
def test_a_truncated_bag_is_one_error(writer: str, share: float, tmp_path: Path) -> None:
    path = WRITERS[writer](tmp_path / "made", images([grey(i, (64, 48)) for i in range(20)]) + floats([2.0] * 20))
    files = [p for p in path.rglob("*.*") if p.suffix in (".db3", ".mcap")] if path.is_dir() else [path]
    data = files[0].read_bytes()
    files[0].write_bytes(data[: int(len(data) * share)])
    with pytest.raises(RecordingError) as caught:
        _ = [frame.image for frame in open_recording(path)]
    assert str(files[0]) in str(caught.value) or "image_raw" in str(caught.value)
