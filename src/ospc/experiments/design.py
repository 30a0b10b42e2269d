"""The experiments: which methods each compares, and what it varies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from ospc.experiments.methods import Decoupled, Joint, Ours, Paper, SolversKnowingResponse, Timed
from ospc.experiments.sources import Source
from ospc.settings import PaperSettings

SOLVERS = ("l2", "l1", "m-estimator")
FEATURES = ("sift", "surf", "orb")
OFFSETS = (10, 15, 20, 25, 30, 32, 35, 40, 50)
THRESHOLDS = (1.02, 1.04, 1.08, 1.15, 1.3, 1.5)

_PAPER_THRESHOLDS = (0.92, 1.08)
_ACCEPT_ALL = 1e3
"""Tolerance of the verdict in ablations: the paper compares what solvers return, not what its check lets pass."""


@dataclass(frozen=True)
class Experiment:
    """One of the paper's figures or tables.

    Attributes
    ----------
    name
        Of the command.
    title
        Of the picture.
    figure
        The figure of merit that it is about.
    methods
        Makes the methods anew for a recording.
    varied
        Values of what is varied by method's name; empty where methods are compared that differ in kind.
    axis
        Label of what is varied.
    """

    name: str
    title: str
    figure: str
    methods: Callable[[Source], list[Timed]]
    varied: dict[str, float]
    axis: str = ""


def parameters() -> Experiment:
    """Response, vignette and exposure ratios against the truth (figure 3)."""
    return Experiment(
        "parameters",
        "Photometric parameters against the truth",
        "response_rmse",
        lambda _source: [Timed("ours", Ours()), Timed("paper", Paper({"paper": PaperSettings()}))],
        {},
    )


def joint() -> Experiment:
    """Joint estimation with a known point of the response and without, against known exposures (figure 4)."""

    def methods(source: Source) -> list[Timed]:
        response = source.truth.response
        return [
            Timed("ours", Ours()),
            Timed("joint-online", Joint(response, online=True)),
            Timed("joint-batch", Joint(response, online=False)),
            Timed("kim-pollefeys", Decoupled()),
        ]

    return Experiment("joint", "Joint estimation and known exposures", "vignette_rmse", methods, {})


def solvers() -> Experiment:
    """Solvers of the vignette, after the estimated response and after the true one (section 5)."""
    variants = {
        f"paper/{solver}": PaperSettings(vignette_solver=solver, acceptance_tolerance=_ACCEPT_ALL)
        for solver in SOLVERS
    }

    def methods(source: Source) -> list[Timed]:
        found = [Timed("paper", Paper(variants)), Timed("ours", Ours())]
        if source.truth.response is not None:
            alone = SolversKnowingResponse(source.truth.response, PaperSettings(), SOLVERS)
            found.insert(1, Timed("true g", alone))
        return found

    return Experiment("solvers", "Solvers of the vignette", "vignette_rmse", methods, {})


def features() -> Experiment:
    """Features (section 5)."""

    def methods(_source: Source) -> list[Timed]:
        kinds = [
            Timed(kind, Paper({f"paper/{kind}": PaperSettings(features=kind, acceptance_tolerance=_ACCEPT_ALL)}))
            for kind in FEATURES
        ]
        return [*kinds, Timed("ours", Ours())]

    return Experiment("features", "Features behind the response", "response_rmse", methods, {})


def offsets() -> Experiment:
    """Frames between the two of a pair for the vignette (section 5)."""
    base = PaperSettings(acceptance_tolerance=_ACCEPT_ALL)
    variants = {f"offset {n}": replace(base, vignette_offset=n) for n in OFFSETS}
    return Experiment(
        "offsets",
        "Offset between the frames of a pair",
        "vignette_rmse",
        lambda _source: [Timed("offsets", Paper(variants))],
        {f"offset {n}": float(n) for n in OFFSETS},
        "offset in frames",
    )


def thresholds() -> Experiment:
    """Least change of exposure of a pair for the response (section 5)."""
    base = PaperSettings(acceptance_tolerance=_ACCEPT_ALL)
    variants = {}
    for high in THRESHOLDS:
        low = _PAPER_THRESHOLDS[0] if high == _PAPER_THRESHOLDS[1] else 1 / high
        variants[f"k ≥ {high}"] = replace(base, exposure_ratio_high=high, exposure_ratio_low=low)
    return Experiment(
        "thresholds",
        "Least exposure ratio of a pair",
        "response_rmse",
        lambda _source: [Timed("thresholds", Paper(variants))],
        {f"k ≥ {high}": high for high in THRESHOLDS},
        "least exposure ratio k",
    )


EXPERIMENTS: dict[str, Callable[[], Experiment]] = {
    "parameters": parameters,
    "joint": joint,
    "solvers": solvers,
    "features": features,
    "offsets": offsets,
    "thresholds": thresholds,
}
"""The experiments by the names of their commands."""
