"""Keyframe selection: which earlier frame a new one is compared with."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.correspondence.flat_sampling import Keyframe, Samples

AGES = 26
"""Classes of age in frames, two for each doubling: up to 5800 frames."""

_FIRST_OVERLAP, _FIRST_MOTION = 0.8, 0.01
"""Overlap, and radial motion in half diagonals, expected of the youngest class before any comparison. Each further
class is expected to overlap like the one before, and to have moved in proportion to its age."""

_LARGEST_MOTION = 0.3
"""Largest radial motion expected, in half diagonals."""

_AGE_STEP = 2.0**0.5
"""Age of a class over that of the one before."""

_FIRST_TRIALS = 1.5
"""Weight of what is expected before any comparison, in comparisons: the first real ones soon outweigh it."""

MOST_TRIALS = 100
"""Comparisons that count: the camera may move faster or slower than so many ago."""

_RESPONSE_TURN = 3
"""Every so many selections serve the response, of which a pair tells more than of the vignette."""

_RESPONSE_SHARE = 0.01
"""Worth of a change of exposure, squared, where the vignette is the aim: breaks ties between equal motions."""

_LEAST_WORTH = 1e-6
"""Worth of a comparison without change of exposure or motion, so that overlap decides between them."""

_OVERLAP_POWER = 1.5
"""Worth grows with this power of the overlap, faster than the number of shared places: registration is better too
where more overlaps."""

_OLDER_THAN_OLDEST = 1.5
"""Age of an imagined keyframe before the oldest, over that of the oldest: it decides when the oldest is dropped."""


@dataclass
class _Kept:
    frame: Keyframe
    log_exposure: float
    uses: int = 0


@dataclass(frozen=True)
class KeyframeSelectorState:
    """What :class:`KeyframeSelector` knows, with keyframes named by their numbers instead of held."""

    frames: IntArray
    """Number of every keyframe, shape (kept,)."""
    uses: IntArray
    """How often it was selected, shape (kept,)."""
    log_exposure: FloatArray
    """ln of its exposure when it was added, shape (kept,)."""
    selections: int
    """Selections made so far."""
    seen: FloatArray
    """Of each class of age: the number of comparisons, the sum of their overlap, the number that found the view
    again, and the sum of their radial motion, the latest counting most, shape (4, 26)."""


@dataclass
class KeyframeSelector:
    """Keeps keyframes at ages that grow geometrically, and selects the one that is most informative to compare with.

    The worth of a comparison is predicted before it is made: exposures are given, and overlap and radial motion at
    each age are learned from the comparisons made so far. One selection in three goes for what serves the response
    (change of exposure), the others for what serves the vignette (radial motion).
    """

    capacity: int = 20
    """Most keyframes kept."""
    max_log_ratio: float = 1.2
    """Changes of exposure beyond this, in ln, add nothing: most places are then clipped in one of the two."""
    _kept: list[_Kept] = field(default_factory=list, repr=False)
    _selections: int = field(default=0, repr=False)
    _seen: FloatArray = field(default_factory=lambda: np.zeros((4, AGES)), repr=False)

    def select(self, number: int, log_exposure: float) -> Keyframe | None:
        """Return the keyframe to compare a frame of this number and ln exposure with; None where there is none."""
        if not self._kept:
            return None
        self._selections += 1
        known = self.state()
        change = np.minimum(np.abs(known.log_exposure - log_exposure), self.max_log_ratio)
        overlap, motion = self._expected()
        age = _age_class(number - known.frames)
        for_response = self._selections % _RESPONSE_TURN == 0
        gain = change**2 if for_response else motion[age] ** 2 + _RESPONSE_SHARE * change**2
        worth = (gain + _LEAST_WORTH) * overlap[age] ** _OVERLAP_POWER / (1 + known.uses)
        best = self._kept[int(np.argmax(worth))]
        best.uses += 1
        return best.frame

    @property
    def best_age(self) -> int:
        """Age in frames at which a comparison is expected to tell most about the vignette."""
        overlap, motion = self._expected()
        return round(_AGE_STEP ** int(np.argmax(motion**2 * overlap**_OVERLAP_POWER)))

    def learn(self, keyframe: Keyframe, number: int, samples: Samples) -> None:
        """Update the expected overlap and radial motion from a comparison with the frame of this number."""
        age = _age_class(number - keyframe.number)
        self._seen *= 1 - 1 / MOST_TRIALS
        self._seen[:, age] += (1, samples.overlap, samples.overlap > 0, samples.radial_motion)

    def add(self, frame: Keyframe, log_exposure: float) -> None:
        """Keep a frame as a keyframe, and drop the least useful one if there are too many."""
        self._kept.append(_Kept(frame, log_exposure))
        if len(self._kept) > self.capacity:
            ages = 1 + frame.number - np.array([k.frame.number for k in self._kept], dtype=np.float64)
            # Without a keyframe its neighbours become adjacent: drop where that leaves the smallest step in ln age.
            # The newer half stays: only these can become old at other ages.
            step = np.log(np.append(ages[0] * _OLDER_THAN_OLDEST, ages[:-2])) - np.log(ages[1:])
            del self._kept[int(np.argmin(step[: self.capacity // 2]))]

    def forget_before(self, number: int) -> None:
        """Drop the keyframes with lower numbers."""
        self._kept = [kept for kept in self._kept if kept.frame.number >= number]

    def state(self) -> KeyframeSelectorState:
        """Return everything needed to continue with :meth:`restore` and :meth:`recall`."""
        return KeyframeSelectorState(
            np.array([k.frame.number for k in self._kept], dtype=np.int64),
            np.array([k.uses for k in self._kept], dtype=np.int64),
            np.array([k.log_exposure for k in self._kept], dtype=np.float64),
            self._selections,
            self._seen.copy(),
        )

    def restore(self, state: KeyframeSelectorState) -> None:
        """Go on from a state, without the images of the keyframes; raise a ValueError if its arrays do not fit."""
        lengths = {len(state.frames), len(state.uses), len(state.log_exposure)}
        if state.seen.shape != self._seen.shape or len(lengths) != 1:
            raise ValueError("the state of the keyframe selection has tables of the wrong length")
        self._kept, self._selections, self._seen = [], state.selections, state.seen.copy()

    def recall(self, frame: Keyframe, state: KeyframeSelectorState) -> None:
        """Keep a frame again that was a keyframe when the state was taken; any other is ignored."""
        for at in np.flatnonzero(state.frames == frame.number):
            self._kept.append(_Kept(frame, float(state.log_exposure[at]), int(state.uses[at])))
        self._kept.sort(key=lambda kept: kept.frame.number)

    def _expected(self) -> tuple[FloatArray, FloatArray]:
        """Return the overlap and the radial motion expected of every class of age, shape (26,) each."""
        expected = np.empty((2, AGES))
        overlap, motion = _FIRST_OVERLAP, _FIRST_MOTION
        for age, (trials, overlaps, successes, motions) in enumerate(self._seen.T):
            overlap = (_FIRST_TRIALS * overlap + overlaps) / (_FIRST_TRIALS + trials)
            motion = (_FIRST_TRIALS * motion + motions) / (_FIRST_TRIALS + successes)
            expected[:, age] = overlap, motion
            motion = min(motion * _AGE_STEP, _LARGEST_MOTION)
        return expected[0], expected[1]


def _age_class(frames: IntArray | int) -> IntArray:
    """Return the class of an age in frames."""
    return np.minimum((2 * np.log2(np.maximum(frames, 1))).astype(np.int64), AGES - 1)
