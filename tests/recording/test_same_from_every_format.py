"""One recording in every format: each gives the same frames, and therefore the same calibration."""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from bag_samples import (
    FLIR,
    REALSENSE,
    START_NS,
    STEP_NS,
    Sent,
    floats,
    header,
    images,
    metadata,
    write_bag1,
    write_bag2,
    write_mcap1,
    write_mcap2,
)
from image_samples import encoded

from exif_segments import exif
from ospc.arrays import Image
from ospc.recording import Recording, open_recording
from ospc.recording.exposure_units import ExposureUnit
from ospc.recording.options import ReadingOptions

SIZE = (160, 120)


@dataclass(frozen=True)
class Filmed:
    """The content to write: images that survive JPEG compression, because photographs are JPEGs."""

    jpegs: list[bytes]
    images: list[Image]
    ms: list[float]

    @property
    def stamps_ns(self) -> list[int]:
        return [START_NS + i * STEP_NS for i in range(len(self.ms))]


@cache
def filmed(frames: int) -> Filmed:
    """Return frames that cycle through eight images and four exposures."""
    noise = np.random.default_rng(0).integers(0, 255, (8, 6, 8), np.uint8)
    jpegs = [encoded(cv2.resize(part, SIZE), ".jpg") for part in noise]
    decoded = [cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE) for jpeg in jpegs]
    number = range(frames)
    return Filmed(
        [jpegs[i % 8] for i in number], [decoded[i % 8] for i in number], [3.0 * 2 ** (i % 4) for i in number]
    )


def _put_images(folder: Path, filmed: Filmed, names: list[str] | None = None) -> None:
    folder.mkdir(parents=True)
    for i, image in enumerate(filmed.images):
        (folder / (f"{i:05d}.png" if names is None else names[i])).write_bytes(encoded(image))


def _times(filmed: Filmed) -> str:
    return "".join(f"{i} {i / 20} {ms!r}\n" for i, ms in enumerate(filmed.ms))


def tum_mono(place: Path, filmed: Filmed) -> Path:
    _put_images(place / "images", filmed)
    (place / "times.txt").write_text(_times(filmed))
    return place


def tum_mono_zip(place: Path, filmed: Filmed) -> Path:
    place.mkdir()
    with zipfile.ZipFile(place / "images.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for i, image in enumerate(filmed.images):
            archive.writestr(f"{i:05d}.png", encoded(image))
    (place / "times.txt").write_text(_times(filmed))
    return place


def tum_vi(place: Path, filmed: Filmed) -> Path:
    _put_images(place / "mav0" / "cam0" / "data", filmed, [f"{ns}.png" for ns in filmed.stamps_ns])
    rows = "".join(f"{ns},{ns}.png\n" for ns in filmed.stamps_ns)
    (place / "mav0" / "cam0" / "data.csv").write_text("#timestamp [ns],filename\n" + rows)
    (place / "dso" / "cam0").mkdir(parents=True)
    lines = "".join(f"{ns} {ns / 1e9:.6f} {ms!r}\n" for ns, ms in zip(filmed.stamps_ns, filmed.ms, strict=True))
    (place / "dso" / "cam0" / "times.txt").write_text(
        "# filename          timestamp[s]         [exposuretime[ms]]\n" + lines
    )
    return place


def euroc(place: Path, filmed: Filmed) -> Path:
    _put_images(place / "mav0" / "cam0" / "data", filmed, [f"{ns}.png" for ns in filmed.stamps_ns])
    rows = "".join(f"{ns},{ns}.png\n" for ns in filmed.stamps_ns)
    (place / "mav0" / "cam0" / "data.csv").write_text("#timestamp [ns],filename\n" + rows)
    rows = "".join(f"{ns},{ms / 1e3!r}\n" for ns, ms in zip(filmed.stamps_ns, filmed.ms, strict=True))
    (place / "mav0" / "cam0" / "exposures.csv").write_text("timestamp_ns,exposure_s\n" + rows)
    return place


def image_folder(place: Path, filmed: Filmed) -> Path:
    """Write each exposure as half its time in µs, with a gain of 2 in dB."""
    _put_images(place, filmed)
    rows = "".join(f"{i:05d}.png,{i * 0.05},{ms * 500!r},{20 * math.log10(2)!r}\n" for i, ms in enumerate(filmed.ms))
    (place / "exposures.csv").write_text("file,timestamp_s,exposure_us,gain_db\n" + rows)
    return place


def deep_images(place: Path, filmed: Filmed) -> Path:
    """Write 16-bit images with left-aligned grey values."""
    place.mkdir()
    for i, image in enumerate(filmed.images):
        (place / f"{i}.png").write_bytes(encoded(image.astype(np.uint16) << 8))
    (place / "times.txt").write_text(_times(filmed))
    return place


def colour_images(place: Path, filmed: Filmed) -> Path:
    place.mkdir()
    for i, image in enumerate(filmed.images):
        (place / f"{i}.png").write_bytes(encoded(np.stack([image] * 3, axis=2)))
    (place / "times.txt").write_text(_times(filmed))
    return place


def exposure_folders(place: Path, filmed: Filmed) -> Path:
    for ms, image, stamp in zip(filmed.ms, filmed.images, filmed.stamps_ns, strict=True):
        (place / str(ms)).mkdir(parents=True, exist_ok=True)
        (place / str(ms) / f"{stamp}.png").write_bytes(encoded(image))
    return place


def photographs(place: Path, filmed: Filmed) -> Path:
    """Write each exposure as a quarter of its time, at ISO 400."""
    place.mkdir()
    for i, (jpeg, ms) in enumerate(zip(filmed.jpegs, filmed.ms, strict=True)):
        taken = f"2020:01:02 03:{i // 60:02d}:{i % 60:02d}"
        segment = exif(time=(round(ms * 250), 10**6), f_number=(1, 1), iso=400, taken=taken)
        (place / f"IMG_{i:04d}.JPG").write_bytes(jpeg[:2] + segment + jpeg[2:])
    return place


def video(place: Path, filmed: Filmed) -> Path:
    place.mkdir()
    code = cv2.VideoWriter.fourcc(*"FFV1")
    path = place / "walk.mkv"
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, code, 20.0, SIZE, [cv2.VIDEOWRITER_PROP_IS_COLOR, 0])
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no lossless video")
    for image in filmed.images:
        writer.write(image)
    writer.release()
    (place / "walk.csv").write_text("exposure_100us\n" + "".join(f"{10 * ms!r}\n" for ms in filmed.ms))
    return path


