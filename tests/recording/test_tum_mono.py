"""Folders with times.txt and images/ or images.zip."""

from __future__ import annotations

import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from image_samples import encoded, grey, jpeg_of_size, png_of_size

from exif_segments import exif
from ospc.errors import ExposureError, FrameError, RecordingError, SettingError
from ospc.recording import open_recording
from ospc.recording.channel import Channel
from ospc.recording.options import ReadingOptions

Make = Callable[..., Path]


def test_a_folder_gives_its_frames_in_order(tum_folder: Make) -> None:
    recording = open_recording(tum_folder())
    assert (recording.kind, recording.size, recording.max_grey, len(recording)) == ("tum_mono", (24, 16), 255, 3)
    assert recording.exposures_ms.tolist() == [1.5, 3, 6]
    assert recording.stamps_s.tolist() == [10.0, 10.1, 10.2]
    for index, frame in enumerate(recording):
        assert (frame.index, frame.name) == (index, f"{index:05d}.png")
        assert (frame.exposure_ms, frame.stamp_s) == (recording.exposures_ms[index], recording.stamps_s[index])
        np.testing.assert_array_equal(frame.image, grey(index))


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
@pytest.mark.parametrize("folder", ["", "images/", "deep/er/"])
def test_an_archive_gives_the_same_frames_as_a_folder(tum_archive: Make, method: int, folder: str) -> None:
    members = {f"{folder}{i:05d}.png": encoded(grey(i)) for i in range(3)}
    recording = open_recording(tum_archive(members, method=method))
    for index, frame in enumerate(recording):
        np.testing.assert_array_equal(frame.image, grey(index))


@pytest.mark.parametrize("suffix", [".png", ".PNG", ".bmp", ".tif", ".pgm"])
def test_lossless_formats_give_the_pixels_that_were_written(tum_folder: Make, suffix: str) -> None:
    recording = open_recording(tum_folder(images={f"{i}{suffix}": encoded(grey(i), suffix) for i in range(3)}))
    for index, frame in enumerate(recording):
        np.testing.assert_array_equal(frame.image, grey(index))


@pytest.mark.parametrize("suffix", [".png", ".tif", ".bmp", ".ppm"])
def test_of_colour_the_green_channel_is_read_and_rounded_luma_on_request(tum_folder: Make, suffix: str) -> None:
    colour = np.random.default_rng(1).integers(0, 256, (16, 24, 3), dtype=np.uint8)
    folder = tum_folder("0 1 1\n", {f"0{suffix}": encoded(colour, suffix)})
    recording = open_recording(folder)
    np.testing.assert_array_equal(next(iter(recording)).image, colour[:, :, 1])
    assert "green channel of colour images" in recording.notes[0]
    recording = open_recording(folder, options=ReadingOptions(channel=Channel.LUMINANCE))
    luma = colour @ np.array([0.114, 0.587, 0.299])
    assert np.abs(next(iter(recording)).image - luma).max() < 0.51
    assert "luminance channel of colour images" in recording.notes[0]


def test_a_channel_of_grey_images_is_refused_with_a_remedy(tum_folder: Make) -> None:
    path = tum_folder()
    for channel in (Channel.RED, Channel.GREEN, Channel.BLUE):
        expected = f"{path}/images: its images are grey and have no {channel.value} channel; leave out --channel, or "
        with pytest.raises(SettingError, match=f"^{expected}.* --bayer"):
            open_recording(path, options=ReadingOptions(channel=channel))


def test_grey_stored_as_colour_is_unchanged(tum_folder: Make) -> None:
    recording = open_recording(tum_folder("0 1 1\n", {"0.png": encoded(np.dstack([grey()] * 3))}))
    np.testing.assert_array_equal(next(iter(recording)).image, grey())


def oriented_jpeg(orientation: int) -> bytes:
    segment = exif(orientation=orientation)
    return encoded(grey(), ".jpg")[:2] + segment + encoded(grey(), ".jpg")[2:]


