"""The exponential ambiguity: without exposures, every exponent explains a recording as well as the true one."""

from __future__ import annotations

from functools import partial
from typing import Any, TypeAlias

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import FormatError, NotObservableError
from ospc.formats.files import csv_text
from ospc.numerics.robust import robust_scale
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette, radial_profile
from ospc.report.style import BLUE, GREY, ORANGE, new_figure, printable
from ospc.research.runner import OnProgress, Task, made_with
from ospc.research.source import Source
from ospc.research.tables import StudyReport, rounded
from ospc.unknown_exposures.joint_estimation import JointEstimate, estimate_jointly
from ospc.unknown_exposures.response_model import learned_model
from ospc.unknown_exposures.tracking import GainRobustTracker, TrackObservations

EXPONENTS = np.geomspace(0.5, 2.0, 25)
STARTS = (0.6, 0.8, 1.0, 1.25, 1.6)
_ITERATIONS = 60
_EXPOSED = (0.04, 0.96)
"""Range of grey levels used, without dark noise and saturation."""
_FEWEST_VIEWS = 3
"""Fewest observations of a point whose residuals count: with fewer, its radiance fits too well."""

Columns: TypeAlias = dict[str, list[float]]
"""The columns of a table of numbers by name."""


def ambiguity_task(source: Source) -> Task:
    """Return the task of measuring the ambiguity on a recording."""
    depends_on = {"recording": source.describe(), "study": "ambiguity", "made_with": made_with()}
    return Task(f"{source.name} (ambiguity)", depends_on, partial(measure_ambiguity, source))


def measure_ambiguity(source: Source, progress: OnProgress = lambda _share: None) -> dict[str, Columns]:
    """Measure how well powers of the truth explain a recording with known response and vignette.

    "ambiguity" contains, by exponent γ, the robust standard deviation of the residual grey levels of g^γ and V^γ,
    relative to full scale, with exposures e^γ (free) and with those of the metadata (known). "starts" contains, by
    the initial exponent of joint estimation, the exponent of its result and its mean robust residual (cost).
    """
    truth = source.truth()
    if truth.response is None or truth.vignette is None:
        raise FormatError(f"{source.name}: measuring the ambiguity needs the true response and vignette; give both")
    tracker = GainRobustTracker()
    exposures = np.empty(source.count)
    for done, frame in enumerate(source.frames(), start=1):
        tracker.push(frame)
        exposures[frame.index] = frame.exposure_ms
        progress(done / source.count)
    tracks = tracker.observations()
    if not tracks.grey.size:
        raise NotObservableError(f"{source.name}: no point could be tracked")
    log_e = np.log(exposures[tracks.frames])[tracks.frame]
    residuals = [_residuals(tracks, truth.response, truth.vignette, float(gamma), log_e) for gamma in EXPONENTS]
    free, known = zip(*residuals, strict=True)
    ends = [_estimate_from(tracks, start) for start in STARTS]
    reached = [_exponent_of(end, truth.response) for end in ends]
    by_exponent = {
        "exponent": EXPONENTS.tolist(),
        "residual_exposures_free": list(free),
        "residual_exposures_known": list(known),
    }
    by_start = {"start_exponent": list(STARTS), "end_exponent": reached, "cost": [end.cost for end in ends]}
    return {"ambiguity": by_exponent, "starts": by_start}


def _residuals(
    tracks: TrackObservations, response: Response, vignette: Vignette, gamma: float, log_e: FloatArray
) -> tuple[float, float]:
    """Return the residual grey levels with exposures e^γ and with exposures e, each with the best radiances."""
    # Radiances are means of ln g^γ − ln V^γ − ln e over the observations of a point.
    profile = np.asarray(radial_profile(vignette))
    log_v = np.log(np.interp(tracks.radius, (np.arange(profile.size) + 0.5) / profile.size, profile))
    log_g = np.log(np.maximum(response.inverse(tracks.grey), 1e-6))
    inside = (tracks.grey > _EXPOSED[0]) & (tracks.grey < _EXPOSED[1])
    counts = np.maximum(np.bincount(tracks.point, weights=inside), 1)
    several = inside & (counts[tracks.point] >= _FEWEST_VIEWS)

    def unexplained(log_ev: FloatArray) -> float:
        log_l = np.bincount(tracks.point, weights=inside * (gamma * log_g - log_ev)) / counts
        predicted = response(np.exp((log_ev + log_l[tracks.point]) / gamma))
        # Robust, because a few tracks have drifted from their points.
        return robust_scale((tracks.grey - predicted)[several])

    return unexplained(gamma * (log_v + log_e)), unexplained(gamma * log_v + log_e)


def _estimate_from(tracks: TrackObservations, exponent: float) -> JointEstimate:
    """Return the joint estimate started at the model's response nearest to a power of its mean."""
    model = learned_model()
    powered = Response.from_values(model.response(np.zeros(len(model.components))).inverse_table ** exponent)
    no_vignette, equal = np.zeros(3), np.zeros(tracks.frames.size)
    start = JointEstimate(tracks.size, model.coefficients_of(powered), no_vignette, tracks.frames, equal)
    return estimate_jointly(tracks, start, _ITERATIONS)


def _exponent_of(found: JointEstimate, truth: Response) -> float:
    """Return γ with g ≈ G^γ over the middle grey levels, by least squares of logarithms."""
    greys = np.linspace(0.15, 0.9, 60)
    estimate, true = np.log(found.response.inverse(greys)), np.log(truth.inverse(greys))
    return float(estimate @ true / (true @ true))


def ambiguity_report(found: dict[str, Columns], name: str) -> StudyReport:
    """Return the report, with ``ambiguity.csv``, ``starts.csv`` and ``ambiguity.png``."""
    texts = {
        f"{table}.csv": csv_text([columns, *(map(rounded, row) for row in zip(*columns.values(), strict=True))])
        for table, columns in found.items()
    }
    return StudyReport([], texts, {"ambiguity.png": partial(_draw, found, name)})


def _draw(found: dict[str, Columns], name: str) -> Any:
    """Draw the residuals of powers of the truth, and the final against the initial exponent of joint estimation."""
    exponents, free, known = (np.array(column) for column in found["ambiguity"].values())
    starts, reached, _ = found["starts"].values()
    figure = new_figure(11.0, 4.4)
    figure.suptitle(printable(name), parse_math=False)
    left, right = figure.subplots(1, 2)
    left.plot(exponents, 255 * free, color=ORANGE, lw=2, label="exposures free: e^γ")
    left.plot(exponents, 255 * known, color=BLUE, ls="--", lw=2, label="exposures known: e")
    left.axvline(1, color=GREY, lw=1)
    left.set(xscale="log", ylim=(0, None), title="All exponents fit equally well, unless e is known")
    left.set(xlabel="exponent γ of response and vignette", ylabel="unexplained, grey levels")
    right.plot(starts, reached, "o-", color=ORANGE, label="joint estimation")
    right.axhline(1, color=GREY, lw=1, label="truth")
    right.set(xscale="log", yscale="log", title="The result of joint estimation depends on its start")
    right.set(xlabel="exponent of the start", ylabel="exponent of the result")
    ticks = [0.35, 0.5, 0.7, 1, 1.4, 2, 2.8]
    right.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    for axes in (left, right):
        axes.set_xticks(ticks[1:-1], [f"{tick:g}" for tick in ticks[1:-1]])
        axes.minorticks_off()
        axes.legend(loc="best")
    return figure
