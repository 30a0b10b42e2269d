"""Errors of a trajectory against the truth, up to the similarity that is not observable with a single camera.

The alignment error e_align is that of the TUM monocular visual odometry data set (Engel, Usenko, Cremers, "A
photometrically calibrated benchmark for monocular visual odometry", 2016). The truth is known only at the beginning
and at the end, and the drift in between is the difference of the two alignments.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from ospc.arrays import BoolArray, FloatArray, IntArray, nearest
from ospc.errors import FormatError, NotObservableError, SettingError, counted
from ospc.formats.files import read_text
from ospc.settings.evaluation import COLLINEAR_RATIO, MIN_POSES, STAMP_TOLERANCE_S


@dataclass(frozen=True)
class Similarity:
    """x ↦ s·R·x + t, with s positive, R of shape (3, 3) and t of shape (3,)."""

    scale: float
    rotation: FloatArray
    translation: FloatArray

    def __call__(self, points: FloatArray) -> FloatArray:
        """Return the transformed points, shape (n, 3) -> (n, 3)."""
        return np.asarray(self.scale * points @ self.rotation.T + self.translation)


def align_similarity(points: FloatArray, target: FloatArray) -> Similarity:
    """Return the least squares similarity from points to their targets, shape (n, 3) (Umeyama 1991).

    NotObservableError if there are fewer than three points, their products overflow, or they are collinear and do not
    determine the rotation.
    """
    if points.shape[0] < MIN_POSES:
        raise NotObservableError(f"an alignment needs {MIN_POSES} poses with truth; there are {points.shape[0]}")
    with np.errstate(over="ignore", invalid="ignore"):
        centre, target_centre = points.mean(axis=0), target.mean(axis=0)
        centred = points - centre
        crossed = (target - target_centre).T @ centred
        finite = np.isfinite(np.linalg.norm(crossed))
    if not finite:  # the decomposition would not end
        raise NotObservableError("the poses are too far apart to be aligned")
    left, singular, right = np.linalg.svd(crossed)
    if singular[1] <= COLLINEAR_RATIO * singular[0]:
        raise NotObservableError("the poses are collinear or equal, so the alignment is not determined")
    mirror = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation = np.asarray((left * mirror) @ right)
    scale = float(singular @ mirror / np.sum(centred**2))
    return Similarity(scale, rotation, np.asarray(target_centre - scale * rotation @ centre))


_LARGEST_FILE = 2**29
"""Largest file that is read, in bytes: a day of poses at 50 Hz."""
_COLUMNS = 8
"""Columns of a row: stamp, position, quaternion."""
_QUATERNION_LENGTHS = (0.5, 2.0)
"""Range of accepted lengths of unit quaternions, which files round to a few digits."""


@dataclass(frozen=True)
class Trajectory:
    """Poses in temporal order.

    ``stamps_s``, in seconds, has shape (n,) and does not decrease. ``positions`` of the camera in the world have
    shape (n, 3), and ``quaternions`` (x, y, z, w) from camera to world coordinates have shape (n, 4). Unknown values
    are NaN.
    """

    stamps_s: FloatArray
    positions: FloatArray
    quaternions: FloatArray

    def __len__(self) -> int:
        """Return the number of poses."""
        return int(self.stamps_s.size)

    @property
    def known(self) -> BoolArray:
        """Which poses have a position, shape (n,)."""
        return np.asarray(np.isfinite(self.positions).all(axis=1))

    def select(self, poses: BoolArray | IntArray) -> Trajectory:
        """Return some of the poses."""
        return Trajectory(self.stamps_s[poses], self.positions[poses], self.quaternions[poses])


@dataclass(frozen=True)
class AlignmentError:
    """Drift of a trajectory from the alignments of its two halves.

    Attributes
    ----------
    e_align
        Root mean square distance, over all poses, between the trajectories aligned to the first and to the second
        half, in units of the truth.
    e_s
        Scale of the first alignment over the scale of the second.
    e_r_deg
        Angle between the rotations of the two alignments, in degrees.
    rmse
        Root mean square distance to the truth after one alignment to all of it.
    poses, unmatched
        Number of poses of the trajectory, and number of poses without a row of the truth within the tolerance.
    first, second
        Number of poses with truth in the first and the second half.
    """

    e_align: float
    e_s: float
    e_r_deg: float
    rmse: float
    poses: int
    first: int
    second: int
    unmatched: int


@dataclass(frozen=True)
class RelativeError:
    """Root mean square errors of relative motions over pairs of poses, in units of the truth and in degrees."""

    translation: float
    rotation_deg: float
    pairs: int


def read_trajectory(path: str | Path) -> Trajectory:
    """Read rows ``stamp tx ty tz qx qy qz qw``, separated by white space or commas; ``#`` starts a comment.

    Further columns are ignored, NaN is allowed, and rows are sorted by stamp. FormatError if a row is malformed, a
    stamp is not finite, or there is no row.
    """
    rows: list[list[float]] = []
    for number, line in enumerate(read_text(path, _LARGEST_FILE).splitlines(), start=1):
        words = line.split("#", 1)[0].replace(",", " ").split()
        if not words:
            continue
        try:
            rows.append([float(word) for word in words[:_COLUMNS]])
        except ValueError:
            rows.append([])
        if len(rows[-1]) < _COLUMNS:
            raise FormatError(f"{path}: line {number} is not 'stamp tx ty tz qx qy qz qw'; {line.strip()[:40]!r}")
    if not rows:
        raise FormatError(f"{path}: contains no pose; rows are 'stamp tx ty tz qx qy qz qw'")
    table = np.array(rows, dtype=np.float64)
    if not np.all(np.isfinite(table[:, 0])):
        raise FormatError(f"{path}: has a time stamp that is not finite")
    table = table[np.argsort(table[:, 0], kind="stable")]
    return Trajectory(table[:, 0], table[:, 1:4], table[:, 4:8])


def associate(stamps_s: FloatArray, truth_stamps_s: FloatArray) -> IntArray:
    """Return for each stamp the index of the nearest true stamp, or −1 if none is within the tolerance.

    The shapes are (n,) and (m,), m ≥ 1; true stamps must not decrease.
    """
    found = nearest(truth_stamps_s, stamps_s)
    return np.where(np.abs(truth_stamps_s[found] - stamps_s) <= STAMP_TOLERANCE_S, found, -1).astype(np.int64)


def alignment_error(estimate: Trajectory, truth: Trajectory) -> AlignmentError:
    """Return e_align, e_s and e_r of a trajectory; the truth is split at its middle row, including NaN rows.

    Raises the exceptions of :func:`half_alignments`.
    """
    (first, first_poses), (second, second_poses) = half_alignments(estimate, truth)
    apart = first(estimate.positions) - second(estimate.positions)
    turn = Rotation.from_matrix(second.rotation @ first.rotation.T)
    return AlignmentError(
        e_align=_rms_length(apart),
        e_s=first.scale / second.scale,
        e_r_deg=float(np.degrees(turn.magnitude())),
        rmse=absolute_trajectory_error(estimate, truth),
        poses=len(estimate),
        first=first_poses,
        second=second_poses,
        unmatched=int(np.count_nonzero(associate(estimate.stamps_s, truth.stamps_s) < 0)),
    )


def half_alignments(estimate: Trajectory, truth: Trajectory) -> list[tuple[Similarity, int]]:
    """Return the alignments to the first and second half of the truth, each with its number of poses.

    Raises
    ------
    FormatError
        If a position of the estimate is not finite.
    NotObservableError
        If one half has too few poses with truth.
    """
    matched, true = _matched(estimate, truth)
    halves = {
        "first": true.stamps_s <= truth.stamps_s[max(len(truth) // 2 - 1, 0)],
        "second": true.stamps_s >= truth.stamps_s[(len(truth) + 1) // 2 - 1],
    }
    alignments = []
    for name, half in halves.items():
        try:
            found = align_similarity(matched.positions[half], true.positions[half])
        except NotObservableError as error:
            raise NotObservableError(f"{name} half of the truth: {error}") from None
        alignments.append((found, int(np.count_nonzero(half))))
    return alignments


def absolute_trajectory_error(estimate: Trajectory, truth: Trajectory) -> float:
    """Return the root mean square distance to the truth after the best similarity, in units of the truth.

    FormatError if a position of the estimate is not finite, NotObservableError if too few poses have a truth.
    """
    matched, true = _matched(estimate, truth)
    alignment = align_similarity(matched.positions, true.positions)
    return _rms_length(alignment(matched.positions) - true.positions)


def relative_pose_error(estimate: Trajectory, truth: Trajectory, interval_s: float = 1.0) -> RelativeError:
    """Return the errors of the motions over a time interval, after the best similarity over all poses.

    Each pose is paired with the first one at least this interval later. Both trajectories must refer to the same
    camera frame.

    Raises
    ------
    SettingError
        If the interval is not positive.
    FormatError
        If a position of the estimate is not finite, or a quaternion does not have length 1.
    NotObservableError
        If too few poses have a truth, or no two are this far apart.
    """
    if not interval_s > 0:
        raise SettingError(f"the interval of relative errors must be positive, not {interval_s}")
    matched, true = _matched(estimate, truth)
    alignment = align_similarity(matched.positions, true.positions)
    turned = Rotation.from_matrix(alignment.rotation) * _rotations(matched.quaternions)
    true_turned = _rotations(true.quaternions)
    ends = np.searchsorted(matched.stamps_s, matched.stamps_s + interval_s - STAMP_TOLERANCE_S)
    starts = np.flatnonzero(ends < len(matched))
    ends = ends[starts]
    if starts.size == 0:
        raise NotObservableError(f"no two poses with truth are {interval_s:g} s apart")

    def motions(positions: FloatArray, rotations: Rotation) -> tuple[FloatArray, Rotation]:
        back = rotations[starts].inv()
        return back.apply(positions[ends] - positions[starts]), back * rotations[ends]

    local, turn = motions(alignment(matched.positions), turned)
    true_local, true_turn = motions(true.positions, true_turned)
    angles = np.degrees((true_turn.inv() * turn).magnitude())
    return RelativeError(_rms_length(local - true_local), float(np.sqrt(np.mean(angles**2))), int(starts.size))


def _matched(estimate: Trajectory, truth: Trajectory) -> tuple[Trajectory, Trajectory]:
    """Return the poses that have a truth, and their truth."""
    if not estimate.known.all():
        raise FormatError(
            f"{np.count_nonzero(~estimate.known)} of {counted(len(estimate), 'estimated position')} not finite; "
            "the odometry failed"
        )
    partner = associate(estimate.stamps_s, truth.stamps_s)
    matched = (partner >= 0) & truth.known[partner]
    return estimate.select(matched), truth.select(partner[matched])


def _rotations(quaternions: FloatArray) -> Rotation:
    length = np.linalg.norm(quaternions, axis=1)
    if not np.all((length > _QUATERNION_LENGTHS[0]) & (length < _QUATERNION_LENGTHS[1])):
        raise FormatError("a quaternion of a matched pose does not have length 1")
    return Rotation.from_quat(quaternions)


def _rms_length(vectors: npt.ArrayLike) -> float:
    return float(np.sqrt(np.mean(np.sum(np.asarray(vectors, dtype=np.float64) ** 2, axis=1))))
