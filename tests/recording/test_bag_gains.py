"""Gains on topics of plain numbers of their own, next to the exposures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from bag_samples import CUSTOM, FLIR, START_NS, STEP_NS, TWO_GAINS, floats, images, metadata, write_bag1, write_bag2
from image_samples import grey

from ospc.errors import ExposureError
from ospc.recording import open_recording
from ospc.recording.bags.bag import Bag, uses
from ospc.recording.exposure_units import GainUnit
from ospc.recording.options import ReadingOptions

FRAMES = [grey(i) for i in range(4)]
MS = [1.5, 3.0, 6.0, 12.0]
GAINS = [1.0, 2.0, 4.0, 1.0]
PRODUCT = [1.5, 6.0, 24.0, 12.0]


@pytest.mark.parametrize(
    ("topic", "gains"),
    [
        ("/cam/gain", GAINS),
        ("/gain", GAINS),
        ("/cam/exposure/gain", GAINS),
        ("/cam/sensor_gain", GAINS),
        ("/cam/iso", [100 * gain for gain in GAINS]),
        ("/cam/ISOSpeed", [100 * gain for gain in GAINS]),
        ("/cam/gain_db", [0, 6.0206, 12.0412, 0]),
    ],
)
@pytest.mark.parametrize("write", [write_bag1, write_bag2])
def test_exposures_are_multiplied_by_the_gain_on_its_own_topic(write, topic, gains, tmp_path: Path) -> None:
    path = write(tmp_path / "made", images(FRAMES) + floats(MS) + floats(gains, topic))
    recording = open_recording(path)
    assert recording.exposures_ms == pytest.approx(PRODUCT, rel=1e-4)
    assert any(f"{topic}: exposures are multiplied by this gain" in note for note in recording.notes)
    assert {t.name: use for t, use in uses(Bag.at(path))}[topic] == "gain"
    ignored = open_recording(path, options=ReadingOptions(gain_unit=GainUnit.NONE))
    assert ignored.exposures_ms == pytest.approx(MS)


def test_several_gains_multiply_and_the_unit_may_be_stated(tmp_path: Path) -> None:
    sent = images(FRAMES) + floats(MS) + floats(GAINS, "/cam/analog_gain") + floats(GAINS, "/cam/digital_gain")
    path = write_bag1(tmp_path / "made", sent)
    squares = [gain**2 for gain in GAINS]
    assert open_recording(path).exposures_ms == pytest.approx([ms * s for ms, s in zip(MS, squares, strict=True)])
    stated = open_recording(path, options=ReadingOptions(gain_unit=GainUnit.DB))
    assert stated.exposures_ms == pytest.approx([ms * 10 ** (gain / 10) for ms, gain in zip(MS, GAINS, strict=True)])


def test_a_stated_unit_of_gains_does_not_change_exposures_without_a_gain(tmp_path: Path) -> None:
    path = write_bag1(tmp_path / "made", images(FRAMES) + floats(MS))
    assert open_recording(path, options=ReadingOptions(gain_unit=GainUnit.DB)).exposures_ms == pytest.approx(MS)


@pytest.mark.parametrize("topic", ["/cam/gain_percent", "/cam/isp_gain", "/cam/gain/value"])
def test_a_topic_that_looks_like_a_gain_and_changes_is_an_error_until_its_unit_is_stated(
    topic: str, tmp_path: Path
) -> None:
    path = write_bag1(tmp_path / "made", images(FRAMES) + floats(MS) + floats(GAINS, topic))
    with pytest.raises(ExposureError, match=rf"{topic}: the gain changes from 1 to 4 in .* give it with --gain-unit"):
        open_recording(path)
    for unit, expected in ((GainUnit.LINEAR, PRODUCT), (GainUnit.NONE, MS)):
        assert open_recording(path, options=ReadingOptions(gain_unit=unit)).exposures_ms == pytest.approx(expected)


@pytest.mark.parametrize("topic", ["/cam/gain", "/cam/isp_gain"])
def test_a_constant_gain_may_be_rare_and_is_ignored(topic: str, tmp_path: Path) -> None:
    recording = open_recording(write_bag1(tmp_path / "made", images(FRAMES) + floats(MS) + floats([7.0], topic)))
    assert recording.exposures_ms == pytest.approx(MS)
    assert any(f"{topic}: the gain is constant and ignored" in note for note in recording.notes)


def test_images_without_a_gain_are_left_out_and_too_few_gains_are_refused(tmp_path: Path) -> None:
    sent = images(FRAMES) + floats(MS)
    gains = floats(GAINS, "/cam/gain")
    assert open_recording(write_bag1(tmp_path / "one", sent + gains[:3])).exposures_ms == pytest.approx(PRODUCT[:3])
    late = floats(GAINS[:2], "/cam/gain", late_ns=30 * STEP_NS)
    with pytest.raises(ExposureError, match="/cam/gain: has gains for only 0 of 4 images; record the gain with"):
        open_recording(write_bag1(tmp_path / "few", sent + late))


def test_every_camera_has_its_own_gain(tmp_path: Path) -> None:
    sent = []
    for camera, factor in (("cam0", 1), ("cam1", 10)):
        sent += images(FRAMES, f"/{camera}/image_raw") + floats(MS, f"/{camera}/exposure")
        sent += floats([factor * gain for gain in GAINS], f"/{camera}/gain")
    path = write_bag1(tmp_path / "made", sent)
    for camera, factor in (("cam0", 1), ("cam1", 10)):
        options = ReadingOptions(image_topic=f"/{camera}/image_raw")
        assert open_recording(path, options=options).exposures_ms == pytest.approx([factor * ms for ms in PRODUCT])


def test_messages_with_a_gain_of_their_own_need_no_other(tmp_path: Path) -> None:
    sent = metadata([{"exposure_time": round(1000 * ms), "gain": 0.0} for ms in MS], FLIR, "/cam/meta")
    path = write_bag1(tmp_path / "made", images(FRAMES) + sent + floats(GAINS, "/cam/gain"))
    assert open_recording(path).exposures_ms == pytest.approx(MS)
    stated = metadata([{"shutter": ms, "name": ""} for ms in MS], CUSTOM, "/cam/own")
    path = write_bag1(tmp_path / "stated", images(FRAMES) + stated + floats(GAINS, "/cam/gain"))
    options = ReadingOptions(exposure_topic="/cam/own", exposure_field="shutter")
    assert open_recording(path, options=options).exposures_ms == pytest.approx(PRODUCT)


@pytest.mark.parametrize("topic", ["/cam/temperature", "/cam/red_gain", "/cam/auto_exposure"])
def test_other_topics_may_change(topic: str, tmp_path: Path) -> None:
    sent = images(FRAMES) + floats(MS, "/cam/high_gain/exposure") + floats(GAINS, topic)
    options = ReadingOptions(exposure_topic="/cam/high_gain/exposure")
    assert open_recording(write_bag1(tmp_path / "made", sent), options=options).exposures_ms == pytest.approx(MS)


def test_a_name_above_the_topic_does_not_hide_a_gain(tmp_path: Path) -> None:
    sent = images(FRAMES, "/rgb/image_raw") + floats(MS, "/rgb/exposure") + floats(GAINS, "/rgb/isp_gain")
    with pytest.raises(ExposureError, match="/rgb/isp_gain: the gain changes from 1 to 4"):
        open_recording(write_bag1(tmp_path / "made", sent))


def test_which_of_two_gains_beside_a_stated_exposure_counts_must_be_stated(tmp_path: Path) -> None:
    values = [
        {"exposure_ms": ms, "analog_gain": gain, "digital_gain": 1.0} for ms, gain in zip(MS, GAINS, strict=True)
    ]
    path = write_bag2(tmp_path / "made", images(FRAMES) + metadata(values, TWO_GAINS, "/own"))
    stated = ReadingOptions(exposure_topic="/own", exposure_field="exposure_ms")
    with pytest.raises(ExposureError, match=r"also has analog_gain, digital_gain; name the field .* --gain-field"):
        open_recording(path, options=stated)
    recording = open_recording(path, options=replace(stated, gain_field="analog_gain"))
    assert recording.exposures_ms == pytest.approx(PRODUCT)
    assert open_recording(path, options=replace(stated, gain_unit=GainUnit.NONE)).exposures_ms == pytest.approx(MS)


@pytest.mark.parametrize("options", [ReadingOptions(), ReadingOptions(gain_unit=GainUnit.LINEAR)])
def test_a_list_beside_a_bag_is_multiplied_by_the_gain_in_the_bag_unless_it_has_its_own(
    options: ReadingOptions, tmp_path: Path
) -> None:
    path = write_bag1(tmp_path / "made", images(FRAMES) + floats(GAINS, "/cam/gain"))
    stamps_ns = [START_NS + i * STEP_NS for i in range(4)]
    lines = "".join(f"{stamp},{ms}\n" for stamp, ms in zip(stamps_ns, MS, strict=True))
    own_list = path.with_suffix(".csv")
    own_list.write_text(f"timestamp_ns,exposure_ms\n{lines}")
    recording = open_recording(path, options=options)
    assert recording.exposures_ms == pytest.approx(PRODUCT)
    assert any("/cam/gain: exposures are multiplied by this gain" in note for note in recording.notes)
    ignored = open_recording(path, options=ReadingOptions(gain_unit=GainUnit.NONE))
    assert ignored.exposures_ms == pytest.approx(MS)
    own_list.write_text("timestamp_ns,exposure_ms,gain\n" + lines.replace("\n", ",3\n"))
    assert open_recording(path, options=options).exposures_ms == pytest.approx([3 * ms for ms in MS])


def test_a_gain_without_a_unit_is_linear_as_in_lists_and_a_note_says_what_else_it_may_be(tmp_path: Path) -> None:
    doubt = "(linear, as its name states no unit; add --gain-unit db if it is in decibels)"
    values = [{"exposure_time": round(1000 * ms), "gain": gain} for ms, gain in zip(MS, GAINS, strict=True)]
    path = write_bag1(tmp_path / "field", images(FRAMES) + metadata(values, FLIR, "/own"))
    options = ReadingOptions(exposure_topic="/own", exposure_field="exposure_time")
    topic = write_bag1(tmp_path / "topic", images(FRAMES) + floats(MS) + floats(GAINS, "/cam/gain"))
    for recording in (open_recording(path, options=options), open_recording(topic)):
        assert recording.exposures_ms == pytest.approx(PRODUCT)
        assert any(doubt in note for note in recording.notes), recording.notes
    stated = open_recording(topic, options=ReadingOptions(gain_unit=GainUnit.LINEAR))
    assert any(note.endswith("(linear)") for note in stated.notes)


def test_no_image_may_have_both_an_exposure_and_a_gain(tmp_path: Path) -> None:
    gains = [replace(sent, log_ns=sent.log_ns + 2 * STEP_NS) for sent in floats([1.0, 2.0], "/cam/gain")]
    path = write_bag1(tmp_path / "made", images(FRAMES) + floats(MS[:2]) + gains)
    with pytest.raises(ExposureError, match="no exposure is known"):
        open_recording(path)
