"""The experiments: the methods that each compares, the settings it varies, and its tables, curves and plots."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from ospc.formats.files import csv_text
from ospc.research.measurement import Measurement, medians, methods_of, metrics, recordings_of
from ospc.research.method import VIGNETTE_SOLVERS, Method, OwnMethod, SolversKnowingResponse, paper_variants
from ospc.research.pictures import draw_curves, draw_errors
from ospc.research.rivals.bergmann import Bergmann
from ospc.research.rivals.camera_at_rest import AT_REST, CameraAtRest
from ospc.research.rivals.kim_pollefeys import KimPollefeys
from ospc.research.scoring import curves_of
from ospc.research.source import Methods, Source
from ospc.research.tables import StudyReport, Table, measurements_csv, rounded
from ospc.settings import PaperSettings

FEATURES = ("sift", "surf", "orb")
OFFSETS = (10, 15, 20, 25, 30, 32, 35, 40, 50)
THRESHOLDS = {high: 0.92 if high == 1.08 else 1 / high for high in (1.02, 1.04, 1.08, 1.15, 1.3, 1.5)}
"""Least exposure ratios above 1 with the matching ones below 1; the paper pairs 1.08 with 0.92."""
_UNCHECKED = PaperSettings(acceptance_tolerance=1e3)
"""The paper's method without its acceptance check, because the paper compares all results of the solvers."""
_SLOW = 0.5
"""Speed of stand-ins for experiments that match features over 30 frames, as in the paper's recordings."""


@dataclass(frozen=True)
class Experiment(Methods):
    """One of the paper's figures or tables, or a comparison with methods of other papers, with the command's name.

    Attributes
    ----------
    title, figure, varied, axis
        For the plot of errors: its title and the figure shown; if methods differ only in the value of a setting, that
        value by method name and its axis label.
    stand_ins
        Default number of simulated recordings, and of frames of each.
    variants
        Settings of the paper's method by name, alike in what affects the matching of the same features.
    rivals
        Creates the methods of other papers for a recording. If nothing is varied, ours is measured as well.
    speed, stationary
        Factor on the simulated camera's speed, and whether it is static.
    with_ratios
        Whether exposure ratios are compared with the metadata as well.
    """

    title: str
    figure: str
    stand_ins: tuple[int, int]
    variants: dict[str, PaperSettings] = field(default_factory=dict)
    rivals: Callable[[Source], dict[str, Method]] | None = None
    speed: float = 1.0
    stationary: bool = False
    varied: dict[str, float] = field(default_factory=dict)
    axis: str = ""
    with_ratios: bool = False

    def make(self, source: Source) -> dict[str, Method]:
        """Create the methods for a recording."""
        methods: dict[str, Method] = {} if self.varied else {"ours": OwnMethod(variant="ours")}
        if self.rivals is not None:
            methods |= self.rivals(source)
        return methods | paper_variants(self.variants)


def _joint_rivals(source: Source) -> dict[str, Method]:
    response = source.truth().response
    return {
        "joint-online": Bergmann(response, online=True),
        "joint-batch": Bergmann(response, online=False),
        "kim-pollefeys": KimPollefeys(),
    }


def _solver_rivals(source: Source) -> dict[str, Method]:
    response = source.truth().response
    return {} if response is None else {"true g": SolversKnowingResponse(response, PaperSettings())}


def _static_rivals(source: Source) -> dict[str, Method]:
    return {name: CameraAtRest(name) for name in AT_REST}


_ALL = (
    Experiment("parameters", "Photometric parameters against the truth", "response_rmse", (1, 600),
        {"paper": PaperSettings()}, with_ratios=True),
    Experiment("joint", "Joint estimation and known exposures", "vignette_rmse", (8, 400), rivals=_joint_rivals),
    Experiment("solvers", "Solvers of the vignette", "vignette_rmse", (4, 500),
        {f"paper/{name}": replace(_UNCHECKED, vignette_solver=name) for name in VIGNETTE_SOLVERS},
        _solver_rivals, _SLOW),
    Experiment("features", "Features behind the response", "response_rmse", (4, 300),
        {f"paper/{name}": replace(_UNCHECKED, features=name) for name in FEATURES}, speed=_SLOW),
    Experiment("offsets", "Offset between the frames of a pair", "vignette_rmse", (4, 500),
        {f"offset {n}": replace(_UNCHECKED, vignette_offset=n) for n in OFFSETS}, speed=_SLOW,
        varied={f"offset {n}": float(n) for n in OFFSETS}, axis="offset in frames"),
    Experiment("thresholds", "Minimum exposure ratio of a pair", "response_rmse", (4, 300),
        {
            f"k ≥ {high}": replace(_UNCHECKED, exposure_ratio_high=high, exposure_ratio_low=low)
            for high, low in THRESHOLDS.items()
        }, speed=_SLOW, varied={f"k ≥ {high}": high for high in THRESHOLDS}, axis="minimum exposure ratio k"),
    Experiment("static", "Responses from a static camera", "response_rmse", (6, 60), rivals=_static_rivals,
        stationary=True),
)  # fmt: skip
EXPERIMENTS = {experiment.name: experiment for experiment in _ALL}
"""The experiments by name."""