def oriented_tiff(orientation: int, order: str = "<") -> bytes:
    height, width = grey().shape
    fields = [(256, width), (257, height), (258, 8), (262, 1), (273, 8), (274, orientation), (277, 1), (278, height)]
    rows = [struct.pack(f"{order}HHIHH", tag, 3, 1, value, 0) for tag, value in [*fields, (279, grey().size)]]
    start = {"<": b"II*\0", ">": b"MM\0*"}[order] + struct.pack(f"{order}I", 8 + grey().size)
    return start + grey().tobytes() + struct.pack(f"{order}H", len(rows)) + b"".join(rows) + bytes(4)


@pytest.mark.parametrize(
    ("name", "turned"),
    [("0.jpg", oriented_jpeg(6)), ("0.tiff", oriented_tiff(6)), ("0.tif", oriented_tiff(8, ">"))],
)
def test_the_orientation_noted_in_a_photograph_is_ignored(tum_folder: Make, name: str, turned: bytes) -> None:
    assert cv2.imdecode(np.frombuffer(turned, np.uint8), cv2.IMREAD_GRAYSCALE).shape == (24, 16)
    recording = open_recording(tum_folder("0 1 1\n", {name: turned}))
    assert recording.size == (24, 16)
    frame = next(iter(recording))
    assert frame.verify is not None
    frame.verify()
    assert np.abs(frame.image.astype(int) - grey()).max() <= (0 if "tif" in name else 40)


def test_nanosecond_ids_as_in_visual_inertial_datasets(tum_folder: Make) -> None:
    ids = ["1520531829251142058", "1520531829301144058"]
    times = "# filename timestamp[s] [exposuretime[ms]]\n" + "".join(f"{i} {int(i) / 1e9:.9f} 1.544\n" for i in ids)
    recording = open_recording(tum_folder(times, {f"{i}.png": encoded(grey()) for i in ids}))
    assert [frame.name for frame in recording] == [f"{i}.png" for i in ids]
    assert recording.notes == ()


def test_ids_find_their_images_whatever_the_zeros(tum_folder: Make) -> None:
    images = {f"{i}.png": encoded(grey(i)) for i in range(12)}
    recording = open_recording(tum_folder("".join(f"{i:05d} {i} 1\n" for i in range(12)), images))
    assert [frame.name for frame in recording] == [f"{i}.png" for i in range(12)]


def test_rows_decide_the_order_where_they_name_the_images(tum_folder: Make) -> None:
    recording = open_recording(tum_folder("00002 1 1\n00000 2 1\n00001 3 1\n"))
    assert [frame.name for frame in recording] == ["00002.png", "00000.png", "00001.png"]


@pytest.mark.parametrize("form", ["frame_{:05d}", "cam0-{}-raw", "{:03d}"])
def test_ids_are_the_numbers_by_which_the_names_of_images_differ(tum_folder: Make, form: str) -> None:
    images = {f"{form.format(i)}.png": encoded(grey(i)) for i in (7, 8, 10, 11)}
    place = tum_folder("10 1 1\n8 2 2\n11 3 4\n7 4 8\n", images)
    exposures_ms = {frame.name: frame.exposure_ms for frame in open_recording(place)}
    assert exposures_ms == {f"{form.format(i)}.png": ms for i, ms in ((10, 1), (8, 2), (11, 4), (7, 8))}
    (place / "times.txt").write_text("9 1 1\n8 2 2\n11 3 4\n7 4 8\n")
    with pytest.raises(RecordingError, match=f"no image for 9; no line for {form.format(10)}"):
        open_recording(place)


@pytest.mark.parametrize("names", [("a_1", "a_02", "b_3"), ("1_1", "1_2", "2_3"), ("x1y2", "x1y3", "x2y3")])
def test_names_that_differ_in_more_than_a_number_have_none(tum_folder: Make, names: tuple[str, ...]) -> None:
    recording = open_recording(
        tum_folder("3 1 1\n1 2 2\n2 3 4\n", {f"{name}.png": encoded(grey()) for name in names})
    )
    assert "matched by order" in recording.notes[-1]


