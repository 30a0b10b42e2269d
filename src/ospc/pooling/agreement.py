"""Check whether recordings show the same camera in the same state, and how any others differ.

The curves of each recording are compared with the joint curves of the others at a few grey levels and image points.
Differences are divided by the standard deviation of both; when recordings are merged, also by that of the usual
scatter between recordings of one camera. What recordings that agree differ by beyond their standard deviations is
measured, and widens the result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal

import numpy as np

from ospc.arrays import FloatArray
from ospc.estimation.fit import Fit
from ospc.estimation.prior import START, Prior
from ospc.estimation.vignette_basis import VignetteBasis
from ospc.numerics.symmetric import variances
from ospc.pooling.solution import Information, solve
from ospc.pooling.summary import RESPONSE, RESPONSE_PART, VIGNETTE, VIGNETTE_PART, Summary, triangle_of
from ospc.settings.pooling import (
    ALLOWED_SCATTER,
    COMPARED_DIRECTIONS,
    COMPARED_GREYS,
    COMPARED_RADII,
    DIFFERING_SIGMAS,
    MAX_AGREEMENT_ROUNDS,
    MIN_USUAL_UNEXPLAINED,
    NORMALISING_GREY,
    SCATTER_CHANCE_SIGMAS,
    SUSPICIOUS_FACTOR,
)

Part = Literal["response", "vignette"]

_PLACES: dict[Part, slice] = {"response": slice(0, len(COMPARED_GREYS)), "vignette": slice(len(COMPARED_GREYS), None)}
_PARAMETERS: dict[Part, slice] = {"response": RESPONSE_PART, "vignette": VIGNETTE_PART}
"""Slices of the two parts in the compared values and in the common parameters."""

_MEANING: dict[tuple[Part, ...], str] = {
    ("vignette",): "another lens, or its focus, aperture or zoom changed",
    ("response",): "another tone curve or gain, wrong exposures, or another camera",
    ("response", "vignette"): "another camera, or wrong exposures",
}


@dataclass(frozen=True)
class Difference:
    """How the recording with this key and name differs from the others: in response, vignette or both.

    ``sigmas`` is the largest difference in standard deviations; ``text`` is a sentence with the usual cause.
    """

    key: str
    name: str
    parts: tuple[Part, ...]
    sigmas: float
    text: str


@dataclass(frozen=True)
class Agreement:
    """Which recordings differ, by key, and for each part whether more than half of them agree on it.

    ``scatter`` is, for each part, the standard deviation between agreeing recordings beyond their own, relative to
    that of the prior, which has the same shape: curves of cameras differ least where those of one camera do.
    """

    differing: dict[str, Difference]
    majority: dict[Part, bool]
    scatter: dict[Part, float]

    def differs(self, summary: Summary, part: Part) -> bool:
        """Return whether a recording differs in a part."""
        found = self.differing.get(summary.key)
        return found is not None and part in found.parts

    def with_scatter(self, summary: Summary) -> Summary:
        """Return a summary whose systematic errors include the scatter between the agreeing recordings."""
        if not any(self.scatter.values()):
            return summary
        basis = replace(VIGNETTE, usable_radius=summary.usable_radius, reach=summary.vignette_reach)
        covariance = _prior_covariance(summary.estimate[RESPONSE_PART], basis)
        for part, inside in _PARAMETERS.items():
            covariance[inside, inside] *= self.scatter[part] ** 2
        added = summary.matrix @ covariance @ summary.matrix
        return replace(summary, systematic=triangle_of(summary.systematic_matrix + added))


@dataclass(frozen=True)
class _Curves:
    """ln g and ln V at the compared points, their standard deviations and the prior's, shape (points,) each."""

    value: FloatArray
    sigma: FloatArray
    prior_sigma: FloatArray


