"""Pictures before and after correction, and tracking in an excerpt."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import SIZE, before_a_wall, calibration, coverage

from ospc.errors import FrameError
from ospc.photometry.coverage import ExposureRatios
from ospc.photometry.response import Response
from ospc.recording.recording import ArrayRecording
from ospc.report.examples import Examples, examples_of

EXPOSURES_MS = np.geomspace(2, 10, 24)


def pair_of(first, second, ratio):
    return ExposureRatios(np.array([[first, second]]), np.array([ratio]), np.array([ratio]), np.array([300]))


def difference(pair):
    """Return the median difference of two pictures."""
    first, second = (image.astype(float) for image, _ in pair)
    return np.median(np.abs(first - second))


@pytest.mark.parametrize("max_grey", [255, 4095])
def test_frames_of_one_scene_look_the_same_only_after_correction(max_grey):
    recording = before_a_wall(EXPOSURES_MS, max_grey=max_grey)
    known = calibration(max_grey=max_grey, exposure_ratios=pair_of(0, 23, 0.2))
    (scene,) = examples_of(known, recording).pictures
    captions = [
        f"frame {frame}, {what}" for what in ("as recorded", "corrected") for frame in ("0, 2 ms", "23, 10 ms")
    ]
    assert [caption for _, caption in scene] == captions
    before, after = (difference(scene[:2]), difference(scene[2:]))
    assert before > 30
    assert after < 1.5
    assert {image.dtype for image, _ in scene} == {np.dtype(np.uint8)}


def test_with_a_wrong_calibration_corrected_frames_differ():
    recording = before_a_wall(EXPOSURES_MS)
    wrong = calibration(exposure_ratios=pair_of(0, 23, 0.2), response=Response.gamma(1.0), vignette=None)
    (scene,) = examples_of(wrong, recording).pictures
    assert difference(scene[2:]) > 10


def test_static_cameras_show_frames_with_very_different_exposures():
    known = calibration(coverage=coverage(still=True))
    (scene,) = examples_of(known, before_a_wall(EXPOSURES_MS)).pictures
    first_ms, second_ms = (float(caption.split()[2]) for _, caption in scene[:2])
    assert second_ms / first_ms > 2


def test_without_pairs_one_frame_is_shown():
    known = calibration(exposure_ratios=ExposureRatios.none())
    (scene,) = examples_of(known, before_a_wall(EXPOSURES_MS)).pictures
    assert [caption.split(", ")[-1] for _, caption in scene] == ["as recorded", "corrected"]


def test_points_are_tracked_where_the_exposure_changes_most():
    exposures_ms = np.concatenate([np.full(20, 5.0), np.geomspace(5, 10, 10), np.full(20, 10.0)])
    found = examples_of(calibration(), before_a_wall(exposures_ms))
    first, end = found.tracked
    assert end - first == 12
    assert (exposures_ms[first:end].min(), exposures_ms[first:end].max()) == pytest.approx((5.0, 10.0))
    assert found.tracking.frames == 12
    assert found.tracking.residual_ratio > 5


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"size": (32, 24)}, "the image size of the recording differs"),
        ({"response": None, "vignette": None}, "neither response nor vignette is known"),
    ],
)
def test_notes_state_what_cannot_be_shown(changes, reason):
    found = examples_of(calibration(**changes), before_a_wall(EXPOSURES_MS))
    assert found.pictures == ()
    assert found.tracking is None
    assert reason in found.notes[0]


def test_unreadable_or_textureless_frames_lose_only_their_own_examples():
    class Damaged(ArrayRecording):
        def __iter__(self):
            for frame in super().__iter__():
                if frame.index:
                    yield frame
                else:
                    raise FrameError("0000.png: torn")

    images = np.full((4, SIZE[1], SIZE[0]), 90, np.uint8)
    torn = examples_of(calibration(), Damaged(images, [1, 2, 3, 4]))
    assert [note.split(":")[0] for note in torn.notes] == ["no pictures", "no points were tracked"]
    even = examples_of(calibration(), ArrayRecording(images, [1, 2, 3, 4]))
    assert even.pictures
    assert even.notes[0].startswith("no points were tracked")


def test_examples_are_empty_by_default():
    assert Examples().pictures == ()