@pytest.mark.parametrize("times", ["1 1 1\n2 2 1\n3 3 1\n", "a 1 1\nb 2 1\nc 3 1\n"])
def test_ids_that_name_no_image_are_matched_by_order_with_a_note(tum_folder: Make, times: str) -> None:
    recording = open_recording(tum_folder(times))
    assert [frame.name for frame in recording] == ["00000.png", "00001.png", "00002.png"]
    assert "matched by order" in recording.notes[-1]


def test_a_folder_hides_an_archive_unless_it_is_empty(tum_archive: Make) -> None:
    place = tum_archive()
    (place / "images").mkdir()
    assert len(open_recording(place)) == 3
    (place / "images" / "0.png").write_bytes(encoded(grey()))
    (place / "times.txt").write_text("0 1 1\n")
    recording = open_recording(place)
    assert len(recording) == 1
    assert "images.zip is ignored" in recording.notes[0]


def test_frames_can_be_iterated_over_twice(tum_archive: Make) -> None:
    recording = open_recording(tum_archive())
    assert [f.image.tobytes() for f in recording] == [f.image.tobytes() for f in recording]


IMAGES = {f"{i:05d}.png": encoded(grey(i)) for i in range(3)}
BROKEN: dict[str, tuple[str, dict[str, bytes], type[Exception], tuple[str, ...]]] = {
    "fewer lines": ("00000 1 1\n00001 2 1\n", IMAGES, RecordingError, ("times.txt", "2 frames", "3", "00002.png")),
    "more lines": (
        "".join(f"{i:05d} {i} 1\n" for i in range(4)),
        IMAGES,
        RecordingError,
        ("times.txt", "4 frames", "3 images", "no image for 00003"),
    ),
    "other count, other names": ("a 1 1\nb 2 1\n", IMAGES, RecordingError, ("times.txt", "2 frames", "3 images")),
    "one other image": (
        "00000 1 1\n00001 2 1\n00009 3 1\n",
        IMAGES,
        RecordingError,
        ("times.txt", "no image for 00009", "no line for 00002.png"),
    ),
    "files that are not there": ("a.png 1 1\nb.png 2 1\nc.png 3 1\n", IMAGES, RecordingError, ("a.png",)),
    "two ids of one image": ("0 1 1\n00 2 1\n1 3 1\n", IMAGES, RecordingError, ("times.txt", "00002.png")),
    "two images of one id": (
        "0 1 1\n",
        {"0.png": IMAGES["00000.png"], "0.jpg": b""},
        RecordingError,
        ("0.png", "0.jpg"),
    ),
    "no images": ("0 1 1\n", {}, RecordingError, ("images", "has no images")),
    "only other files": ("0 1 1\n", {"0.csv": b"no image", ".0.png": b""}, RecordingError, ("has no images",)),
    "no readable image": (
        "0 1 1\n1 2 1\n",
        {"0.png": b"", "1.png": b"no image"},
        RecordingError,
        ("none of its 2 images", "0.png: the file is empty"),
    ),
    "zero exposure": ("0 1 0\n", {"0.png": IMAGES["00000.png"]}, ExposureError, ("times.txt, line 1",)),
}


@pytest.mark.parametrize("case", BROKEN)
def test_parts_that_do_not_belong_together_are_one_clear_error(tum_folder: Make, case: str) -> None:
    times, images, error, parts = BROKEN[case]
    with pytest.raises(error) as caught:
        open_recording(tum_folder(times, images))
    assert all(part in str(caught.value) for part in parts), str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_times_are_requested(tum_folder: Make) -> None:
    with pytest.raises(RecordingError, match=r"made: has no list of exposures; add times\.txt with lines 'id stamp"):
        open_recording(tum_folder(None))