def agreement(summaries: Sequence[Summary]) -> Agreement:
    """Return which recordings differ from the majority; all must have the same frame size and bit depth.

    The result does not depend on the order of the summaries.
    """
    ordered = sorted(summaries, key=lambda s: s.key)
    if len(ordered) < 2:
        return Agreement({}, dict.fromkeys(_PLACES, True), dict.fromkeys(_PLACES, 0.0))
    own = [_curves(solve(Information.of([s]))) for s in ordered]
    apart = _differing_from_median(own)
    for _ in range(MAX_AGREEMENT_ROUNDS):
        rest = _joint_curves_of_others(ordered, apart)
        both = zip(own, rest, strict=True)
        before, apart = apart, [_differing_parts(one, other, allowed=True) for one, other in both]
        if [set(a) for a in apart] == [set(a) for a in before]:
            break
    else:
        rest = _joint_curves_of_others(ordered, apart)
    majority = {part: 2 * sum(part in found for found in apart) < len(ordered) for part in _PLACES}
    compared = list(zip(ordered, own, rest, apart, strict=True))
    typical = float(np.median([s.unexplained for s in ordered]))
    differing = {
        s.key: _described(s, found, others, curves, allowed=True, usual=typical)
        for s, curves, others, found in compared
        if found
    }
    return Agreement(differing, majority, _scatter([(c, r) for _, c, r, found in compared if not found]))


def difference_of(one: Summary | None, other: Summary | None) -> Difference | None:
    """Return how one recording differs from earlier ones; None if no difference is significant.

    No scatter is allowed for: if a camera may have changed, the truth is what it is now, not the mean.
    """
    if one is None or other is None:
        return None
    curves, known = (_curves(solve(Information.of([s]))) for s in (one, other))
    found = _differing_parts(curves, known, allowed=False)
    if not found:
        return None
    return _described(one, found, known, curves, allowed=False, usual=other.unexplained, whose="the earlier one")


def _differing_from_median(own: list[_Curves]) -> list[dict[Part, float]]:
    """Return the parts in which each recording is far from the median of all: a robust starting point."""
    values, sigmas = np.stack([c.value for c in own]), np.stack([c.sigma for c in own])
    middle = np.median(values, axis=0)
    of_middle = np.median(sigmas, axis=0) / np.sqrt(len(own))
    return [_differing_parts(c, _Curves(middle, of_middle, c.prior_sigma), allowed=True) for c in own]


def _joint_curves_of_others(summaries: list[Summary], apart: list[dict[Part, float]]) -> list[_Curves]:
    """Return for each recording the joint curves of all others that did not differ."""
    agreeing = [s for s, found in zip(summaries, apart, strict=True) if not found]
    # If at most one agrees, compare with all others.
    inside = {s.key for s in (agreeing if len(agreeing) > 1 else summaries)}
    information = Information.of([s for s in summaries if s.key in inside])
    together = solve(information)
    whole = _curves(together)
    return [_curves(solve(information.without(s), start=together)) if s.key in inside else whole for s in summaries]


def _differing_parts(one: _Curves, other: _Curves, *, allowed: bool) -> dict[Part, float]:
    """Return the parts in which curves differ, and by how many standard deviations."""
    score = np.abs(_scores(one, other, allowed=allowed))
    found = {part: float(score[places].max()) for part, places in _PLACES.items()}
    return {part: sigmas for part, sigmas in found.items() if sigmas > DIFFERING_SIGMAS}


def _scores(one: _Curves, other: _Curves, *, allowed: bool) -> FloatArray:
    """Return differences in standard deviations, which with ``allowed`` include the usual scatter."""
    usual = np.repeat(
        [ALLOWED_SCATTER["response"], ALLOWED_SCATTER["vignette"]], [len(COMPARED_GREYS), len(_places())]
    )
    scatter = usual if allowed else 0.0
    return np.asarray((one.value - other.value) / np.sqrt(one.sigma**2 + other.sigma**2 + scatter**2))


