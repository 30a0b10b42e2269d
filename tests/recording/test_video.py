"""Videos with a list of exposures."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from image_samples import grey

from ospc.errors import ExposureError, FrameError, OspcError, RecordingError
from ospc.recording import cameras_of, identity, open_recording
from ospc.recording import video as video_module
from ospc.recording.channel import Channel
from ospc.recording.options import ReadingOptions
from ospc.recording.video import VideoStream, count_frames

LIST = "timestamp_s,exposure_ms\n" + "".join(f"{i / 10},{i + 1}\n" for i in range(6))
SIZE = (64, 48)


def write_video(path: Path, frames: int = 6) -> None:
    """Write a lossless video of noise."""
    code = cv2.VideoWriter.fourcc(*"FFV1")
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, code, 25.0, SIZE, [cv2.VIDEOWRITER_PROP_IS_COLOR, 0])
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no lossless video")
    for i in range(frames):
        writer.write(grey(i, SIZE))
    writer.release()


@pytest.fixture
def video(tmp_path: Path) -> Callable[..., Path]:
    """Make a video with the given text files next to it."""

    def make(files: dict[str, str] | None = None, name: str = "walk.mkv", frames: int = 6) -> Path:
        write_video(tmp_path / name, frames)
        for other, text in (files if files is not None else {"walk.csv": LIST}).items():
            (tmp_path / other).write_text(text)
        return tmp_path / name

    return make


@pytest.mark.parametrize("name", ["walk.mkv", "walk.avi"])
@pytest.mark.parametrize("beside", ["walk.csv", "exposures.csv", "times.txt"])
def test_frames_are_those_that_were_written(video: Callable[..., Path], name: str, beside: str) -> None:
    recording = open_recording(video({beside: LIST}, name))
    assert (recording.kind, recording.size, recording.max_grey, len(recording)) == ("video", SIZE, 255, 6)
    assert recording.exposures_ms.tolist() == [1, 2, 3, 4, 5, 6]
    assert recording.stamps_s == pytest.approx(np.arange(6) / 10)
    for index, frame in enumerate(recording):
        assert frame.name == f"{name}[{index}]"
        np.testing.assert_array_equal(frame.image, grey(index, SIZE))


def test_frames_may_be_read_in_any_order_and_only_some(video: Callable[..., Path]) -> None:
    frames = list(open_recording(video()))
    for index in (4, 1, 5, 0):
        np.testing.assert_array_equal(frames[index].image, grey(index, SIZE))


def test_frames_are_decoded_only_when_looked_at(video: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    recording = open_recording(video())
    read: list[int] = []
    real = VideoStream.read
    monkeypatch.setattr(VideoStream, "read", lambda self, index: (read.append(index), real(self, index))[1])
    frames = list(recording)
    assert read == []
    _ = frames[3].image
    assert read == [3]


def test_iterating_twice_at_once_gives_the_same(video: Callable[..., Path]) -> None:
    recording = open_recording(video())
    for one, other in zip(recording, recording, strict=True):
        np.testing.assert_array_equal(one.image, other.image)


def test_without_time_stamps_the_frame_rate_gives_them(video: Callable[..., Path]) -> None:
    recording = open_recording(video({"walk.csv": "exposure_us\n" + "100\n" * 6}))
    assert recording.stamps_s == pytest.approx(np.arange(6) / 25)
    assert recording.exposures_ms == pytest.approx(0.1)
    assert any("frame rate of 25" in note for note in recording.notes)


def test_the_only_list_may_have_any_name_but_that_of_another_file(video: Callable[..., Path]) -> None:
    path = video({"log.csv": LIST, "log.txt": "rainy", "imu.csv": "stamp,ax\n1,2\n"})
    assert open_recording(path).exposures_ms.tolist() == [1, 2, 3, 4, 5, 6]
    (path.parent / "log.mkv").touch()
    with pytest.raises(
        ExposureError, match=r"walk\.mkv: has no list of exposures \(not used: imu\.csv, log\.csv, log\.txt; "
    ):
        open_recording(path)


@pytest.mark.parametrize("column", ["frame", "frame_number", "id", "Frame Index"])
@pytest.mark.parametrize("stamp", ["", "time_s"])
@pytest.mark.parametrize("first", [0, 1])
def test_rows_belong_to_the_frames_with_their_numbers(
    video: Callable[..., Path], column: str, stamp: str, first: int
) -> None:
    rows = [f"{i + first},{i / 10 if stamp else 'x'},{i + 1}\n" for i in (4, 1, 5, 0, 2, 3)]
    recording = open_recording(video({"walk.csv": f"{column},{stamp or 'other'},exposure_ms\n" + "".join(rows)}))
    assert recording.exposures_ms.tolist() == [1, 2, 3, 4, 5, 6]
    assert not any("matched" in note for note in recording.notes)


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        (
            (0, 1, 2, 4, 5, 6),
            "lists other frames than .* has; no line for frame 3, counted from 0; no frame 6",
        ),
        ((1, 2, 3, 4, 5, 7), "lists other frames than .*; no line for frame 6, counted from 1; no frame 7; "),
        ((0, 1, 2, 4, 5), "lists 5 frames but .*walk.mkv has 6; no line for frame 3, counted from 0; there must be"),
        ((2, 3, 4, 5, 6), "lists 5 frames but .*walk.mkv has 6; no line for frame 1, counted from 1"),
        ((0, 1, 2, 3, 4, 5, 6), "lists 7 frames but .*walk.mkv has 6; no frame 6; "),
    ],
)
def test_numbers_that_are_missing_or_too_many_are_named(
    video: Callable[..., Path], numbers: tuple[int, ...], said: str
) -> None:
    text = "frame,exposure_ms\n" + "".join(f"{number},{number + 1}\n" for number in numbers)
    with pytest.raises(RecordingError, match=said):
        open_recording(video({"walk.csv": text}))


@pytest.mark.parametrize("ids", [range(100, 106), range(0, 300, 50), [f"walk_{i}.png" for i in range(6)]])
def test_ids_that_do_not_count_the_frames_are_matched_by_order_with_a_note(
    video: Callable[..., Path], ids: Sequence[object]
) -> None:
    text = "id,exposure_ms\n" + "".join(f"{name},{i + 1}\n" for i, name in enumerate(ids))
    recording = open_recording(video({"walk.csv": text}))
    assert recording.exposures_ms.tolist() == [1, 2, 3, 4, 5, 6]
    assert any("frames are matched by order" in note for note in recording.notes)


BROKEN: dict[str, tuple[dict[str, str], type[OspcError], tuple[str, ...]]] = {
    "no list": ({}, ExposureError, ("walk.mkv", "walk.csv", "has no list of exposures")),
    "two lists": ({"walk.csv": LIST, "walk.txt": LIST}, ExposureError, ("walk.csv, walk.txt", "keep only the")),
    "too few": ({"walk.csv": LIST.rsplit("\n", 2)[0]}, RecordingError, ("walk.csv", "5 frames", "walk.mkv has 6")),
    "too many": ({"walk.csv": LIST + "9,9\n"}, RecordingError, ("walk.csv", "7 frames", "walk.mkv has 6")),
    "zero": ({"walk.csv": LIST.replace(",3", ",0")}, ExposureError, ("walk.csv, line 4",)),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_list_that_does_not_belong_to_the_video_is_one_error(video: Callable[..., Path], case: str) -> None:
    files, error, parts = BROKEN[case]
    with pytest.raises(error) as caught:
        open_recording(video(files))
    assert all(part in str(caught.value) for part in parts), str(caught.value)


def test_a_wrong_count_stated_by_the_container_does_not_matter(
    video: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = video()
    monkeypatch.setattr(VideoStream, "stated_frames", 1000)
    assert count_frames(path) == 6
    assert len(open_recording(path)) == 6


def test_frames_are_counted_only_where_no_list_gives_their_exposures(
    video: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    counted: list[Path] = []
    monkeypatch.setattr(VideoStream, "stated_frames", 6)
    monkeypatch.setattr(video_module, "count_frames", lambda path: counted.append(path) or 6)
    path, options = video(), ReadingOptions(unknown_exposures=True)
    assert open_recording(path, options=options).exposures_ms.tolist() == [1, 2, 3, 4, 5, 6]
    assert counted == []
    path.with_suffix(".csv").unlink()
    assert open_recording(path, options=options).exposures_ms.tolist() == [1] * 6
    assert counted == [path]


def test_frames_missing_at_the_end_are_unreadable(
    video: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(VideoStream, "stated_frames", 6)
    frames = list(open_recording(video(frames=4)))
    np.testing.assert_array_equal(frames[3].image, grey(3, SIZE))
    for index in (4, 5):
        with pytest.raises(FrameError, match=rf"walk\.mkv\[{index}\]"):
            _ = frames[index].image


@pytest.mark.parametrize("damaged", [0, 2])
def test_a_damaged_frame_fails_alone_and_the_next_ones_keep_their_numbers(damaged: int, tmp_path: Path) -> None:
    path = tmp_path / "walk.avi"
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"MJPG"), 25.0, SIZE)
    for i in range(6):
        writer.write(np.full((*SIZE[::-1], 3), 40 * i, np.uint8))
    writer.release()
    content = path.read_bytes()
    begin, end = [found.start() for found in re.finditer(b"\xff\xd8\xff", content)][damaged : damaged + 2]
    end -= 16  # the header of the next chunk, and a byte of padding
    path.write_bytes(content[:begin] + bytes(end - begin) + content[end:])
    path.with_suffix(".csv").write_text(LIST)
    assert count_frames(path) == 6
    frames = list(open_recording(path))
    for index in {*range(6)} - {damaged}:
        assert np.abs(frames[index].image - 40.0 * index).max() < 4, index
    with pytest.raises(FrameError, match=rf"walk\.avi\[{damaged}\]: the frame is damaged"):
        _ = frames[damaged].image
    assert np.abs(list(open_recording(path))[4].image - 160.0).max() < 4


@pytest.mark.parametrize("kind", [None, "video"])
@pytest.mark.parametrize("beside", ["walk.csv", "exposures.csv"])
def test_a_folder_stands_for_its_only_video(video: Callable[..., Path], beside: str, kind: str | None) -> None:
    path = video({beside: LIST, "notes.txt": "rainy"})
    (path.parent / "plots").mkdir()
    recording = open_recording(path.parent, kind)
    assert (recording.kind, recording.path) == ("video", path)
    assert recording.exposures_ms.tolist() == [1, 2, 3, 4, 5, 6]
    assert cameras_of(path.parent, kind) == {"walk": (path, ReadingOptions())}


def test_for_a_folder_with_several_recordings_the_message_names_them(video: Callable[..., Path]) -> None:
    path = video()
    (path.parent / "run.mkv").write_bytes(path.read_bytes())
    for kind, said in ((None, r"give one of them: run\.mkv, walk\.mkv"), ("video", "is not an MP4")):
        with pytest.raises(RecordingError, match=said):
            open_recording(path.parent, kind)
    (path.parent / "run.mkv").unlink()
    (path.parent / "photos" / "images").mkdir(parents=True)
    with pytest.raises(RecordingError, match=r"give one of them: walk\.mkv"):
        open_recording(path.parent)


def test_a_folder_with_many_files_does_not_stand_for_a_video(video: Callable[..., Path]) -> None:
    path = video()
    for number in range(100):
        (path.parent / f"x{number}.dat").touch()
    with pytest.raises(RecordingError, match=r"give one of them: walk\.mkv"):
        open_recording(path.parent)


def test_a_folder_that_cannot_be_listed_is_an_error(
    video: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_folder: Path) -> None:
        raise PermissionError(13, "Permission denied")

    path = video({})
    monkeypatch.setattr(Path, "iterdir", refuse)
    with pytest.raises(RecordingError, match=r"walk\.mkv: cannot be read \(Permission denied\); check the path"):
        open_recording(path)


def test_a_file_that_only_begins_like_a_video_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "walk.avi").write_bytes(b"RIFF\0\0\0\0AVI " + bytes(100))
    (tmp_path / "walk.csv").write_text(LIST)
    with pytest.raises(RecordingError, match=r"walk\.avi: the video is damaged or its codec is unknown"):
        open_recording(tmp_path / "walk.avi")


def test_a_playlist_is_no_video_whatever_its_name(tmp_path: Path) -> None:
    (tmp_path / "walk.mp4").write_text("#EXTM3U\n/etc/passwd\n")
    (tmp_path / "walk.csv").write_text(LIST)
    with pytest.raises(RecordingError, match="is not what its name says"):
        open_recording(tmp_path / "walk.mp4")
    with pytest.raises(RecordingError, match="is not an MP4"):
        open_recording(tmp_path / "walk.mp4", "video")


def test_large_frames_are_refused_before_they_are_decoded(
    video: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ospc.recording.frame.MAX_DECODED_BYTES", 1000)
    with pytest.raises(RecordingError, match="64×48 pixels, which need more"):
        open_recording(video())


def test_its_identity_follows_the_file(video: Callable[..., Path], tmp_path: Path) -> None:
    path = video()
    before = identity(open_recording(path))
    assert before == identity(open_recording(path))
    data = bytearray(path.read_bytes())
    data[-200] ^= 1
    (tmp_path / "walk.mkv").write_bytes(data)
    assert identity(open_recording(path))["images_sha256"] != before["images_sha256"]


def test_colours_can_be_kept(tmp_path: Path) -> None:
    writer = cv2.VideoWriter(str(tmp_path / "walk.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, SIZE)
    for _ in range(3):
        writer.write(np.full((SIZE[1], SIZE[0], 3), (20, 120, 220), np.uint8))
    writer.release()
    options = ReadingOptions(channel=Channel.ALL, unknown_exposures=True)
    for frame in open_recording(tmp_path / "walk.avi", options=options):
        assert frame.image.shape == (SIZE[1], SIZE[0], 3)
        np.testing.assert_allclose(frame.image.mean(axis=(0, 1)), (20, 120, 220), atol=6)


@pytest.mark.parametrize(
    ("name", "codec", "inter_coded"),
    [("walk.avi", "MJPG", False), ("walk.mkv", "FFV1", False), ("walk.mp4", "mp4v", True)],
)
def test_frames_know_whether_they_are_coded_as_changes(
    tmp_path: Path, name: str, codec: str, inter_coded: bool
) -> None:
    writer = cv2.VideoWriter(
        str(tmp_path / name),
        cv2.CAP_FFMPEG,
        cv2.VideoWriter.fourcc(*codec),
        25.0,
        SIZE,
        [cv2.VIDEOWRITER_PROP_IS_COLOR, 0],
    )
    if not writer.isOpened():
        pytest.skip(f"this OpenCV writes no {codec}")
    for i in range(6):
        writer.write(np.full(SIZE[::-1], 100 + i, np.uint8))
    writer.release()
    (tmp_path / "walk.csv").write_text(LIST)
    assert {frame.inter_coded for frame in open_recording(tmp_path / name)} == {inter_coded}