def test_a_list_in_the_folder_of_the_images_is_read_whichever_folder_is_given(tum_folder: Make) -> None:
    folder = tum_folder()
    (folder / "images" / "times.txt").write_text("0 0.5 2\n1 1.0 4\n2 1.5 8\n")
    for given in (folder, folder / "images"):
        assert open_recording(given).exposures_ms.tolist() == [2, 4, 8]


def test_the_kind_given_by_name_says_what_it_needs(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "times.txt").write_text("0 1 1\n")
    for place in (tmp_path / "file", tmp_path):
        with pytest.raises(RecordingError, match="has neither images/ nor"):
            open_recording(place, "tum_mono")


GOOD_JPEG = encoded(grey(9, (64, 48)), ".jpg")
UNREADABLE = {
    "empty": (b"", "the file is empty"),
    "text": (b"this is not an image", "its content is not PNG"),
    "truncated PNG": (IMAGES["00001.png"][:-20], "truncated"),
    "PNG without its end": (IMAGES["00001.png"][:-12], "truncated"),
    "damaged PNG": (IMAGES["00001.png"][:100] + b"\0\0\0\0" + IMAGES["00001.png"][104:], "checksum"),
    "truncated JPEG": (GOOD_JPEG[: len(GOOD_JPEG) // 2], "no end marker"),
    "JPEG without its end": (GOOD_JPEG[:-2], "no end marker"),
    "PNG of absurd size": (png_of_size(2**31 - 1, 2**31 - 1), "bytes allowed"),
    "PNG of size zero": (png_of_size(0, 16), "0×16 pixels"),
    "JPEG of absurd size": (jpeg_of_size(65535, 65535), "bytes allowed"),
    "PNG that lies about its size": (png_of_size(4000, 3000), "damaged and cannot be decoded"),
    "another size": (
        encoded(grey(1, (20, 10))),
        "but the first frame has 24×16; use only frames of one size",
    ),
    "another depth": (encoded(grey(1, dtype=np.uint16)), "does not have 8 bits"),
    "floats": (encoded(np.zeros((16, 24), np.float32), ".tif"), "has float32 values; .* --output grey16"),
}


# The first readable frame defines the recording's size and depth, so it cannot have others.
CASES = [(case, place) for case in UNREADABLE for place in (0, 1) if place or not case.startswith("another")]


@pytest.mark.parametrize(("case", "place"), CASES)
def test_one_unreadable_frame_stops_nothing(tum_folder: Make, case: str, place: int) -> None:
    data, message = UNREADABLE[case]
    names = list(IMAGES)
    frames = list(open_recording(tum_folder(images={**IMAGES, names[place]: data})))
    assert len(frames) == 3
    with pytest.raises(FrameError, match=message) as caught:
        _ = frames[place].image
    assert names[place] in str(caught.value)
    assert "; " in str(caught.value) or "pixels" in str(caught.value)
    for other in {0, 1, 2} - {place}:
        np.testing.assert_array_equal(frames[other].image, grey(other))


def test_an_image_that_vanishes_is_an_unreadable_frame(tum_folder: Make) -> None:
    place = tum_folder()
    recording = open_recording(place)
    (place / "images" / "00001.png").unlink()
    with pytest.raises(FrameError, match=r"00001\.png: cannot be read"):
        _ = list(recording)[1].image


def test_images_are_decoded_only_when_looked_at(tum_folder: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = open_recording(tum_folder())
    decoded: list[str] = []
    real = cv2.imdecode
    monkeypatch.setattr(cv2, "imdecode", lambda data, flags: (decoded.append(""), real(data, flags))[1])
    frames = list(recording)
    assert decoded == []
    _ = frames[2].image
    assert len(decoded) == 1


def test_a_real_bracketing_video(real_data: Path) -> None:
    recording = open_recording(real_data / "borealhdr_left")
    assert (len(recording), recording.size, recording.max_grey) == (60, (960, 600), 255)
    assert recording.exposures_ms[:6].tolist() == [2, 4, 8, 16, 32, 1]
    assert set(recording.exposures_ms) == {1, 2, 4, 8, 16, 32}
    assert next(iter(recording)).image.shape == (600, 960)
