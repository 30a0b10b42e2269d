"""All that is known of one camera, from however many recordings: a set of summaries, one of each recording.

Pools are added by taking the union. So addition is associative and commutative, a recording added twice counts once,
and whatever is computed of a pool takes its recordings in the order of their keys: the same bits in any order.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from ospc.arrays import ImageSize
from ospc.errors import FormatError, SettingError
from ospc.methods.maximum_likelihood import MaximumLikelihoodMethod
from ospc.methods.maximum_likelihood_state import MaximumLikelihoodState
from ospc.pooling.summary import Summary, summary_of
from ospc.settings import DefaultSettings, preset, with_overrides
from ospc.state import container
from ospc.state.container import Container
from ospc.state.run import KIND as RUN_KIND
from ospc.state.run import SavedRun, load_run
from ospc.state.values import pack, unpack

KIND, VERSION = "pool", 1
"""What files say they hold."""


@dataclass(frozen=True)
class Pool:
    """Summaries of different recordings of one camera; make one with :meth:`of`.

    Attributes
    ----------
    summaries
        One of each recording, in the order of their keys.
    """

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
        """Return what both know together.

        Raises
        ------
        SettingError
            If their frames differ in size or bit depth.
        """
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
            place = place / "state.ospc"
        if container.kind_of(place) == RUN_KIND:
            return cls((_summary_of_run(load_run(place)),))
        found = container.load(place, KIND, VERSION)
        try:
            return cls.of(unpack(cls, found.content, found.arrays).summaries)
        except (FormatError, SettingError) as error:
            raise FormatError(f"{place}: not readable as a state, {error}") from None


def _check_alike(one: Summary, other: Summary) -> None:
    for what, first, second in (
        ("pixels", f"{one.size[0]}×{one.size[1]}", f"{other.size[0]}×{other.size[1]}"),
        ("for white", str(one.max_grey), str(other.max_grey)),
    ):
        if first != second:
            raise SettingError(
                f"{one.name} has {first} {what}, {other.name} {second}: they are not recordings of one camera in one "
                "mode; merge those of each by themselves"
            )


def _summary_of_run(saved: SavedRun) -> Summary:
    found = saved.summary(Summary)
    if found is None:
        found = _summary_of_checkpoint(saved)
    if found is None:
        raise FormatError(f"{saved.name}: nothing could be learned of this recording, so there is nothing to merge")
    return found


def _summary_of_checkpoint(saved: SavedRun) -> Summary | None:
    """Return the summary of a run that was stopped before its end, which has none with it yet."""
    run, state = saved.run, saved.method(MaximumLikelihoodState)
    if state is None:
        return None
    try:
        values = {name: str(value) for name, value in run.settings.items() if name != "preset"}
        settings = with_overrides(preset(str(run.settings.get("preset"))), values)
        if not isinstance(settings, DefaultSettings):
            raise SettingError(f"preset {settings.name} has no state")
        method = MaximumLikelihoodMethod.from_state(settings, run.size, run.max_grey, state)
    except (SettingError, ValueError) as error:
        raise FormatError(f"{saved.name}: was made by another version of this program ({error})") from None
    return summary_of(method.evidence(), run.first_frames[0], run.source, run.frames)
