"""A built-in direct odometry: alignment to keyframes with known depth.

It is much simpler than DSO, which has to estimate depth. Like DSO it assumes constant brightness, and therefore shows
the value of a calibration. Depth comes from the simulated scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from ospc.arrays import BoolArray, Float32Array, FloatArray
from ospc.errors import OspcError, RecordingError, message_of
from ospc.evaluation.trajectory import Trajectory, read_trajectory
from ospc.formats.files import json_object
from ospc.photometry.correction import Corrector
from ospc.recording import Frame, open_recording
from ospc.research.odometry.alignment import LEVELS, Brightness, Camera, align, pose_of
from ospc.research.odometry.experiment import Tracked
from ospc.research.odometry.inputs import TRUTH, OdometryInput
from ospc.research.runner import made_with
from ospc.simulation.scene import Scene
from ospc.simulation.settings import SimulationSettings
from ospc.simulation.surface import Rectangle

_TRUTH = "truth.json"
_NEAR_M = 0.02
"""Surfaces closer to the camera than this are ignored."""


@dataclass(frozen=True)
class SceneDepth:
    """The static surfaces of a scene, which the rays of a camera intersect."""

    camera: Camera
    places: tuple[Rectangle, ...]

    @classmethod
    def of(cls, folder: Path) -> SceneDepth:
        """Build the scene of a simulated recording."""
        try:
            content = json_object(folder / _TRUTH)
            settings = content["settings"]
            scene_seed = settings["seed"] if settings["scene_seed"] is None else settings["scene_seed"]
            width, height = (int(n) for n in settings["size"])
            focal = float(content["focal_px"])
            scene = Scene.of(SimulationSettings(scene_seed=int(scene_seed), size=(width, height)))
        except (OspcError, ValueError, KeyError, TypeError) as error:
            raise RecordingError(
                f"{folder}: the built-in odometry needs the depth of a simulated scene, which {_TRUTH} does not "
                f"describe ({message_of(error)}); make the recording with 'ospc simulate', or use --program"
            ) from None
        faces = (*scene.walls, *scene.pictures, *(face for solid in scene.solids for face in solid.faces))
        centre_px = (np.array((width, height)) - 1) / 2
        return cls(Camera(focal, centre_px), tuple(face.place for face in faces))

    def at(self, points: FloatArray, pose: FloatArray) -> FloatArray:
        """Return the depth of pixels (x, y) along the optical axis in metres, shape (n, 2) -> (n,).

        The pose, shape (4, 4), maps camera coordinates to the world.
        """
        rays, position = self.camera.lift(points, np.ones(len(points))) @ pose[:3, :3].T, pose[:3, 3]
        nearest = np.full(len(points), np.inf)
        for place in self.places:
            with np.errstate(divide="ignore", invalid="ignore"):
                depth = float((place.corner_m - position) @ place.normal) / (rays @ place.normal)
                on_plane = position + depth[:, None] * rays - place.corner_m
                across, down = on_plane @ place.across, on_plane @ place.down
                hit = (depth > _NEAR_M) & (across >= 0) & (down >= 0)
                hit &= (across <= place.size_m[0]) & (down <= place.size_m[1])
            nearest = np.where(hit & (depth < nearest), depth, nearest)
        return nearest


_CELLS_ACROSS = 40
"""Cells across the image; the pixel with the largest gradient of each cell is tracked."""
_FARTHEST_MOVE, _MOST_FRAMES = 0.08, 25
"""Median displacement of the points, in image widths, and number of frames, at which a new keyframe is set."""
_LEAST_AGREEING, _LOST = 0.6, 0.15
"""Share of inliers below which a new keyframe is set, and below which tracking is lost."""
_SATURATED = 0.985
"""Grey level, relative to full scale, that counts as saturated."""


@dataclass(frozen=True)
class DirectOdometry:
    """Direct alignment with depth from the simulated scene."""

    def describe(self) -> dict[str, Any]:
        """Return versions and source hash."""
        return {"builtin": made_with()}

    def track(self, source: OdometryInput, run: int) -> Tracked:
        """Track once; the run number is the seed for selecting points."""
        began = monotonic()
        try:
            recording = open_recording(source.place)
            tracker = _Tracker(source, run, recording.max_grey)
            finished = all(tracker.push(frame) for frame in recording)
        except OspcError as error:
            return Tracked(None, str(error), seconds=monotonic() - began)
        failure = "" if finished else "too few points agree on a motion"
        return Tracked(tracker.trajectory, failure, seconds=monotonic() - began)


def _true_poses(source: OdometryInput) -> list[FloatArray]:
    """Return the true pose of every frame, needed to compute depth."""
    place = source.place / TRUTH
    truth = read_trajectory(place)
    if len(truth) != len(source.stamps_s) or not truth.known.all():
        raise RecordingError(f"{place}: does not contain a pose for each of the {len(source.stamps_s)} frames")
    return list(map(pose_of, Rotation.from_quat(truth.quaternions).as_matrix(), truth.positions))


class _Tracker:
    """The current keyframe and all poses so far."""

    def __init__(self, source: OdometryInput, run: int, max_grey: int) -> None:
        curves, self._corrector = source.photometry, None
        if source.condition.calibrated:
            self._corrector = Corrector(curves.response, curves.vignette, max_grey, assume_missing=True)
        self._reference_ms = float(np.median(source.exposures_ms))
        self._affine = source.condition.mode == 1
        self._depth = SceneDepth.of(source.place)
        self._camera = self._depth.camera
        self._truth = _true_poses(source)
        self._random = np.random.default_rng(run)
        self._key = np.eye(4)
        self._points = np.empty((0, 3))
        self._reference = np.empty((LEVELS, 0))
        self._motion = np.eye(4)
        self._speed = np.eye(4)
        self._since = 0
        self._poses: list[tuple[float, FloatArray]] = []

    def push(self, frame: Frame) -> bool:
        """Take the next frame; return whether tracking succeeded."""
        image, saturated = self._brightness(frame)
        pyramid = Brightness.of(np.where(saturated, np.float32(np.nan), image))
        if not self._poses:
            self._begin(frame, pyramid, image, saturated)
            self._poses.append((frame.stamp_s, np.eye(4)))
            return True
        start = self._speed @ self._motion
        found = align(self._points, self._reference, pyramid, self._camera, start, affine=self._affine)
        if found.agreeing < _LOST:
            return False
        self._speed = found.motion @ np.linalg.inv(self._motion)
        self._motion = found.motion
        # The keyframe's pose maps its coordinates to the world; the motion maps them to this frame.
        pose = self._key @ np.linalg.inv(found.motion)
        self._poses.append((frame.stamp_s, pose))
        self._since += 1
        far = found.moved_px > _FARTHEST_MOVE * image.shape[1]
        if far or found.agreeing < _LEAST_AGREEING or self._since >= _MOST_FRAMES:
            self._key = pose
            self._begin(frame, pyramid, image, saturated)
        return True

    @property
    def trajectory(self) -> Trajectory | None:
        """All poses so far; None before the second."""
        if len(self._poses) < 2:
            return None
        stamps_s, poses = (np.array(column) for column in zip(*self._poses, strict=True))
        return Trajectory(stamps_s, poses[:, :3, 3], np.asarray(Rotation.from_matrix(poses[:, :3, :3]).as_quat()))

    def _brightness(self, frame: Frame) -> tuple[Float32Array, BoolArray]:
        """Return the brightness of a frame and its saturated pixels."""
        # With a calibration, brightness is the square root of the irradiance at the median exposure, which has
        # uniform noise.
        grey = frame.image.astype(np.float32) / np.float32(frame.max_grey)
        saturated = cv2.dilate((grey >= _SATURATED).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        if self._corrector is None:
            return grey, saturated
        relative = frame.exposure_ms / self._reference_ms
        light = self._corrector.correct(frame.image, relative, mark_saturated=False)
        return np.sqrt(light, dtype=np.float32), saturated

    def _begin(self, frame: Frame, pyramid: Brightness, image: Float32Array, saturated: BoolArray) -> None:
        """Make a frame the keyframe."""
        places = self._choose(image, saturated)
        depth = self._depth.at(places, self._truth[frame.index])
        known = np.isfinite(depth)
        places, depth = places[known], depth[known]
        self._points = self._camera.lift(places, depth)
        self._reference = np.array([pyramid.at(level, places)[:, 0] for level in range(LEVELS)])
        self._motion, self._since = np.eye(4), 0

    def _choose(self, image: Float32Array, saturated: BoolArray) -> FloatArray:
        """Return a pixel with large gradient in each cell, shape (n, 2); random among nearly equal ones."""
        smooth = cv2.GaussianBlur(image, (0, 0), 1.0)
        steep = np.hypot(cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1))
        steep *= self._random.uniform(0.6, 1.0, steep.shape).astype(np.float32)
        steep[saturated] = 0
        edge = max(6, image.shape[1] // _CELLS_ACROSS)
        rows, columns = (n // edge for n in image.shape)
        cells = steep[: rows * edge, : columns * edge].reshape(rows, edge, columns, edge).swapaxes(1, 2)
        flat = cells.reshape(rows, columns, edge * edge)
        best = flat.argmax(axis=2)
        y = np.arange(rows)[:, None] * edge + best // edge
        x = np.arange(columns)[None] * edge + best % edge
        found = np.stack([x, y], axis=-1)[flat.max(axis=2) > 0]
        return np.asarray(found, dtype=np.float64)
