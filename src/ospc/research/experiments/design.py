"""The experiments: which methods each compares, and what it varies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from ospc.photometry.response import Response
from ospc.research.measurement import metrics
from ospc.research.method import Method
from ospc.research.own_methods import VIGNETTE_SOLVERS, OwnMethod, PaperVariants, SolversKnowingResponse
from ospc.research.pictures import Comparison
from ospc.research.rivals.bergmann import Bergmann
from ospc.research.rivals.camera_at_rest import CameraAtRest, ExposureSeries
from ospc.research.rivals.debevec_malik import debevec_malik
from ospc.research.rivals.engel import engel_response
from ospc.research.rivals.kim_pollefeys import KimPollefeys
from ospc.research.rivals.mitsunaga_nayar import mitsunaga_nayar
from ospc.research.rivals.robertson import robertson
from ospc.research.source import Methods, Source
from ospc.settings import PaperSettings

FEATURES = ("sift", "surf", "orb")
OFFSETS = (10, 15, 20, 25, 30, 32, 35, 40, 50)
THRESHOLDS = (1.02, 1.04, 1.08, 1.15, 1.3, 1.5)

_PAPER_THRESHOLDS = (0.92, 1.08)
_UNCHECKED = PaperSettings(acceptance_tolerance=1e3)
"""The paper's method without its check: the paper compares the results of solvers, not what the check accepts."""

_AT_REST: dict[str, Callable[[ExposureSeries], Response]] = {
    "debevec-malik": debevec_malik,
    "robertson": robertson,
    "mitsunaga-nayar": lambda series: mitsunaga_nayar(series).response,
    "engel": engel_response,
}
_SLOW = 0.5
"""Speed of stand-ins whose features are matched over 30 frames, as in the paper's recordings."""


def _none(_source: Source) -> dict[str, Method]:
    return {}


@dataclass(frozen=True)
class Experiment(Methods):
    """One of the paper's figures or tables, or a comparison with methods of other papers, by the name of its command.

    Attributes
    ----------
    comparison
        The picture of errors.
    stand_ins
        Number of simulated recordings, and frames of each, where nothing else is asked for.
    variants
        Settings of the paper's method by name, each group with its own matching of features.
    rivals
        Makes the other methods for a recording.
    speed
        Factor of the speed of the simulated motion.
    at_rest
        Whether the simulated camera is at rest.
    with_ratios
        Whether exposure ratios are compared with the metadata too.
    """

    comparison: Comparison
    stand_ins: tuple[int, int]
    variants: dict[str, dict[str, PaperSettings]] = field(default_factory=dict)
    rivals: Callable[[Source], dict[str, Method]] = _none
    speed: float = 1.0
    at_rest: bool = False
    with_ratios: bool = False

    def describe(self) -> dict[str, Any]:
        """Return the settings of the variants; other settings are part of the source."""
        settings = {name: asdict(one) for group in self.variants.values() for name, one in group.items()}
        return {"experiment": self.name, "variants": settings}

    def make(self, source: Source) -> dict[str, Method]:
        """Return new methods for a recording."""
        return {**self.rivals(source), **{name: PaperVariants(group) for name, group in self.variants.items()}}


def _compared(title: str, figure: str, varied: dict[str, float] | None = None, axis: str = "") -> Comparison:
    return Comparison(title, metrics(figure), varied or {}, axis)


def _ours(_source: Source) -> dict[str, Method]:
    return {"ours": OwnMethod(variant="ours")}


def _joint_rivals(source: Source) -> dict[str, Method]:
    response = source.truth().response
    return {
        **_ours(source),
        "joint-online": Bergmann(response, online=True),
        "joint-batch": Bergmann(response, online=False),
        "kim-pollefeys": KimPollefeys(),
    }


def _solver_rivals(source: Source) -> dict[str, Method]:
    response = source.truth().response
    alone = {} if response is None else {"true g": SolversKnowingResponse(response, PaperSettings())}
    return {**_ours(source), **alone}


def _static_rivals(source: Source) -> dict[str, Method]:
    return {**_ours(source), **{name: CameraAtRest(name, response_of) for name, response_of in _AT_REST.items()}}


def _threshold(high: float) -> PaperSettings:
    low = _PAPER_THRESHOLDS[0] if high == _PAPER_THRESHOLDS[1] else 1 / high
    return replace(_UNCHECKED, exposure_ratio_high=high, exposure_ratio_low=low)


_ALL = (
    Experiment(
        "parameters",
        _compared("Photometric parameters against the truth", "response_rmse"),
        (1, 600),
        {"paper": {"paper": PaperSettings()}},
        _ours,
        with_ratios=True,
    ),
    Experiment(
        "joint",
        _compared("Joint estimation and known exposures", "vignette_rmse"),
        (8, 400),
        rivals=_joint_rivals,
    ),
    Experiment(
        "solvers",
        _compared("Solvers of the vignette", "vignette_rmse"),
        (4, 500),
        {"paper": {f"paper/{name}": replace(_UNCHECKED, vignette_solver=name) for name in VIGNETTE_SOLVERS}},
        _solver_rivals,
        _SLOW,
    ),
    Experiment(
        "features",
        _compared("Features behind the response", "response_rmse"),
        (4, 300),
        {name: {f"paper/{name}": replace(_UNCHECKED, features=name)} for name in FEATURES},
        _ours,
        _SLOW,
    ),
    Experiment(
        "offsets",
        _compared(
            "Offset between the frames of a pair",
            "vignette_rmse",
            {f"offset {n}": float(n) for n in OFFSETS},
            "offset in frames",
        ),
        (4, 500),
        {"offsets": {f"offset {n}": replace(_UNCHECKED, vignette_offset=n) for n in OFFSETS}},
        speed=_SLOW,
    ),
    Experiment(
        "thresholds",
        _compared(
            "Least exposure ratio of a pair",
            "response_rmse",
            {f"k ≥ {high}": high for high in THRESHOLDS},
            "least exposure ratio k",
        ),
        (4, 300),
        {"thresholds": {f"k ≥ {high}": _threshold(high) for high in THRESHOLDS}},
        speed=_SLOW,
    ),
    Experiment(
        "static",
        _compared("Responses from a camera at rest", "response_rmse"),
        (6, 60),
        rivals=_static_rivals,
        at_rest=True,
    ),
)
EXPERIMENTS = {experiment.name: experiment for experiment in _ALL}
"""The experiments by name."""
