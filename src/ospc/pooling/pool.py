"""All that is known of one camera, from however many recordings: a set of summaries, one of each recording.

Pools are added by taking the union, so that the order does not matter and a recording added twice counts once.
Results are computed in the order of the recordings' keys, which makes them the same to the last bit.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from ospc.arrays import ImageSize
from ospc.errors import FormatError, SettingError
from ospc.pooling.summary import Summary
from ospc.state import container
from ospc.state.container import STATE_NAME, Container
from ospc.state.run import KIND as RUN_KIND
from ospc.state.run import load_summary
from ospc.state.values import pack, unpack

KIND, VERSION = "pool", 5
"""What files say they hold."""


@dataclass(frozen=True)
class Pool:
    """Summaries of different recordings of one camera, in the order of their keys; make one with :meth:`of`."""

    summaries: tuple[Summary, ...] = ()

    @classmethod
    def of(cls, summaries: Iterable[Summary]) -> Pool:
        """Return the pool of summaries in any order; of two of the same recording the one of more frames is kept.

        Raises
        ------
        SettingError
            If their frames differ in size or bit depth.
        """
        kept: dict[str, Summary] = {}
        for summary in summaries:
            other = kept.get(summary.key)
            if other is None or summary.rank > other.rank:
                kept[summary.key] = summary
        ordered = tuple(kept[key] for key in sorted(kept))
        for summary in ordered[1:]:
            _check_alike(ordered[0], summary)
        return cls(ordered)

    def __add__(self, other: Pool) -> Pool:
        """Return the union of both."""
        return Pool.of((*self.summaries, *other.summaries))

    def __len__(self) -> int:
        """Return the number of recordings."""
        return len(self.summaries)

    @property
    def size(self) -> ImageSize:
        """Width and height of the frames in pixels; (0, 0) of no recordings."""
        return self.summaries[0].size if self.summaries else (0, 0)

    @property
    def max_grey(self) -> int:
        """Largest grey value of the frames; 0 of no recordings."""
        return self.summaries[0].max_grey if self.summaries else 0

    def save(self, path: str | Path) -> Path:
        """Write the pool, whole or not at all, and return the path; equal pools give equal files.

        Raises
        ------
        FormatError
            If it cannot be written; an earlier file is unchanged then.
        """
        content, arrays = pack(self)
        return container.save(Container(KIND, VERSION, content, arrays), path)

    @classmethod
    def load(cls, path: str | Path) -> Pool:
        """Read a pool that :meth:`save` wrote, or the state of one recording, alone or in its output folder.

        Raises
        ------
        FormatError
            If there is no such file, it is torn or damaged, another version wrote it, or nothing could be learned
            of the recording.
        """
        place = Path(path)
        if place.is_dir():
            place = place / STATE_NAME
        if container.kind_of(place) == RUN_KIND:
            summary = load_summary(place, Summary)
            if summary is None:
                raise FormatError(
                    f"{place}: nothing could be learned from this recording, or its run did not end: finish it "
                    "with ospc calibrate --resume"
                )
            return cls((summary,))
        found = container.load(place, KIND, VERSION)
        try:
            return cls.of(unpack(cls, found.content, found.arrays).summaries)
        except (FormatError, SettingError) as error:
            raise FormatError(f"{place}: not readable as a state, {error}") from None


def _check_alike(one: Summary, other: Summary) -> None:
    for what, first, second in (
        ("pixels", f"{one.size[0]}×{one.size[1]}", f"{other.size[0]}×{other.size[1]}"),
        ("for white", str(one.max_grey), str(other.max_grey)),
        ("as the range of grey values", str(one.grey_range), str(other.grey_range)),
    ):
        if first != second:
            raise SettingError(
                f"{one.name} has {first} {what}, {other.name} {second}: they are not recordings of one camera in one "
                "mode; merge those of each by themselves"
            )
