"""Keyframe selection: the earlier frame with which a new one is compared."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.correspondence.flat_sampling import Keyframe, Samples
from ospc.settings.sampling import (
    AGE_CLASS_RATIO,
    AGE_CLASSES,
    AGE_CLASSES_PER_DOUBLING,
    EXPOSURE_CHANGE_WEIGHT,
    MAX_COMPARISONS,
    MAX_PRIOR_RADIAL_MOTION,
    MIN_INFORMATION,
    OLDEST_AGE_FACTOR,
    OVERLAP_POWER,
    PRIOR_COMPARISONS,
    PRIOR_OVERLAP,
    PRIOR_RADIAL_MOTION,
    RESPONSE_TURN,
)


@dataclass
class Kept:
    """A kept keyframe: its number, ln of its exposure when it was added, and how often it was selected.

    ``frame`` is None after its state was loaded, until it is supplied again.
    """

    number: int
    log_exposure: float
    uses: int = 0

    def __post_init__(self) -> None:
        self.frame: Keyframe | None = None


@dataclass
class KeyframeSelector:
    """Keeps keyframes at geometrically increasing ages, and selects the most informative one for comparison.

    The information of a comparison is predicted in advance: exposures are known, and overlap and radial motion at
    each age are learned from earlier comparisons. One selection in three optimises for the response (change of
    exposure), the others for the vignette (radial motion).
    """

    capacity: int
    """Maximum number of keyframes."""
    max_log_ratio: float
    """Changes of exposure beyond this, in ln, add no information: most points are then clipped in one of the two
    frames."""
    _kept: list[Kept] = field(default_factory=list, repr=False)
    _selections: int = field(default=0, repr=False)
    _statistics: FloatArray = field(default_factory=lambda: np.zeros((4, AGE_CLASSES)), repr=False)
    """For each class of age: the number of comparisons, the sum of their overlap, the number of successful ones, and
    the sum of their radial motion, with decreasing weight of older ones, shape (4, 26)."""

    def select(self, number: int, log_exposure: float) -> Keyframe | None:
        """Return the keyframe to compare with a frame of this number and ln exposure; None if there is none."""
        self._kept = [kept for kept in self._kept if kept.frame is not None]  # others were not replayed
        if not self._kept:
            return None
        self._selections += 1
        change = np.abs(np.array([kept.log_exposure for kept in self._kept]) - log_exposure)
        change = np.minimum(change, self.max_log_ratio)
        overlap, motion = self._expected()
        age = _age_class(number - np.array([kept.number for kept in self._kept]))
        for_response = self._selections % RESPONSE_TURN == 0
        gain = change**2 if for_response else motion[age] ** 2 + EXPOSURE_CHANGE_WEIGHT * change**2
        information = (gain + MIN_INFORMATION) * overlap[age] ** OVERLAP_POWER
        information /= 1 + np.array([kept.uses for kept in self._kept])
        best = self._kept[int(np.argmax(information))]
        best.uses += 1
        return best.frame

    @property
    def best_age(self) -> int:
        """Age in frames at which a comparison is expected to be most informative about the vignette."""
        overlap, motion = self._expected()
        return round(AGE_CLASS_RATIO ** int(np.argmax(motion**2 * overlap**OVERLAP_POWER)))

    def update(self, keyframe: Keyframe, number: int, samples: Samples) -> None:
        """Update the expected overlap and radial motion from a comparison with the frame of this number."""
        age = _age_class(number - keyframe.number)
        self._statistics *= 1 - 1 / MAX_COMPARISONS
        self._statistics[:, age] += (1, samples.overlap, samples.overlap > 0, samples.radial_motion)

    def add(self, frame: Keyframe, log_exposure: float) -> None:
        """Add a keyframe, and drop the least useful one if there are too many."""
        self._kept.append(Kept(frame.number, log_exposure))
        self._kept[-1].frame = frame
        if len(self._kept) > self.capacity:
            ages = 1 + frame.number - np.array([k.number for k in self._kept], dtype=np.float64)
            # Dropping a keyframe makes its neighbours adjacent: drop the one that leaves the smallest step in ln age.
            # Keep the newer half, which will provide the future old keyframes.
            step = np.log(np.append(ages[0] * OLDEST_AGE_FACTOR, ages[:-2])) - np.log(ages[1:])
            del self._kept[int(np.argmin(step[: max(1, self.capacity // 2)]))]

    def forget_before(self, number: int) -> None:
        """Drop the keyframes with lower numbers."""
        self._kept = [kept for kept in self._kept if kept.number >= number]

    @property
    def numbers(self) -> list[int]:
        """Numbers of the keyframes."""
        return [kept.number for kept in self._kept]

    @property
    def frames_to_replay(self) -> frozenset[int]:
        """Numbers of the keyframes to pass to :meth:`replay` after loading; those missing at a selection are lost."""
        return frozenset(kept.number for kept in self._kept if kept.frame is None)

    def replay(self, frame: Keyframe) -> None:
        """Supply a keyframe again."""
        for kept in self._kept:
            if kept.number == frame.number:
                kept.frame = frame

    def _expected(self) -> tuple[FloatArray, FloatArray]:
        """Return the expected overlap and radial motion of every class of age, shape (26,) each."""
        expected = np.empty((2, AGE_CLASSES))
        overlap, motion = PRIOR_OVERLAP, PRIOR_RADIAL_MOTION
        for age, (trials, overlaps, successes, motions) in enumerate(self._statistics.T):
            overlap = (PRIOR_COMPARISONS * overlap + overlaps) / (PRIOR_COMPARISONS + trials)
            motion = (PRIOR_COMPARISONS * motion + motions) / (PRIOR_COMPARISONS + successes)
            expected[:, age] = overlap, motion
            motion = min(motion * AGE_CLASS_RATIO, MAX_PRIOR_RADIAL_MOTION)
        return expected[0], expected[1]


def _age_class(frames: IntArray | int) -> IntArray:
    """Return the class of an age in frames."""
    doublings = np.log2(np.maximum(frames, 1))
    return np.minimum((AGE_CLASSES_PER_DOUBLING * doublings).astype(np.int64), AGE_CLASSES - 1)
