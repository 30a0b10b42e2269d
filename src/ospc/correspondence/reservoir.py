"""A bounded random sample of all observations."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ospc.observations import Observations

_FIELDS = tuple(entry.name for entry in fields(Observations))


@dataclass
class Reservoir:
    """Keeps every scene point up to a limit, then repeatedly half of them, old and new ones equally.

    Groups that are added later must have higher numbers.
    """

    capacity: int
    """Maximum number of scene points kept."""
    kept: Observations | None = None
    """Their observations, None without any. These arrays never change: later groups are written behind them."""
    _halvings: int = 0

    def __post_init__(self) -> None:
        """Start with arrays without spare room."""
        self._columns: dict[str, npt.NDArray[Any]] = {}
        self._keep(self.kept)

    def add(self, observations: Observations) -> None:
        """Add the observations of new scene points."""
        for halving in range(self._halvings):
            observations = _halved(observations, halving)
        if len(observations):
            self._append(observations)
        while self.kept is not None and self.points > self.capacity:
            self._keep(_halved(self.kept, self._halvings))
            self._halvings += 1

    def forget_before(self, group: int) -> None:
        """Drop the observations of groups with lower numbers; their memory is freed when the arrays grow."""
        if self.kept is not None:
            first = int(np.searchsorted(self.kept.group, group))
            self._columns = {name: column[first:] for name, column in self._columns.items()}
            self._show(len(self.kept) - first)

    def forget_above(self, grey: float) -> None:
        """Drop the scene points that were observed above a grey level in any frame."""
        if self.kept is not None:
            self._keep(self.kept.of_points(self.kept.combined(np.maximum, self.kept.grey) <= grey))

    @property
    def points(self) -> int:
        """Number of scene points kept."""
        kept = self.kept  # read once: another thread may set it to None
        return 0 if kept is None else len(kept.starts)

    def groups_before(self, frame: int, groups: int) -> int:
        """Return how many of all ``groups`` come before the first that has this frame or a later one."""
        if self.kept is None:
            return groups
        return int(self.kept.group[self.kept.frame >= frame].min(initial=groups))

    def since(self, frame: int) -> tuple[Reservoir, int]:
        """Return a reservoir of the groups whose frames all have this number or a higher one, and their number.

        They are renumbered from 0.
        """
        if self.kept is None:
            return Reservoir(self.capacity), 0
        begins = np.flatnonzero(np.diff(self.kept.group, prepend=-1))
        lengths = np.diff(begins, append=len(self.kept))
        later = self.kept.where(np.repeat(np.minimum.reduceat(self.kept.frame, begins) >= frame, lengths))
        groups, number = np.unique(later.group, return_inverse=True)
        return Reservoir(self.capacity, replace(later, group=number)), len(groups)

    def some(self, points: int) -> Observations:
        """Return about ``points`` scene points at most, spread evenly over all that are kept, at least one."""
        assert self.kept is not None
        return self.kept.of_points(slice(None, None, max(1, -(-self.points // points))))

    def _append(self, added: Observations) -> None:
        """Append observations with new point numbers."""
        rows, next_point = (0, 0) if self.kept is None else (len(self.kept), int(self.kept.point[-1]) + 1)
        numbered = replace(added, point=added.point - added.point[0] + next_point)
        for name in _FIELDS:
            self._columns[name] = _with_rows(self._columns.get(name), rows, getattr(numbered, name))
        self._show(rows + len(added))

    def _keep(self, observations: Observations | None) -> None:
        """Keep only these observations."""
        self.kept = observations if observations else None
        self._columns = {name: getattr(observations, name) for name in _FIELDS} if observations else {}

    def _show(self, rows: int) -> None:
        """Make the first rows of the columns the kept observations."""
        self.kept = Observations(**{name: column[:rows] for name, column in self._columns.items()}) if rows else None


def _with_rows(column: npt.NDArray[Any] | None, rows: int, added: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return a column with values after its first rows, in the same memory or in new memory half as large again."""
    needed = rows + len(added)
    if column is None or needed > len(column):
        larger = np.empty((needed * 3 // 2, *added.shape[1:]), added.dtype)
        if column is not None:
            larger[:rows] = column[:rows]
        column = larger
    column[rows:needed] = added
    return column


def _halved(part: Observations, halving: int) -> Observations:
    """Return about half of the points of each group; the random choice is reproducible for each halving."""
    groups = np.unique(part.group[part.starts], return_counts=True)
    drawn = [np.random.default_rng([group, halving]).random(count) for group, count in zip(*groups, strict=True)]
    return part.of_points(np.concatenate(drawn) < 0.5) if drawn else part
