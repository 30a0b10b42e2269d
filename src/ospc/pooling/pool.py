"""Pools: the summaries of any number of recordings of one camera, and the calibration that they give together.

Adding pools takes their union, so the order does not matter, and a recording added twice counts once. Results are
computed in the order of the recordings' keys, which makes them reproducible to the last bit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from ospc.arrays import ByValue, ImageSize
from ospc.errors import FormatError, SettingError
from ospc.methods.result import covariance_of, vignette_sigma
from ospc.photometry.calibration import Calibration
from ospc.pooling.agreement import Agreement, Difference, Part, agreement
from ospc.pooling.solution import Information, solve_with_chosen_vignette
from ospc.pooling.summary import PARAMETERS, VIGNETTE_PART, Summary, joint_range, triangle_of
from ospc.pooling.verdicts import judged, response_verdict_of, used_of, vignette_verdict_of
from ospc.settings.pooling import FREE_PRECISION
from ospc.state import container
from ospc.state.container import Container
from ospc.state.run import KIND as RUN_KIND
from ospc.state.run import load_summary
from ospc.state.values import pack, unpack
from ospc.system.versions import versions

KIND, VERSION = "pool", 10
"""Kind and version that pool files declare."""


@dataclass(frozen=True, eq=False)
class Pool(ByValue):
    """Summaries of different recordings of one camera, in the order of their keys; create one with :meth:`of`."""

    summaries: tuple[Summary, ...] = ()

    @classmethod
    def of(cls, summaries: Iterable[Summary]) -> Pool:
        """Return the pool of summaries in any order; of two for the same recording, the one with more frames is kept.

        Raises
        ------
        SettingError
            If their frames differ in size, bit depth, or range of grey values.
        """
        kept: dict[str, Summary] = {}
        for summary in summaries:
            other = kept.get(summary.key)
            if other is None or summary.rank > other.rank:
                kept[summary.key] = summary
        ordered = tuple(kept[key] for key in sorted(kept))
        for summary in ordered[1:]:
            if unlike := why_unlike(ordered[0], summary):
                raise SettingError(
                    f"{unlike}: they are not recordings of one camera in one mode; merge those of each camera and "
                    "mode separately"
                )
        return cls(ordered)

    def __add__(self, other: Pool) -> Pool:
        """Return the union of both pools."""
        return Pool.of((*self.summaries, *other.summaries))

    def __len__(self) -> int:
        """Return the number of recordings."""
        return len(self.summaries)

    @property
    def size(self) -> ImageSize:
        """Width and height of the frames in pixels; (0, 0) for an empty pool."""
        return self.summaries[0].size if self.summaries else (0, 0)

    @property
    def max_grey(self) -> int:
        """Largest grey value of the frames; 0 for an empty pool."""
        return self.summaries[0].max_grey if self.summaries else 0

    def save(self, path: str | Path) -> Path:
        """Write the pool atomically, and return the path; equal pools give equal files.

        Raises
        ------
        FormatError
            If it cannot be written; an existing file then stays unchanged.
        """
        content, arrays = pack(self)
        return container.save(Container(KIND, VERSION, content, arrays), path)

    @classmethod
    def load(cls, path: str | Path) -> Pool:
        """Read a pool written by :meth:`save`, or the state of one recording: the file or its output folder.

        Raises
        ------
        FormatError
            If the file does not exist, is truncated or damaged, or is of another version, or if nothing could be
            learned from the recording.
        """
        place = container.state_in(path)
        if container.kind_of(place) == RUN_KIND:
            summary = load_summary(place, Summary)
            if summary is None:
                raise FormatError(
                    f"{place}: nothing could be learned from this recording, or its run is unfinished: finish it "
                    "with ospc calibrate --resume, or use its frames so far with ospc merge"
                )
            return cls((summary,))
        found = container.load(place, KIND, VERSION)
        try:
            return cls.of(unpack(cls, found.content, found.arrays, str(place)).summaries)
        except SettingError as error:
            raise FormatError(f"{place}: not readable as a state, {error}") from None


def why_unlike(one: Summary, other: Summary) -> str:
    """Return why two recordings cannot be of one camera in one mode; empty if they can."""
    if one.size != other.size:
        what, (first, second) = "pixels", (f"{s.size[0]}×{s.size[1]}" for s in (one, other))
    elif one.max_grey != other.max_grey:
        what, first, second = "for white", str(one.max_grey), str(other.max_grey)
    elif not one.grey_range.resembles(other.grey_range):
        what, (first, second) = "for black and white", (s.grey_range.in_words(s.max_grey) for s in (one, other))
    else:
        return ""
    return f"{one.name} has {first} {what}, {other.name} {second}"


def largest_alike(summaries: Iterable[Summary]) -> tuple[Pool, tuple[Difference, ...]]:
    """Return the largest pool of recordings of one size and range of grey values, and how the others differ."""
    every = list(summaries)
    # A pool compares its recordings with that of the smallest key: likeness within a tolerance is not transitive.
    groups = [[other for other in every if other.key >= one.key and not why_unlike(one, other)] for one in every]
    largest = max(groups, key=len, default=[])
    others = [summary for summary in every if all(summary is not kept for kept in largest)]
    both: tuple[Part, ...] = ("response", "vignette")
    return Pool.of(largest), tuple(
        Difference(other.key, other.name, both, math.inf, f"another camera or mode: {why_unlike(other, largest[0])}")
        for other in others
    )


@dataclass(frozen=True)
class Merged:
    """The joint calibration of a pool, without parts on which no majority agrees, and the recordings that differ."""

    calibration: Calibration
    agreement: Agreement


def merge(pool: Pool, *, counts_recordings: bool = True) -> Merged:
    """Return the calibration of a pool; recordings that differ from the majority are excluded and named.

    A recording that differs only in the vignette still contributes to the response. With ``counts_recordings``, the
    verdicts state how many recordings they are based on.

    Raises
    ------
    SettingError
        If the pool is empty.
    """
    if not len(pool):
        raise SettingError("there is nothing to merge: give at least one state")
    agreed = agreement(pool.summaries)
    used = agreeing(pool, agreed)
    fit = solve_with_chosen_vignette(Information.of(used, usable_radius(used)))
    judged_part = partial(judged, agreed, recordings=len(pool), counts=counts_recordings)
    verdicts = {
        "response": judged_part("response", response_verdict_of(fit, used)),
        "vignette": judged_part("vignette", vignette_verdict_of(fit, used, pool.size)),
    }
    response, vignette = verdicts["response"].known, verdicts["vignette"].known
    support = joint_range(s.support for s in used) if used else (0.0, 1.0)
    names = sorted(s.name for s in pool.summaries)
    calibration = Calibration(
        size=pool.size,
        response=fit.response(pool.max_grey, support, used[0].grey_range) if response else None,
        vignette=fit.usable_vignette(pool.size) if vignette else None,
        verdicts=verdicts,
        vignette_sigma=vignette_sigma(fit, pool.size) if vignette else None,
        # From the recording with the most scene points.
        noise=max(used, key=lambda s: (s.points, s.key)).noise if used else None,
        covariance=covariance_of(fit, response, vignette),
        max_grey=pool.max_grey,
        converged=all(verdict.state == "identifiable" for verdict in verdicts.values()),
        counts={
            "recordings": len(used),
            "differing": len(agreed.differing),
            "frames": sum(s.frames for s in used),
            "pairs": sum(s.pairs for s in used),
            "samples": sum(s.points for s in used),
        },
        settings={"preset": "pooled", "scatter": agreed.scatter},
        source={
            "kind": "pool",
            "name": names[0] if len(names) == 1 else used_of(len(used), len(names)),
            "recordings": [{"name": s.name, "key": s.key} for s in pool.summaries],
            "differing": [{"name": d.name, "key": d.key, "text": d.text} for d in agreed.differing.values()],
        },
        versions=versions(),
        advice=tuple(dict.fromkeys(verdict.remedy for verdict in verdicts.values() if verdict.remedy)),
    )
    return Merged(calibration, agreed)


def agreeing(pool: Pool, agreed: Agreement) -> list[Summary]:
    """Return summaries of what the recordings of a pool agree on.

    Recordings whose response differs are excluded; without a majority on the response, all are. If the vignette
    differs, or no majority agrees on it, a recording contributes only to the response. The systematic errors include
    the scatter between the recordings.
    """
    if not agreed.majority["response"]:
        return []
    used = [summary for summary in pool.summaries if not agreed.differs(summary, "response")]
    alone = [agreed.differs(summary, "vignette") or not agreed.majority["vignette"] for summary in used]
    return [
        agreed.with_scatter(_response_alone(s) if is_alone else s) for s, is_alone in zip(used, alone, strict=True)
    ]


def usable_radius(used: Sequence[Summary]) -> float:
    """Return the radius, in half diagonals, up to which agreeing recordings determine the vignette.

    This is the smallest of their usable radii within which all observations are. A smaller one is that of a mask,
    which hides what other recordings show; a larger one is that of a recording too dark or too short to show where a
    fisheye's image ends.
    """
    moving = [summary for summary in used if not summary.stationary]
    observed = max((s.observed_radius for s in moving), default=0.0)
    largest = max((s.usable_radius for s in moving), default=1.0)
    return min((s.usable_radius for s in moving if s.usable_radius >= observed), default=largest)


def _response_alone(summary: Summary) -> Summary:
    """Return a recording's information on the response, with its own vignette marginalised."""
    n, p, whole = VIGNETTE_PART.start, PARAMETERS, summary.matrix
    # A wide prior, centred on the recording's own estimate, leaves the vignette free.
    free = FREE_PRECISION * np.eye(p - n)
    carried = np.linalg.solve(whole[n:, n:] + free, whole[n:, :n])
    reduced = np.concatenate([np.eye(n), -carried.T], axis=1)
    matrix, vector, systematic = np.zeros((p, p)), np.zeros(p), np.zeros((p, p))
    matrix[:n, :n] = whole[:n, :n] - whole[:n, n:] @ carried
    vector[:n] = summary.vector[:n] - carried.T @ (summary.vector[n:] + free @ summary.estimate[n:])
    systematic[:n, :n] = reduced @ summary.systematic_matrix @ reduced.T
    return replace(
        summary,
        triangle=triangle_of(matrix),
        vector=vector,
        systematic=triangle_of(systematic),
        stationary=True,
        radial_motion=0.0,
    )
