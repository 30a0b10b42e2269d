"""The exponential ambiguity: without exposures every exponent explains a recording as well as the true one."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass

import numpy as np

from ospc.arrays import BoolArray, FloatArray
from ospc.baselines.joint import JointEstimate, estimate_jointly
from ospc.baselines.response_model import learned_model
from ospc.baselines.tracks import GainRobustTracker, TrackObservations
from ospc.errors import FormatError, NotObservableError
from ospc.experiments.measuring import OnProgress
from ospc.experiments.sources import Source
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette, radial_profile

EXPONENTS = np.geomspace(0.5, 2.0, 25)
STARTS = (0.6, 0.8, 1.0, 1.25, 1.6)
_ITERATIONS = 60


@dataclass(frozen=True)
class Ambiguity:
    """How well powers of the truth explain what was seen.

    Attributes
    ----------
    exponents
        γ, shape (n,).
    free, known
        Root mean square of grey levels unexplained by g^γ and V^γ, with exposures that may adapt and with the
        metadata's, shape (n,).
    starts, reached
        Exponents at which joint estimation was begun, and where the estimate's own lies then, shapes (m,).
    costs
        Mean robust residual that it ended with, shape (m,).
    """

    exponents: FloatArray
    free: FloatArray
    known: FloatArray
    starts: FloatArray
    reached: FloatArray
    costs: FloatArray


def show_ambiguity(source: Source, progress: OnProgress = lambda _name, _done, _of: None) -> Ambiguity:
    """Measure the ambiguity on a recording.

    Raises
    ------
    FormatError
        If the truth lacks the response or the vignette.
    NotObservableError
        If too little can be tracked.
    """
    response, vignette = source.truth.response, source.truth.vignette
    if response is None or vignette is None:
        raise FormatError(f"{source.name}: the ambiguity is shown with the true response and vignette; give both")
    tracker = GainRobustTracker()
    exposures = np.empty(source.count)
    for done, frame in enumerate(source.open(), start=1):
        tracker.push(frame)
        exposures[frame.index] = frame.exposure_ms
        progress(source.name, done, source.count)
    seen = tracker.observations()
    if not seen.grey.size:
        raise NotObservableError(f"{source.name}: no point could be tracked")
    log_e = np.log(exposures[seen.frames])
    residuals = [_residuals(seen, response, vignette, float(gamma), log_e) for gamma in EXPONENTS]
    free, known = np.array(residuals).T
    ends = [_estimate_from(seen, float(start)) for start in STARTS]
    reached = np.array([_exponent_of(end, response) for end in ends])
    costs = np.array([end.cost for end in ends])
    return Ambiguity(EXPONENTS, free, known, np.array(STARTS), reached, costs)


def _residuals(
    seen: TrackObservations, response: Response, vignette: Vignette, gamma: float, log_e: FloatArray
) -> tuple[float, float]:
    """Return unexplained grey levels with exposures e^γ and with exposures e, the radiances being the best for each.

    Radiances are means of ln g^γ − ln V^γ − ln e over the observations of a point.
    """
    profile = np.asarray(radial_profile(vignette))
    log_v = np.log(np.interp(seen.radius, (np.arange(profile.size) + 0.5) / profile.size, profile))
    log_g = np.log(np.maximum(response.inverse(seen.grey), 1e-6))
    inside = (seen.grey > 0.04) & (seen.grey < 0.96)
    free = _unexplained(seen, inside, gamma * log_g, gamma * log_v + gamma * log_e[seen.frame], response, gamma)
    known = _unexplained(seen, inside, gamma * log_g, gamma * log_v + log_e[seen.frame], response, gamma)
    return free, known


def _unexplained(  # noqa: PLR0917 - one formula
    seen: TrackObservations,
    inside: BoolArray,
    log_g: FloatArray,
    log_ev: FloatArray,
    response: Response,
    gamma: float,
) -> float:
    counts = np.maximum(np.bincount(seen.point, weights=inside), 1)
    log_l = np.bincount(seen.point, weights=inside * (log_g - log_ev)) / counts
    predicted = response(np.exp((log_ev + log_l[seen.point]) / gamma))
    several = inside & (counts[seen.point] >= 3)
    difference = (seen.grey - predicted)[several]
    # the median of squares, for a few tracks have left their points
    return float(1.4826 * np.median(np.abs(difference)))


def _estimate_from(seen: TrackObservations, exponent: float) -> JointEstimate:
    """Return the joint estimate that begins at the model's response nearest to a power of its mean."""
    model = learned_model()
    powered = Response.from_values(model.response(np.zeros(len(model.components))).inverse_table ** exponent)
    start = JointEstimate(
        seen.size, model, model.coefficients_of(powered), np.zeros(3), seen.frames, np.zeros(seen.frames.size)
    )
    return estimate_jointly(seen, model, start, _ITERATIONS)


def _exponent_of(found: JointEstimate, truth: Response) -> float:
    """Return γ with g ≈ G^γ over the middle greys, by least squares of logarithms."""
    greys = np.linspace(0.15, 0.9, 60)
    estimate, true = np.log(found.response.inverse(greys)), np.log(truth.inverse(greys))
    return float(estimate @ true / (true @ true))


def as_csv(found: Ambiguity) -> str:
    """Return the residuals by exponent, with a heading."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["exponent", "residual_exposures_free", "residual_exposures_known"])
    writer.writerows(
        [f"{g:.6g}", f"{a:.6g}", f"{b:.6g}"] for g, a, b in zip(found.exponents, found.free, found.known, strict=True)
    )
    return text.getvalue()


def starts_as_csv(found: Ambiguity) -> str:
    """Return where joint estimation ended by where it began, with a heading."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["start_exponent", "end_exponent", "cost"])
    writer.writerows(
        [f"{a:.6g}", f"{b:.6g}", f"{c:.6g}"] for a, b, c in zip(found.starts, found.reached, found.costs, strict=True)
    )
    return text.getvalue()