def _with_numbers(filmed: Filmed) -> list[Sent]:
    return images(filmed.images) + floats(filmed.ms)


def bag1(place: Path, filmed: Filmed) -> Path:
    sent = metadata([{"exposure_time": int(ms * 1000), "gain": 0.0} for ms in filmed.ms], FLIR, "/cam/meta")
    return write_bag1(place, images(filmed.images) + sent, "BZ2")


def bag2(place: Path, filmed: Filmed) -> Path:
    said = [{"json_data": json.dumps({"actual_exposure": ms * 500, "gain_level": 32})} for ms in filmed.ms]
    return write_bag2(place, images(filmed.images) + metadata(said, REALSENSE, "/cam/metadata"))


def bag2_mcap(place: Path, filmed: Filmed) -> Path:
    return write_bag2(place, _with_numbers(filmed), "MCAP")


def compressed_images(place: Path, filmed: Filmed) -> Path:
    sent = [
        Sent(
            "/cam/compressed",
            "sensor_msgs/msg/CompressedImage",
            {"header": header(ns), "format": "jpeg", "data": np.frombuffer(jpeg, np.uint8)},
            ns,
        )
        for ns, jpeg in zip(filmed.stamps_ns, filmed.jpegs, strict=True)
    ]
    return write_mcap2(place, sent + floats([ms / 1e3 for ms in filmed.ms]))


FORMATS: dict[str, Callable[[Path, Filmed], Path]] = {
    "TUM mono": tum_mono,
    "TUM mono, zip": tum_mono_zip,
    "TUM-VI": tum_vi,
    "EuRoC, s": euroc,
    "images with CSV, µs and dB": image_folder,
    "16 bit, left-aligned": deep_images,
    "grey as colour": colour_images,
    "folders named by exposure": exposure_folders,
    "photographs with EXIF, ISO 400": photographs,
    "video with CSV, 100 µs": video,
    "ROS 1 bag, FLIR": bag1,
    "ROS 2 bag, sqlite3, RealSense": bag2,
    "ROS 2 bag, mcap by rosbags": bag2_mcap,
    "ROS 2 bag, mcap by mcap": lambda place, filmed: write_mcap2(place, _with_numbers(filmed)),
    "ROS 1 bag in mcap": lambda place, filmed: write_mcap1(place, _with_numbers(filmed)),
    "ROS 2 bag, JPEG and s": compressed_images,
}


@pytest.mark.parametrize("name", FORMATS)
def test_frames_and_exposures_are_the_same(name: str, tmp_path: Path) -> None:
    assert_same(open_recording(FORMATS[name](tmp_path / "made", filmed(16))))


def test_a_field_and_unit_named_by_the_user(tmp_path: Path) -> None:
    values = [{"brightness": int(ms * 10)} for ms in filmed(16).ms]
    path = write_bag2(tmp_path / "made", images(filmed(16).images) + metadata(values, FLIR, "/odd"), "MCAP")
    options = ReadingOptions(
        exposure_topic="/odd",
        exposure_field="brightness",
        exposure_unit=ExposureUnit.US100,
        image_topic="/cam/image_raw",
    )
    assert_same(open_recording(path, options=options))


def assert_same(recording: Recording) -> None:
    """Assert that a recording has the filmed images and exposures."""
    expected = filmed(16)
    read = list(recording)
    assert [frame.index for frame in read] == list(range(16))
    np.testing.assert_array_equal([frame.image for frame in read], expected.images)
    for exposures_ms in (recording.exposures_ms, [frame.exposure_ms for frame in read]):
        np.testing.assert_allclose(exposures_ms, expected.ms, rtol=1e-9)
    assert np.all(np.diff(recording.stamps_s) > 0)
    assert {recording.max_grey, *(frame.max_grey for frame in read)} == {255}
