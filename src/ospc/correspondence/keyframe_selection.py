"""Keyframe selection: which earlier frame a new one is compared with."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.correspondence.flat_sampling import Keyframe, Samples

AGES = 16
"""Classes of age, two for each doubling: up to 256 processed frames."""

_FIRST_OVERLAP = 0.8
"""Overlap expected of an age before any comparison: high, so that every age is tried."""

_FIRST_TRIALS = 1.5
"""Weight of what is expected before any comparison, in comparisons: the first real ones soon outweigh it."""

_FIRST_MOTION, _LARGEST_MOTION = 0.01, 0.3
"""Radial motion expected at an age of one frame, in half diagonals, and its limit: it doubles with each class."""

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
    order: int
    log_exposure: float
    uses: int = 0


@dataclass(frozen=True)
class KeyframeSelectorState:
    """What :class:`KeyframeSelector` knows, with keyframes named by their numbers instead of held.

    Attributes
    ----------
    frames, orders, uses
        Of every keyframe: its number, how many keyframes were added before it, and how often it was selected, shape
        (kept,) each.
    log_exposure
        ln of its exposure when it was added, shape (kept,).
    added, selections
        Keyframes added, and selections made, so far.
    overlap, motion, trials
        What is known of each class of age, shape (16,) each.
    """

    frames: IntArray
    orders: IntArray
    uses: IntArray
    log_exposure: FloatArray
    added: int
    selections: int
    overlap: FloatArray
    motion: FloatArray
    trials: FloatArray


@dataclass
class KeyframeSelector:
    """Keeps keyframes at ages that grow geometrically, and selects the one that is most informative to compare with.

    The worth of a comparison is predicted before it is made: exposures are given, and overlap and radial motion at
    each age are learned from the comparisons made so far. Selections alternate between what serves the response
    (change of exposure) and what serves the vignette (radial motion).

    Attributes
    ----------
    capacity
        Most keyframes kept.
    max_log_ratio
        Changes of exposure beyond this, in ln, add nothing: most places are then clipped in one of the two.
    """

    capacity: int = 20
    max_log_ratio: float = 1.2
    _kept: list[_Kept] = field(default_factory=list, repr=False)
    _added: int = field(default=0, repr=False)
    _selections: int = field(default=0, repr=False)
    _overlap: FloatArray = field(default_factory=lambda: np.full(AGES, _FIRST_OVERLAP), repr=False)
    _motion: FloatArray = field(
        default_factory=lambda: np.minimum(_FIRST_MOTION * 2.0 ** np.arange(AGES), _LARGEST_MOTION), repr=False
    )
    _trials: FloatArray = field(default_factory=lambda: np.full(AGES, _FIRST_TRIALS), repr=False)

    def select(self, log_exposure: float) -> Keyframe | None:
        """Return the keyframe to compare a frame of this ln exposure with; None where there is none yet."""
        if not self._kept:
            return None
        self._selections += 1
        for_response = self._selections % 2 == 0
        best = max(self._kept, key=lambda kept: self._worth(kept, log_exposure, for_response))
        best.uses += 1
        return best.frame

    def learn(self, keyframe: Keyframe, samples: Samples) -> None:
        """Update the expected overlap and radial motion from a comparison of the newest frame."""
        age = self._age_class(next(kept.order for kept in self._kept if kept.frame is keyframe))
        self._trials[age] += 1
        self._overlap[age] += (samples.overlap - self._overlap[age]) / self._trials[age]
        self._motion[age] += (samples.radial_motion - self._motion[age]) / self._trials[age]

    def add(self, frame: Keyframe, log_exposure: float) -> None:
        """Keep a frame as a keyframe, and drop the least useful one if there are too many."""
        self._kept.append(_Kept(frame, self._added, log_exposure))
        self._added += 1
        if len(self._kept) > self.capacity:
            ages = self._added - np.array([k.order for k in self._kept], dtype=np.float64)
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
            np.array([k.order for k in self._kept], dtype=np.int64),
            np.array([k.uses for k in self._kept], dtype=np.int64),
            np.array([k.log_exposure for k in self._kept], dtype=np.float64),
            self._added,
            self._selections,
            self._overlap.copy(),
            self._motion.copy(),
            self._trials.copy(),
        )

    def restore(self, state: KeyframeSelectorState) -> None:
        """Go on from a state, without the images of the keyframes.

        Raises
        ------
        ValueError
            If its arrays do not fit each other.
        """
        tables = (state.overlap, state.motion, state.trials)
        lengths = {len(state.frames), len(state.orders), len(state.uses), len(state.log_exposure)}
        if any(table.shape != (AGES,) for table in tables) or len(lengths) != 1:
            raise ValueError("the state of the keyframe selection has tables of the wrong length")
        self._kept, self._added, self._selections = [], state.added, state.selections
        self._overlap, self._motion, self._trials = (table.copy() for table in tables)

    def recall(self, frame: Keyframe, state: KeyframeSelectorState) -> None:
        """Keep a frame again that was a keyframe when the state was taken; any other is ignored."""
        for at in np.flatnonzero(state.frames == frame.number):
            order, uses = int(state.orders[at]), int(state.uses[at])
            self._kept.append(_Kept(frame, order, float(state.log_exposure[at]), uses))
        self._kept.sort(key=lambda kept: kept.order)

    def _worth(self, kept: _Kept, log_exposure: float, for_response: bool) -> float:
        age = self._age_class(kept.order)
        change = min(abs(kept.log_exposure - log_exposure), self.max_log_ratio)
        gain = change**2 if for_response else self._motion[age] ** 2 + _RESPONSE_SHARE * change**2
        return float((gain + _LEAST_WORTH) * self._overlap[age] ** _OVERLAP_POWER / (1 + kept.uses))

    def _age_class(self, order: int) -> int:
        return min(int(2 * np.log2(max(self._added - order, 1))), AGES - 1)