_SHOWN = metrics("response_rmse", "response_shape_rmse", "log_ratio_error", "vignette_rmse", "exposure_error")
"""The metrics of the table."""


def experiment_report(experiment: Experiment, sources: Sequence[Source], rows: Sequence[Measurement]) -> StudyReport:
    """Return the report, with ``measurements.csv``, ``table.md``, ``errors.png`` and the curves by recording."""
    table = median_table(rows)
    texts = {"measurements.csv": measurements_csv(rows), "table.md": table.as_markdown()}
    errors = partial(draw_errors, experiment.title, metrics(experiment.figure), rows)
    pictures: dict[str, Callable[[], Any]] = {
        "errors.png": partial(errors, varied=experiment.varied, axis=experiment.axis)
    }
    for source in sources:
        found = [row for row in rows if row.recording == source.name]
        ratios = found if experiment.with_ratios else []
        curves = {"truth": curves_of(source.truth()), **{row.method: row.curves for row in found}}
        texts[f"curves-{source.name}.csv"] = _curves_csv({name: c for name, c in curves.items() if c})
        if ratios:
            texts[f"ratios-{source.name}.csv"] = _ratios_csv(ratios)
        if not experiment.varied:
            pictures[f"curves-{source.name}.png"] = partial(draw_curves, source.name, curves, ratios)
    problems = [f"{row.recording}, {row.method}: {row.problem}" for row in rows if row.problem]
    return StudyReport([table], texts, pictures, problems)


def median_table(rows: Sequence[Measurement]) -> Table:
    """Return the medians over recordings, one line per method, with the lowest of each column marked.

    A missing figure counts as infinite.
    """
    columns = [medians(rows, metric.figure) for metric in _SHOWN]
    recordings = len(recordings_of(rows))
    lines, best = [], set()
    for number, name in enumerate(methods_of(rows)):
        found = [column[name] for column in columns]
        lowest = (min(column.values()) for column in columns)
        best |= {(number, i + 1) for i, (f, low) in enumerate(zip(found, lowest, strict=True)) if f == low < math.inf}
        failed = sum(bool(row.problem) for row in rows if row.method == name)
        lines.append((name, *(m.text(f) for m, f in zip(_SHOWN, found, strict=True)), f"{failed}/{recordings}"))
    title = f"Medians over {recordings} recordings" if recordings > 1 else "Errors"
    header = ("method", *(metric.label for metric in _SHOWN), "no result")
    return Table(title, header, tuple(lines), best=frozenset(best))


def _curves_csv(curves: Mapping[str, Mapping[str, Sequence[float]]]) -> str:
    """Return g at 256 grey levels and V at 50 radii, one column per method."""
    rows: list[list[object]] = [["curve", "at", *curves]]
    radii = [round((ring + 0.5) / 50, 2) for ring in range(50)]
    for letter, part, places in (("g", "response", range(256)), ("V", "vignette", radii)):
        for number, place in enumerate(places):
            values = [rounded(c[part][number]) if part in c else None for c in curves.values()]
            rows.append([letter, place, *values])
    return csv_text(rows)


def _ratios_csv(rows: Sequence[Measurement]) -> str:
    columns = ("frames", "metadata", "estimated", "samples")
    lines = []
    for row in rows:
        for pair, k, estimate, samples in zip(*(row.ratios.get(name, ()) for name in columns), strict=True):
            lines.append([row.method, *pair, rounded(k), rounded(estimate), samples])
    return csv_text([["method", "first", "second", "metadata", "estimated", "samples"], *lines])
