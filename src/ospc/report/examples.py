"""The effect of a calibration on its own recording: pictures before and after, and points tracked in an excerpt."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np

from ospc.arrays import FloatArray, Image
from ospc.errors import OspcError, plain
from ospc.evaluation.tracking import TrackingComparison, compare_tracking
from ospc.exposures.table import filled
from ospc.exposures.used import check_exposures_fit, with_used_exposures
from ospc.photometry.calibration import Calibration
from ospc.photometry.correction import Corrector
from ospc.photometry.coverage import Coverage, ExposureRatios
from ospc.recording import Frame, Recording
from ospc.recording.derived import DerivedRecording, with_sensor_depth
from ospc.report.evidence import FEW_SAMPLES

_TRACKED_FRAMES = 12
"""Frames of the excerpt in which points are tracked: enough to show the effect, and quick to compute."""
_PICTURES = 2
"""Scenes to show."""
_WIDTH_PX = 480
"""Width of the pictures, in pixels."""
_STREAMS = ("video", "rosbag")
_STREAM_FRAMES = 300
"""Frames considered in a recording that can only be read from its beginning."""

_STATIONARY_SHARE = 0.98
"""Share of observations within one class of radius above which the camera is considered static."""

Pictures: TypeAlias = tuple[tuple[Image, str], ...]
"""Frames of one scene with captions: first as recorded, then without vignette at their longest exposure.

Images are 8 bit, reduced to the width of a page.
"""


@dataclass(frozen=True)
class Examples:
    """Scenes at different exposures, and the result of tracking points in an excerpt.

    ``tracked`` is the first frame of the excerpt and the frame after its last; ``notes`` state what could not be
    shown.
    """

    pictures: tuple[Pictures, ...] = ()
    tracking: TrackingComparison | None = None
    tracked: tuple[int, int] = (0, 0)
    notes: tuple[str, ...] = ()


NOTHING_TRIED = Examples()
"""Examples without a recording."""


def examples_of(calibration: Calibration, recording: Recording, about: str = "") -> Examples:
    """Apply a calibration to a recording of its camera; an unknown response or vignette is treated as the identity.

    Points are tracked in the frames with the largest changes of exposure. ``about`` is a note on the recording.
    """
    if calibration.size != recording.size:
        return Examples(notes=("no pictures: the image size of the recording differs from that of the calibration",))
    if calibration.response is None and calibration.vignette is None:
        return Examples(notes=("no pictures: neither response nor vignette is known",))
    recording = with_sensor_depth(recording, calibration.max_grey)
    try:
        check_exposures_fit(recording, calibration)
    except OspcError as error:
        return Examples(notes=(f"no pictures: {error}",))
    recording = with_used_exposures(recording, calibration)
    corrector = Corrector(calibration.response, calibration.vignette, recording.max_grey, assume_missing=True)
    frames = min(len(recording), _STREAM_FRAMES if recording.kind in _STREAMS else len(recording))
    notes = [about] if about else []
    pictures: tuple[Pictures, ...] = ()
    try:
        if _is_stationary(calibration.coverage):
            scenes = _far_exposures(recording.exposures_ms[:frames])
        else:
            scenes = _chosen_pairs(calibration.exposure_ratios, frames)
        exposure = "exposure {}" if calibration.exponent_sigma else "{} ms"
        pictures = _pictures(corrector, recording, scenes, exposure)
    except OspcError as error:
        notes.append(f"no pictures: {error}")
    excerpt = _where_exposure_changes(recording, frames)
    tracking = None
    try:
        tracking = compare_tracking(excerpt, corrector)
    except OspcError as error:
        notes.append(f"no points were tracked: {error}")
    first = int(excerpt.frames[0])
    return Examples(pictures, tracking, (first, first + len(excerpt)), tuple(notes))


def _where_exposure_changes(recording: Recording, most: int) -> DerivedRecording:
    """Return the successive frames with the largest range of exposures; the first ones if several are equal."""
    count = min(_TRACKED_FRAMES, most)
    log_exposure = filled(np.log(np.maximum(recording.exposures_ms[:most], 1e-12)))
    pieces = np.lib.stride_tricks.sliding_window_view(log_exposure, count)
    frames = int(np.argmax(np.ptp(pieces, axis=1).round(3))) + np.arange(count)
    return DerivedRecording.of(recording, frames, recording.exposures_ms[frames], note="some frames only")


def _chosen_pairs(ratios: ExposureRatios, frames: int) -> list[tuple[int, ...]]:
    """Return the pairs with the largest exposure ratios among those with a large overlap."""
    inside = np.all(ratios.frames < frames, axis=1)
    shared = ratios.samples >= max(FEW_SAMPLES, 0.5 * float(ratios.samples.max(initial=0)))
    chosen: list[tuple[int, ...]] = []
    for pair in np.argsort(-np.abs(np.log(ratios.metadata)), kind="stable"):
        first, second = (int(frame) for frame in ratios.frames[pair])
        far = all(min(abs(first - a), abs(second - b)) > frames // 10 for a, b in chosen)
        if inside[pair] and shared[pair] and far:
            chosen.append((first, second))
        if len(chosen) == _PICTURES:
            break
    return chosen or [(frames // 2,)]


def _is_stationary(coverage: Coverage | None) -> bool:
    moves = None if coverage is None else coverage.radius_radius
    return moves is not None and bool(moves.any()) and float(np.trace(moves) / moves.sum()) > _STATIONARY_SHARE


def _far_exposures(exposures_ms: FloatArray) -> list[tuple[int, ...]]:
    """Return the frames with exposures at the lower and upper fifth of all known exposures."""
    order = np.argsort(exposures_ms, kind="stable")[: np.count_nonzero(np.isfinite(exposures_ms))]
    return [(int(order[len(order) // 5]), int(order[-1 - len(order) // 5]))]


def _pictures(
    corrector: Corrector, recording: Recording, scenes: list[tuple[int, ...]], exposure: str
) -> tuple[Pictures, ...]:
    wanted = {index for scene in scenes for index in scene}
    frames: dict[int, Frame] = {}
    for frame in recording:
        if frame.index in wanted:
            _ = frame.image  # load it now: a video cannot seek back later
            frames[frame.index] = frame
        if len(frames) == len(wanted):
            break
    return tuple(
        _of_scene(corrector, [frames[index] for index in dict.fromkeys(scene)], exposure)
        for scene in scenes
        if frames.keys() >= set(scene)
    )


def _of_scene(corrector: Corrector, frames: list[Frame], exposure: str) -> Pictures:
    longest_ms = max(frame.exposure_ms for frame in frames)
    recorded = [("as recorded", frame, frame.image_8_bit) for frame in frames]
    corrected = [("corrected", frame, corrected_picture(corrector, frame, longest_ms)) for frame in frames]
    return tuple(
        (_reduced(image), f"frame {frame.index}, {exposure.format(plain(frame.exposure_ms))}, {what}")
        for what, frame, image in recorded + corrected
    )


def corrected_picture(corrector: Corrector, frame: Frame, exposure_ms: float) -> Image:
    """Return what the camera would have recorded without vignette at another exposure, in 8 bit."""
    return corrector.without_vignette(frame.image, frame.exposure_ms, white=1 / exposure_ms, mark_saturated=False)


def _reduced(image: Image) -> Image:
    height, width = image.shape
    scale = min(1.0, _WIDTH_PX / width)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    reduced: Image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return reduced
