"""A bounded random sample of all observations."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ospc.observations import Observations, concatenate


@dataclass
class Reservoir:
    """Keeps every scene point until there are too many, then half of them, and so on; old and new ones alike.

    Attributes
    ----------
    capacity
        Most scene points kept.
    """

    capacity: int
    _parts: list[Observations] = field(default_factory=list, repr=False)
    _halvings: int = 0
    points: int = 0

    def add(self, observations: Observations) -> None:
        """Add the observations of new scene points."""
        for halving in range(self._halvings):
            observations = _halved(observations, halving)
        self._append(observations)
        while self.points > self.capacity:
            parts, self._parts, self.points = self._parts, [], 0
            for part in parts:
                self._append(_halved(part, self._halvings))
            self._halvings += 1

    def forget_before(self, group: int) -> None:
        """Drop the observations of groups with lower numbers."""
        self._parts = [part for part in self._parts if part.group[0] >= group]
        self.points = sum(len(part.starts) for part in self._parts)

    def split(self, frame: int) -> tuple[Reservoir, int]:
        """Move the groups whose frames all have this number or a higher one to a new reservoir.

        Groups across that frame are dropped. Groups in the new reservoir are numbered from 0.

        Returns
        -------
        tuple of Reservoir and int
            The new reservoir, and the number of its groups.
        """
        later = [part for part in self._parts if part.frame.min() >= frame]
        self._parts = [part for part in self._parts if part.frame.max() < frame]
        self.points = sum(len(part.starts) for part in self._parts)
        moved = Reservoir(self.capacity, _halvings=self._halvings)
        for number, part in enumerate(later):
            moved._append(replace(part, group=np.full_like(part.group, number)))
        return moved, len(later)

    def all(self) -> Observations:
        """Return all that is kept.

        Raises
        ------
        ValueError
            If nothing was ever added.
        """
        if not self._parts:
            raise ValueError("nothing was added")
        return concatenate(self._parts)

    def some(self, points: int) -> Observations:
        """Return at most about so many scene points, spread evenly over all that are kept."""
        everything = self.all()
        step = max(1, -(-self.points // points))
        return everything.of_points(slice(None, None, step))

    def _append(self, part: Observations) -> None:
        if len(part):
            self._parts.append(part)
            self.points += len(part.starts)


def _halved(part: Observations, halving: int) -> Observations:
    """Return about half of the points; which half is drawn anew, but reproducibly, at every halving."""
    if not len(part):
        return part
    chosen = np.random.default_rng([int(part.group[0]), halving]).random(len(part.starts)) < 0.5
    return part.of_points(chosen)
