"""A bounded random sample of all observations."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ospc.observations import Observations, concatenate

_MOST_PARTS = 64
"""Additions kept apart before they are joined: late in a run each has a point or two left, and its ten arrays take
kilobytes. Joining them after each addition would take longer."""


@dataclass
class Reservoir:
    """Keeps every scene point until there are too many, then half of them, and so on; old and new ones alike.

    Groups that are added later have higher numbers.
    """

    capacity: int
    """Most scene points kept."""
    _parts: list[Observations] = field(default_factory=list, repr=False)
    _halvings: int = 0
    points: int = 0

    def add(self, observations: Observations) -> None:
        """Add the observations of new scene points."""
        for halving in range(self._halvings):
            observations = _halved(observations, halving)
        self._append(observations)
        while self.points > self.capacity:
            self._keep([_halved(part, self._halvings) for part in self._parts])
            self._halvings += 1

    def forget_before(self, group: int) -> None:
        """Drop the observations of groups with lower numbers."""
        self._keep([part.where(part.group >= group) for part in self._parts])

    @property
    def latest_group(self) -> int:
        """Number of the latest group of which something is kept, -1 where nothing is."""
        return max((int(part.group.max()) for part in self._parts), default=-1)

    def split(self, frame: int) -> tuple[Reservoir, int]:
        """Move the groups whose frames all have this number or a higher one to a new reservoir.

        Return it and the number of its groups, which are numbered from 0 there. Groups across that frame are dropped.
        """
        moved = Reservoir(self.capacity)
        if not self._parts:
            return moved, 0
        everything = self.all()
        begins = np.flatnonzero(np.diff(everything.group, prepend=-1))
        lengths = np.diff(begins, append=len(everything))
        after = np.repeat(np.minimum.reduceat(everything.frame, begins) >= frame, lengths)
        before = np.repeat(np.maximum.reduceat(everything.frame, begins) < frame, lengths)
        later = everything.where(after)
        groups, number = np.unique(later.group, return_inverse=True)
        moved._append(replace(later, group=number))
        self._keep([everything.where(before)])
        return moved, len(groups)

    def all(self) -> Observations:
        """Return all that is kept; raise a ValueError if nothing was ever added."""
        if not self._parts:
            raise ValueError("nothing was added")
        self._join()
        return self._parts[0]

    def some(self, points: int) -> Observations:
        """Return at most about so many scene points, spread evenly over all that are kept."""
        return self.all().of_points(slice(None, None, max(1, -(-self.points // points))))

    def _append(self, part: Observations) -> None:
        if len(part):
            self._parts.append(part)
            self.points += len(part.starts)
        if len(self._parts) > _MOST_PARTS:
            self._join()

    def _join(self) -> None:
        """Keep one part instead of several: beside them, it would take as much memory again."""
        if len(self._parts) > 1:
            self._parts = [concatenate(self._parts)]

    def _keep(self, parts: list[Observations]) -> None:
        """Keep only these."""
        self._parts, self.points = [], 0
        for part in parts:
            self._append(part)


def _halved(part: Observations, halving: int) -> Observations:
    """Return about half of the points of each group, drawn anew, but reproducibly, at every halving."""
    if not len(part):
        return part
    groups = np.unique(part.group[part.starts], return_counts=True)
    drawn = [np.random.default_rng([group, halving]).random(count) for group, count in zip(*groups, strict=True)]
    return part.of_points(np.concatenate(drawn) < 0.5)
