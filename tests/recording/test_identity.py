"""The identity of a recording: equal for equal content, different for different content."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from image_samples import encoded, grey

from ospc.recording import ArrayRecording, Frame, identity, open_recording

Make = Callable[..., Path]


def test_it_is_json_and_says_what_the_recording_is(tum_folder: Make) -> None:
    found = json.loads(json.dumps(identity(open_recording(tum_folder()))))
    assert (found["kind"], found["name"], found["frames"]) == ("tum_mono", "made", 3)
    assert (found["size"], found["max_grey"], found["exposure_range_ms"]) == ([24, 16], 255, [1.5, 6])
    assert len(found["frames_sha256"]) == len(found["images_sha256"]) == 64


def test_it_moves_with_the_folder(tum_folder: Make, tmp_path: Path) -> None:
    place = tum_folder()
    moved = tmp_path / "elsewhere" / "made"
    shutil.copytree(place, moved)
    assert identity(open_recording(place)) == identity(open_recording(moved))


def test_another_exposure_is_another_recording(tum_folder: Make) -> None:
    place = tum_folder()
    before = identity(open_recording(place))
    (place / "times.txt").write_text((place / "times.txt").read_text().replace("3.0", "3.5"))
    after = identity(open_recording(place))
    assert before["frames_sha256"] != after["frames_sha256"]
    assert before["images_sha256"] == after["images_sha256"]


def test_other_images_are_another_recording(tum_folder: Make) -> None:
    place = tum_folder()
    before = identity(open_recording(place))
    (place / "images" / "00002.png").write_bytes(encoded(grey(7)))
    after = identity(open_recording(place))
    assert before["frames_sha256"] == after["frames_sha256"]
    assert before["images_sha256"] != after["images_sha256"]


def test_an_unreadable_image_does_not_prevent_it(tum_folder: Make) -> None:
    place = tum_folder()
    recording = open_recording(place)
    (place / "images" / "00002.png").unlink()
    assert identity(recording)["images_sha256"]


class Unstored:
    """A user's recording with only what the protocol requires."""

    path, kind, size, max_grey, notes = Path("mine"), "mine", (3, 2), 255, ()

    def __init__(self, frames: int, given: int) -> None:
        self.exposures_ms, self.stamps_s = np.ones(frames), np.arange(float(frames))
        self.given, self.passes = given, 0

    def __len__(self) -> int:
        return len(self.exposures_ms)

    def __iter__(self) -> Iterator[Frame]:
        self.passes += 1
        for index in range(self.given):
            yield Frame.of_array(np.full((2, 3), index, np.uint8), 1.0, index=index)


def test_a_recording_without_stored_images_is_read_once() -> None:
    mine = Unstored(100, given=100)
    assert identity(mine)["images_sha256"]
    assert mine.passes == 1


def test_a_recording_that_ends_early_has_an_identity_too() -> None:
    assert identity(Unstored(100, given=99))["images_sha256"] != identity(Unstored(100, given=100))["images_sha256"]


def test_few_images_of_many_are_looked_at() -> None:
    recording = ArrayRecording(np.zeros((100, 2, 2), np.uint8), np.ones(100))
    assert identity(recording)["images_hashed"] == [0, 24, 49, 74, 99]


def test_recordings_of_any_other_class_have_one_too() -> None:
    images = np.stack([grey(i) for i in range(9)])

    class Other:
        """A recording without stored bytes."""

        def __init__(self, inner: ArrayRecording) -> None:
            self._inner = inner

        def __getattr__(self, name: str) -> Any:
            if name == "stored_bytes":
                raise AttributeError(name)
            return getattr(self._inner, name)

        def __len__(self) -> int:
            return len(self._inner)

        def __iter__(self) -> Iterator[Frame]:
            return iter(self._inner)

    recording = ArrayRecording(images, np.ones(9))
    assert identity(Other(recording)) == identity(recording)
    images[4] += 1
    assert identity(Other(recording))["images_sha256"] == identity(recording)["images_sha256"]