def _scatter(agreeing: list[tuple[_Curves, _Curves]]) -> dict[Part, float]:
    """Return the scatter of recordings that agree from their differences from the others (DerSimonian and Laird)."""
    others = len(agreeing) - 1
    if others < 1:
        return dict.fromkeys(_PLACES, 0.0)
    squares = np.stack([_scores(one, other, allowed=False) ** 2 for one, other in agreeing])
    # What a scatter as wide as the prior would add; the mean of the others scatters, too.
    variance = np.stack([one.sigma**2 + other.sigma**2 for one, other in agreeing])
    added = np.stack([one.prior_sigma**2 for one, _ in agreeing]) / variance * (1 + 1 / others)
    # The points of a curve err together, so the mean square varies as if each recording had only one.
    by_chance = 1 + SCATTER_CHANCE_SIGMAS * np.sqrt(2 / others)
    return {
        part: float(np.sqrt(max(np.mean(squares[:, places]) - by_chance, 0.0) / np.mean(added[:, places])))
        for part, places in _PLACES.items()
    }


def _prior_covariance(response: FloatArray, vignette: VignetteBasis) -> FloatArray:
    """Return the covariance of the common parameters before any recording, about a response, shape (p, p)."""
    return np.asarray(np.linalg.inv(Prior(RESPONSE, vignette, response, np.zeros(0)).precision(START)))


@cache
def _places() -> FloatArray:
    """Return the points at which V is compared, in half diagonals from the image centre, shape (points, 2)."""
    angle = 2 * np.pi * (np.arange(COMPARED_DIRECTIONS) + 0.5) / COMPARED_DIRECTIONS
    return np.concatenate([r * np.stack([np.cos(angle), np.sin(angle)], axis=1) for r in COMPARED_RADII])


@cache
def _response_rows() -> FloatArray:
    return RESPONSE.log_rows(COMPARED_GREYS) - RESPONSE.log_rows(np.array([NORMALISING_GREY]))


def _curves(fit: Fit) -> _Curves:
    places, vignette = _places(), fit.vignette_parameters
    # V is 1 at the image centre by convention; a free centre adds a constant, which cannot be observed.
    centre = np.zeros((1, 2))
    value = fit.vignette_basis.log_value(vignette, places) - fit.vignette_basis.log_value(vignette, centre)
    rows = fit.vignette_basis.jacobian(vignette, places) - fit.vignette_basis.jacobian(vignette, centre)
    parts = ((_response_rows(), RESPONSE_PART), (rows, VIGNETTE_PART))
    sigma, prior_sigma = (
        np.sqrt(np.concatenate([variances(rows_of, covariance[part, part]) for rows_of, part in parts]))
        for covariance in (fit.covariance, _prior_covariance(fit.response_parameters, fit.vignette_basis))
    )
    value = np.concatenate([_response_rows() @ fit.response_parameters, value])
    return _Curves(value, sigma, prior_sigma)


def _described(
    summary: Summary,
    found: dict[Part, float],
    rest: _Curves,
    own: _Curves,
    *,
    allowed: bool,
    usual: float,
    whose: str = "the others",
) -> Difference:
    """Describe how a recording differs; ``usual`` is the usual unexplained share of exposure changes."""
    score, difference, texts = np.abs(_scores(own, rest, allowed=allowed)), np.exp(own.value - rest.value) - 1, []
    for part in found:
        at = _PLACES[part].start + int(np.argmax(score[_PLACES[part]]))
        if part == "response":
            what = f"the irradiance ratio of grey levels {COMPARED_GREYS[at]:.1f} and {NORMALISING_GREY}"
        else:
            what = f"the vignette at radius {np.linalg.norm(_places()[at - len(COMPARED_GREYS)]):.1f}"
        texts.append(f"{what} differs by {difference[at]:+.1%} from {whose} ({score[at]:.0f} standard deviations)")
    parts, meaning = tuple(found), _MEANING[tuple(found)]
    # Wrong exposures spoil both parts, even if only one of them differs significantly.
    if summary.unexplained > SUSPICIOUS_FACTOR * max(usual, MIN_USUAL_UNEXPLAINED):
        parts = ("response", "vignette")
        meaning = (
            f"its exposures are wrong ({summary.unexplained:.1%} of their changes do not show in the images, "
            f"usually {usual:.1%}), or it is of another camera"
        )
    return Difference(summary.key, summary.name, parts, max(found.values()), f"{'; '.join(texts)}: {meaning}")
