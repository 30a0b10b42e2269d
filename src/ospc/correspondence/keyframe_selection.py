"""Which earlier view the new one is compared with: the one from which most can be learned."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.correspondence.flat_sampling import Samples
from ospc.correspondence.preprocessing import PreprocessedFrame

_AGES = 16


@dataclass
class _Kept:
    view: PreprocessedFrame
    order: int
    uses: int = 0


@dataclass(frozen=True)
class KeyframeSelectorState:
    """What :class:`KeyframeSelector` knows, with views named by their frames instead of held.

    Attributes
    ----------
    frames, orders, uses
        Of every view kept: index of its frame, its number, how often it was chosen, shape (kept,) each.
    seen, choices
        Views added and choices made so far.
    overlap, motion, trials
        What is known of each age, shape (16,) each.
    """

    frames: IntArray
    orders: IntArray
    uses: IntArray
    seen: int
    choices: int
    overlap: FloatArray
    motion: FloatArray
    trials: FloatArray


@dataclass
class KeyframeSelector:
    """Keeps recent views, at ages that grow geometrically, and chooses among them.

    What a comparison is worth is known before it is made: exposures are given, and overlap and radial motion after so
    many views are learned from the comparisons made so far. Choices alternate between what serves the response
    (change of exposure) and what serves the vignette (radial motion).

    Attributes
    ----------
    capacity
        Most views kept.
    max_log_ratio
        Changes of exposure beyond this, in ln, add nothing: most places are then clipped in one of the two.
    """

    capacity: int = 20
    max_log_ratio: float = 1.2
    _kept: list[_Kept] = field(default_factory=list, repr=False)
    _seen: int = field(default=0, repr=False)
    _choices: int = field(default=0, repr=False)
    # A comparison and a half of optimism: ages never tried are worth a try.
    _overlap: FloatArray = field(default_factory=lambda: np.full(_AGES, 0.8), repr=False)
    _motion: FloatArray = field(default_factory=lambda: np.minimum(0.01 * 2.0 ** np.arange(_AGES), 0.3), repr=False)
    _trials: FloatArray = field(default_factory=lambda: np.full(_AGES, 1.5), repr=False)

    def choose(self, view: PreprocessedFrame) -> PreprocessedFrame | None:
        """Return the view to compare a new one with; None where there is none yet."""
        if not self._kept:
            return None
        self._choices += 1
        for_response = self._choices % 2 == 0
        best = max(self._kept, key=lambda kept: self._worth(kept, view, for_response))
        best.uses += 1
        return best.view

    def learn(self, view0: PreprocessedFrame, samples: Samples) -> None:
        """Take note of what comparing the newest view with an earlier one gave."""
        age = self._age_class(next((k.order for k in self._kept if k.view is view0), self._seen))
        self._trials[age] += 1
        self._overlap[age] += (samples.overlap - self._overlap[age]) / self._trials[age]
        self._motion[age] += (samples.radial_motion - self._motion[age]) / self._trials[age]

    def add(self, view: PreprocessedFrame) -> None:
        """Keep a view, and drop one that is hardly missed if there are too many."""
        self._kept.append(_Kept(view, self._seen))
        self._seen += 1
        if len(self._kept) > self.capacity:
            ages = self._seen - np.array([k.order for k in self._kept], dtype=np.float64)
            # Without a view its neighbours stand next to each other: the smallest step in ln age is missed least.
            # The newest stay: they are the only ones that can still become old.
            step = np.log(np.append(ages[0] * 1.5, ages[:-2])) - np.log(ages[1:])
            del self._kept[int(np.argmin(step[: self.capacity // 2]))]

    def state(self) -> KeyframeSelectorState:
        """Return all that is known, to be continued by :meth:`restore` and :meth:`recall`."""
        columns = [(k.view.frame, k.order, k.uses) for k in self._kept]
        frames, orders, uses = np.array(columns, dtype=np.int64).reshape(-1, 3).T
        return KeyframeSelectorState(
            frames,
            orders,
            uses,
            self._seen,
            self._choices,
            self._overlap.copy(),
            self._motion.copy(),
            self._trials.copy(),
        )

    def restore(self, state: KeyframeSelectorState) -> None:
        """Go on from a state, without the views themselves.

        Raises
        ------
        ValueError
            If it is none that :meth:`state` returns.
        """
        tables = (state.overlap, state.motion, state.trials)
        if any(table.shape != (_AGES,) for table in tables) or len({len(state.frames), len(state.orders)}) != 1:
            raise ValueError("the state of the partners has tables of the wrong length")
        self._kept, self._seen, self._choices = [], state.seen, state.choices
        self._overlap, self._motion, self._trials = (table.copy() for table in tables)

    def recall(self, view: PreprocessedFrame, state: KeyframeSelectorState) -> None:
        """Keep a view again as it was kept when the state was taken; of another frame than those it is ignored."""
        for number in np.flatnonzero(state.frames == view.frame):
            self._kept.append(_Kept(view, int(state.orders[number]), int(state.uses[number])))
        self._kept.sort(key=lambda kept: kept.order)

    def _worth(self, kept: _Kept, view: PreprocessedFrame, for_response: bool) -> float:
        age = self._age_class(kept.order)
        change = min(abs(kept.view.log_exposure - view.log_exposure), self.max_log_ratio)
        gain = change**2 if for_response else self._motion[age] ** 2 + 0.01 * change**2
        return float((gain + 1e-6) * self._overlap[age] ** 1.5 / (1 + kept.uses))

    def _age_class(self, order: int) -> int:
        return min(int(2 * np.log2(max(self._seen - order, 1))), _AGES - 1)
