"""Advise what to film next: one instruction at a time, derived from the information matrix so far."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from ospc.live.knowledge import Knowledge, certainty, knowledge_of
from ospc.methods.preview import Preview
from ospc.photometry.calibration import Calibration
from ospc.settings.live import (
    BETTER_GAIN_RATIO,
    BRIGHT_GREY,
    DARK_GREY,
    EXPOSURE_STEP,
    FEW_POINTS,
    FOLLOWED_GAIN_SHARE,
    GOAL,
    HOLD_S,
    LATEST_PAIRS,
    MIN_CAPTURED_PAIRS,
    MIN_LOG_EXPOSURE_RANGE,
    OUTER_RADIUS,
    PATIENCE_S,
    SET_ASIDE_S,
    SHOWN_GREYS,
    TARGET_GREYS,
    TARGET_RADII,
    TYPICAL_GREY,
)

Kind = Literal["begin", "unusable", "slower", "move", "bright", "dark", "vary", "exposures", "done"]

_CHOSEN = ("move", "bright", "dark", "vary")
"""Kinds that are chosen by their gain."""

_CORNERS = {(-1, -1): "upper left", (1, -1): "upper right", (-1, 1): "lower left", (1, 1): "lower right"}
_TURNS = {(-1, -1): "right and down", (1, -1): "left and down", (-1, 1): "right and up", (1, 1): "left and up"}
"""Directions in which to turn the camera for the scene to move to each corner."""


@dataclass(frozen=True)
class Instruction:
    """What to do next, and why.

    Attributes
    ----------
    kind, text
        Kind of instruction, and one or two sentences for the person holding the camera.
    part
        What it improves: "response" or "vignette"; empty for both.
    greys
        Range of grey levels at which to measure the response; None if not applicable.
    radii
        Radii in half diagonals between which points should move; None if not applicable.
    arrow
        Start and end of the motion in the image, (x, y) as fractions of width and height; None if not applicable.
    exposure
        1 if the exposure should become longer, -1 if shorter, 0 if not applicable.
    response_sigma, vignette_sigma
        Standard deviations of g and V as root mean squares over grey levels and radii; None before the first
        estimate.
    """

    kind: Kind
    text: str
    part: str = ""
    greys: tuple[float, float] | None = None
    radii: tuple[float, float] | None = None
    arrow: tuple[tuple[float, float], tuple[float, float]] | None = None
    exposure: int = 0
    response_sigma: float | None = None
    vignette_sigma: float | None = None


class _Option(NamedTuple):
    """An instruction, and the gain from following it for one pair of frames."""

    instruction: Instruction
    gain: float


_BEGIN = Instruction("begin", "Film something with texture and plain surfaces, and turn the camera slowly.")
_SLOWER = Instruction(
    "slower", "Move more slowly, and film something with more texture: too few points can be tracked."
)
_VARY = Instruction(
    "vary",
    "Turn back and forth between something bright and something dark, so that the exposure changes; if it does not, "
    "switch on auto exposure or change it by hand.",
    "response",
)
_BRIGHTER = Instruction(
    "bright",
    "Film something bright and plain, such as a well-lit wall, door or sheet of paper, and turn slowly towards "
    "something darker while it stays in view: it should become almost white.",
    "response",
    exposure=1,
)
_DARKER = Instruction(
    "dark",
    "Film something dark and plain, and turn slowly towards a window or a lamp while it stays in view: it should "
    "become almost black.",
    "response",
    exposure=-1,
)
"""Instructions for brighter and darker scenes; their grey levels are filled in when they are chosen."""


class Adviser:
    """Chooses the current instruction, and keeps it long enough to be followed.

    Parameters
    ----------
    goal
        Root mean square standard deviation at which g and V count as known.

    Attributes
    ----------
    instruction, expects_end
        The current instruction, and whether quick estimates indicate that the goal is reached.
    """

    def __init__(self, goal: float = GOAL) -> None:
        self.instruction = _BEGIN
        self.expects_end = False
        self._goal = goal
        self._since_s = -np.inf
        self._first_gain = 0.0
        self._set_aside: dict[Kind, float] = {}
        self._found: deque[tuple[int, int]] = deque()

    def look(
        self, preview: Preview | None, time_s: float, known: Calibration | None = None, unusable: str = ""
    ) -> Instruction:
        """Update the instruction from a preview at a time in seconds (of any origin), and return it.

        Only ``known``, the latest complete estimate, can show that the goal is reached. ``unusable`` is the reason
        why most of the latest frames cannot be used; empty if they can.
        """
        self.expects_end = False
        urgent = self._urgent(preview, known, unusable)
        if urgent is not None:
            return self._switched(urgent, time_s)
        knowledge = knowledge_of(preview)
        if preview is None or knowledge is None:
            return self._switched(_BEGIN if preview is None or _exposure_varies(preview) else _VARY, time_s)
        if max(knowledge.response_sigma, knowledge.vignette_sigma) <= self._goal:
            self.expects_end = True
            if known is not None:
                knowledge = knowledge.corrected(*certainty(known))
        self._choose({o.instruction.kind: o for o in _options(preview, knowledge, self._goal)}, time_s)
        self.instruction = replace(
            self.instruction, response_sigma=knowledge.response_sigma, vignette_sigma=knowledge.vignette_sigma
        )
        return self.instruction

    def _urgent(self, preview: Preview | None, known: Calibration | None, unusable: str) -> Instruction | None:
        """Return the instruction that overrides all others, if any."""
        if known is not None:
            response, vignette = certainty(known)
            enough = known.converged and known.counts.get("pairs", 0) >= MIN_CAPTURED_PAIRS
            if enough and response is not None and vignette is not None and max(response, vignette) <= self._goal:
                text = f"Done: response and vignette are known to ±{self._goal:g}."
                return Instruction("done", text, response_sigma=response, vignette_sigma=vignette)
        if unusable:
            return Instruction("unusable", f"Most of the latest frames cannot be used. {unusable}")
        if known is not None:
            exposures = known.verdicts.get("exposures")
            if exposures is not None and exposures.state == "not identifiable":
                # The frames so far keep their wrong exposures.
                return Instruction("exposures", f"{exposures.remedy or exposures.reason}; then start again")
        return _SLOWER if preview is not None and self._finds_little(preview) else None

    def _finds_little(self, preview: Preview) -> bool:
        """Return whether the latest pairs of frames have too few scene points."""
        points = len(preview.observations.starts)
        if self._found and points < self._found[-1][1]:
            self._found.clear()  # some were dropped to save memory
        if not self._found or preview.pairs != self._found[-1][0]:
            self._found.append((preview.pairs, points))
        while len(self._found) > 2 and self._found[1][0] <= preview.pairs - LATEST_PAIRS:
            self._found.popleft()
        pairs, before = self._found[0]
        return preview.pairs - pairs >= LATEST_PAIRS and points - before < FEW_POINTS * (preview.pairs - pairs)

    def _choose(self, options: dict[Kind, _Option], time_s: float) -> None:
        self._set_aside = {kind: until for kind, until in self._set_aside.items() if until > time_s}
        present = options.get(self.instruction.kind)
        if self.instruction.kind in _CHOSEN and time_s - self._since_s < HOLD_S:
            return
        if present is not None and time_s - self._since_s > PATIENCE_S:
            if present.gain > FOLLOWED_GAIN_SHARE * self._first_gain:
                self._set_aside[self.instruction.kind] = time_s + SET_ASIDE_S
            self._since_s, self._first_gain = time_s, present.gain
        free = [option for kind, option in options.items() if kind not in self._set_aside] or [*options.values()]
        best = max(free, key=lambda option: option.gain)
        if present is not None and present in free and best.gain < BETTER_GAIN_RATIO * present.gain:
            best = present
        self._switched(best.instruction, time_s, best.gain)

    def _switched(self, instruction: Instruction, time_s: float, gain: float = 0.0) -> Instruction:
        if instruction.kind != self.instruction.kind:
            self._since_s, self._first_gain = time_s, gain
        self.instruction = instruction
        return instruction


def _exposure_varies(preview: Preview) -> bool:
    low, high = np.log(preview.coverage.exposure_edges_ms[[0, -1]])
    return bool(high - low >= MIN_LOG_EXPOSURE_RANGE)


def _options(preview: Preview, knowledge: Knowledge, goal: float) -> Iterator[_Option]:
    longer = [knowledge.gain_of_exposure(m, knowledge.grey_after(m, EXPOSURE_STEP), goal) for m in TARGET_GREYS]
    shorter = [knowledge.gain_of_exposure(m, knowledge.grey_after(m, 1 / EXPOSURE_STEP), goal) for m in TARGET_GREYS]
    gains = np.maximum(longer, shorter)
    if not _exposure_varies(preview):
        yield _Option(_VARY, float(gains.max()))
    else:
        for instruction, inside in ((_BRIGHTER, TARGET_GREYS > BRIGHT_GREY), (_DARKER, TARGET_GREYS < DARK_GREY)):
            at = int(np.argmax(np.where(inside, gains, -1.0)))
            target = float(TARGET_GREYS[at])
            greys = max(target - SHOWN_GREYS, 0.0), min(target + SHOWN_GREYS, 1.0)
            yield _Option(replace(instruction, greys=greys), float(gains[at]))
        middle = (TARGET_GREYS >= DARK_GREY) & (TARGET_GREYS <= BRIGHT_GREY)
        yield _Option(_VARY, float(gains[middle].max()))
    scale = min(1.0, knowledge.fit.vignette_basis.usable_radius / TARGET_RADII[-1])
    ways = [(scale * a, scale * b) for a in TARGET_RADII for b in TARGET_RADII if b > a]
    gains_of_motion = [knowledge.gain_of_motion(*radii, TYPICAL_GREY, goal) for radii in ways]
    best = int(np.argmax(gains_of_motion))
    yield _Option(_motion(*ways[best], _least_seen_corner(preview)), gains_of_motion[best])


def _motion(radius0: float, radius1: float, corner: tuple[int, int]) -> Instruction:
    target = "what is in the middle" if radius0 < TARGET_RADII[1] else "something plain near the middle"
    way = "" if radius1 >= TARGET_RADII[-1] else f"{radius1:.0%} of the way "
    text = (
        f"Turn the camera slowly to the {_TURNS[corner]} until {target} has moved {way}to the {_CORNERS[corner]} "
        "corner of the picture."
    )
    ends = tuple((0.5 + 0.5 * corner[0] * radius, 0.5 + 0.5 * corner[1] * radius) for radius in (radius0, radius1))
    return Instruction("move", text, "vignette", radii=(radius0, radius1), arrow=(ends[0], ends[1]))


def _least_seen_corner(preview: Preview) -> tuple[int, int]:
    places = preview.observations.position
    outer = places[np.hypot(*places.T) > OUTER_RADIUS]
    return min(_CORNERS, key=lambda corner: int(np.sum((outer * corner > 0).all(axis=1))))
