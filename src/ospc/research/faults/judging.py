"""One run of the fault study: a recording with a fault is calibrated and the outcome compared with the truth."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from operator import itemgetter
from pathlib import Path
from time import process_time
from typing import Any, Literal

import cv2
import numpy as np

from ospc.calibrator import calibrate
from ospc.errors import OspcError, one_line
from ospc.estimation.response_basis import ResponseBasis
from ospc.evaluation.metrics import log_ratio_error, vignette_rmse
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.response import Response
from ospc.photometry.vignette import half_diagonal_profiles
from ospc.recording import Frame
from ospc.research.faults import exposures, greys, light, sequence
from ospc.research.faults.footage import STRENGTHS, Fault, Footage, GoodSource, good_footage
from ospc.research.runner import OnProgress, Task, made_with

FaultOutcome = Literal[
    "detected", "corrected", "harmless", "uncertain", "indistinguishable", "confident and wrong", "crashed"
]

KINDS: dict[str, tuple[Fault, ...]] = {
    "light, optics and scene": light.FAULTS,
    "grey values": greys.FAULTS,
    "exposures": exposures.FAULTS,
    "sequence and files": sequence.FAULTS,
}
FAULTS = {fault.name: fault for faults in KINDS.values() for fault in faults}
"""All faults by kind, and by name."""
CLEAN = "none"
"""Name that stands for no fault."""
MOST_SIGMAS, _CENTRE = 3.0, 0.1
"""Largest error in stated standard deviations; V is judged beyond this radius, because V is 1 at the centre."""
MOST_KAPPA, MOST_VIGNETTE = 0.005, 0.005
"""Largest log-ratio error of the response and RMSE of the vignette's profile: half a per cent is the accuracy that
corrected images are used to."""
_LOW, _HIGH = 0.25, 0.75
"""Grey levels between which the step of ln g is judged, as in the verdicts."""


@dataclass(frozen=True)
class Run:
    """The result for a recording with a fault, whose strength is given by name and value.

    Attributes
    ----------
    kappa
        Log-ratio error of the response.
    step, step_sigma
        Error of ln g(0.75)/g(0.25) and its stated standard deviation.
    vignette, vignette_sigmas
        RMSE of the vignette's profile; the RMSE relative to the RMS of the stated standard deviation.
    states, said
        Verdicts by name; the error, or warnings, notes, and reasons of verdicts that are not "identifiable".
    skipped
        Number of frames that could not be used.
    false_alarm
        Whether there was an error or warning, which is wrong if there is no fault.
    seconds
        Processor time of the calibration.
    """

    recording: str
    fault: str
    strength: str
    value: float | None
    outcome: FaultOutcome
    kappa: float | None = None
    step: float | None = None
    step_sigma: float | None = None
    vignette: float | None = None
    vignette_sigmas: float | None = None
    states: dict[str, str] = field(default_factory=dict)
    said: tuple[str, ...] = ()
    skipped: int = 0
    false_alarm: bool = False
    seconds: float = 0.0

    @property
    def beyond(self) -> tuple[str, ...]:
        """Names of the figures that exceed their limits."""
        return beyond(vars(self))


def fault_task(source: GoodSource, fault: Fault | None = None, strength: int = 0) -> Task:
    """Return the task for a fault with the strength of this index on a good recording; None for no fault."""
    run = Run(source.name, CLEAN, "", None, "harmless")
    if fault is not None:
        value = fault.strengths[strength]
        run = replace(run, fault=fault.name, strength=STRENGTHS[strength], value=value)
    put = None if fault is None else [fault.name, run.value]
    depends_on = {"recording": source.describe(), "fault": put, "made_with": made_with()}
    name = f"{source.name} ({run.fault} {run.strength}".rstrip() + ")"
    # The fault is found by its name, because functions without a name cannot be pickled.
    return Task(name, depends_on, partial(_run, source, run))


def _run(source: GoodSource, run: Run, progress: OnProgress) -> dict[str, Any]:
    footage = good_footage(source)
    if run.value is not None:
        footage = FAULTS[run.fault].put_on(footage, run.value)
    progress(0.5)
    began = process_time()
    try:
        found = calibrated(footage)
    except Exception as error:  # a crash is an outcome too
        outcome: FaultOutcome = "detected" if isinstance(error, OspcError) else "crashed"
        return asdict(replace(run, outcome=outcome, said=(one_line(error),), false_alarm=True))
    return asdict(judged(found, footage, replace(run, seconds=process_time() - began)))


def calibrated(footage: Footage) -> Calibration:
    """Calibrate a recording with default settings."""
    if not footage.times:
        metadata = zip(footage.images, footage.exposures_ms, footage.stamps_s, strict=True)
        return calibrate(
            Frame.of_array(image, exposure_ms, index=i, stamp_s=stamp_s, max_grey=255)
            for i, (image, exposure_ms, stamp_s) in enumerate(metadata)
        )
    with tempfile.TemporaryDirectory() as name:
        # In the layout of the TUM monocular data set.
        folder = Path(name)
        (folder / "images").mkdir()
        for frame, image in zip(footage.names, footage.images, strict=True):
            cv2.imwrite(str(folder / "images" / f"{frame}.png"), image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        (folder / "times.txt").write_text("\n".join(footage.times) + "\n", encoding="utf-8")
        try:
            return calibrate(folder)
        except OspcError as error:  # remove the folder's name, which differs between runs
            raise OspcError(str(error).replace(f"{folder}/", "")) from error


def judged(found: Calibration, footage: Footage, run: Run) -> Run:
    """Return a run with the errors and messages of its calibration, and the outcome."""
    figures = _errors(found, footage)
    doubts = [f"{name}: {v.reason}" for name, v in found.verdicts.items() if v.state != "identifiable"]
    states: dict[str, str] = {name: verdict.state for name, verdict in found.verdicts.items()}
    skipped = found.counts.get("skipped", 0)
    parts = ("response", "exposures") if footage.vignette is None else ("response", "vignette", "exposures")
    outcome_by = partial(
        outcome_of,
        {name: states.get(name, "not identifiable") for name in parts},
        warned=bool(found.warnings),
        corrected=bool(found.notes) or skipped > 0,
    )
    outcome, wrong = outcome_by(figures), "confident and wrong"
    if outcome == wrong and footage.power != 1 and outcome_by(_errors(found, footage.as_stated())) != wrong:
        outcome = "indistinguishable"
    return replace(
        run,
        **figures,
        states=states,
        said=tuple(dict.fromkeys((*found.warnings, *found.notes, *doubts))),
        skipped=skipped,
        false_alarm=bool(found.warnings) or states.get("exposures") == "not identifiable",
        outcome=outcome,
    )


def _errors(found: Calibration, footage: Footage) -> dict[str, Any]:
    """Return errors and standard deviations by the names of :class:`Run`, for curves that are known."""
    figures: dict[str, Any] = {}
    if (response := found.response) is not None:
        # If a curve was applied to all grey values, the estimate may include it or not.
        errors = ((log_ratio_error(response, one, brightest=footage.brightest), one) for one in footage.responses)
        kappa, truth = min(errors, key=itemgetter(0))
        sigma = step_sigma(found)
        if sigma is not None and footage.reference is not None:
            sigma = math.hypot(sigma, step_sigma(footage.reference) or 0.0)
        figures |= {"kappa": kappa, "step": log_step(response) - log_step(truth), "step_sigma": sigma}
    if found.vignette is not None and footage.vignette is not None:
        # The images show nothing of the vignette beyond this radius.
        figures["vignette"] = vignette_rmse(found.vignette, footage.vignette, footage.max_radius)
        if found.vignette_sigma is not None:
            judged = (PROFILE_RADII > _CENTRE) & (footage.max_radius >= PROFILE_RADII)
            one, other = (half_diagonal_profiles(v, PROFILE_RADII)[:, 0] for v in (found.vignette, footage.vignette))
            error = one - other
            mean_square = np.mean(error[judged] ** 2) / np.mean(found.vignette_sigma[judged] ** 2)
            figures["vignette_sigmas"] = float(np.sqrt(mean_square))
    return figures


def outcome_of(
    states: dict[str, str], figures: Mapping[str, float | None], *, warned: bool, corrected: bool
) -> FaultOutcome:
    """Return the outcome of a run from the verdicts on quantities with known truth; the worst figure decides.

    ``figures`` are errors and standard deviations by the names of :class:`Run`. ``corrected`` is whether notes report
    a correction.
    """
    if warned or "not identifiable" in states.values():
        return "detected"
    exceeded = beyond(figures)
    if not exceeded:
        return "corrected" if corrected else "harmless"
    # A marginal verdict excuses a large error, but not a standard deviation that is too small.
    excused = {"κ": states["response"] == "marginal", "V": states.get("vignette") == "marginal"}
    return "uncertain" if all(excused.get(name, False) for name in exceeded) else "confident and wrong"


def beyond(figures: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of the figures of a run that exceed their limits; None exceeds none."""
    step, sigma, kappa, vignette, vignette_sigmas = (
        figures.get(name) or 0.0 for name in ("step", "step_sigma", "kappa", "vignette", "vignette_sigmas")
    )
    limits = {
        "κ": kappa > MOST_KAPPA,
        "V": vignette > MOST_VIGNETTE,
        "σ of g": abs(step) > MOST_SIGMAS * sigma,
        "σ of V": vignette_sigmas > MOST_SIGMAS,
    }
    return tuple(name for name, exceeded in limits.items() if exceeded)


def step_sigma(found: Calibration) -> float | None:
    """Return the stated standard deviation of ln g(0.75)/g(0.25); None without a covariance."""
    known = found.covariance.get("response")
    if known is None or found.response is None:
        return None
    of_curve = [i for i, name in enumerate(known["parameters"]) if name.startswith("gamma(")]
    covariance = np.array(known["matrix"])[np.ix_(of_curve, of_curve)]
    basis, ends = ResponseBasis(len(of_curve) - 1), np.array([_LOW, _HIGH])
    step = np.diff(basis.log_rows(ends), axis=0)[0]
    variance = step @ covariance @ step + found.exponent_sigma**2
    if "coefficients" in found.response.model:
        variance += np.sum(basis.unresolved(np.array(found.response.model["coefficients"]), ends) ** 2)
    return float(np.sqrt(variance))


def log_step(response: Response) -> float:
    """Return ln g(0.75)/g(0.25)."""
    low, high = response.inverse([_LOW, _HIGH])
    return float(np.log(high / low))
