"""What a fit shows about the exposures, and which verdicts exposures and images allow on a calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ospc.arrays import FloatArray
from ospc.exposures.estimated import labelled
from ospc.exposures.evidence import ExposureEvidence
from ospc.exposures.findings import ExposureFindings
from ospc.exposures.table import ExposureTable
from ospc.exposures.used import as_source
from ospc.exposures.verdicts import findings_from
from ospc.methods.method import Method
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.grey_range import GreyRange
from ospc.photometry.response import Response
from ospc.photometry.verdict import Verdict
from ospc.photometry.vignette import diagonal_profile, usable_radius_of
from ospc.settings.methods import (
    COMMON_POWER_GREYS,
    COMMON_POWER_SIGMAS,
    COMMON_POWER_TOLERANCE,
    MIN_COMMON_POWER_LOG,
)


def checked_by_fit(
    method: Method, recorded: ExposureTable, found: ExposureFindings, grey_range: GreyRange, *, interlaced: bool
) -> tuple[ExposureTable, ExposureFindings]:
    """Return the exposures to use and the findings, checked against the method's fit.

    The fit may undo a correction of the lag, or show the lag if the images leave it open. It then has to agree with
    the moved exposures, too.
    """
    evidence = _with_fit(method, recorded, replace(found.evidence, interlaced=interlaced), grey_range)
    if evidence.fit_doubts_correction:
        as_recorded = _with_fit(method, recorded, evidence.without_correction(), grey_range)
        evidence = as_recorded if as_recorded.lag_is_smaller_than(evidence) else evidence
    if lag := evidence.lag_of_fit:
        moved = _with_fit(method, recorded, evidence.moved(lag), grey_range)
        evidence = moved if moved.fit_shows_no_lag else evidence
    return evidence.used(recorded), findings_from(evidence)


def _with_fit(
    method: Method, recorded: ExposureTable, evidence: ExposureEvidence, grey_range: GreyRange
) -> ExposureEvidence:
    inputs = method.inputs(evidence.used(recorded), grey_range)
    return evidence if inputs is None else evidence.with_fit(inputs.effects, inputs.corrected_ratios)


def compared_with_epoch_before(
    found: ExposureFindings, known: Calibration, before: Calibration | None
) -> ExposureFindings:
    """Return the findings about the exposures of a calibration, given that before the latest change of the camera."""
    power = None if before is None else common_power(before, known)
    if power is None:
        return found
    what = (
        f"since the camera changed, response and vignette are those before to the power of {power:.2f}, so the "
        "exposures are on another scale, as without a gain that follows them"
    )
    remedy = "record exposure × gain for every frame, and give the unit of the gain"
    return replace(found, verdict=Verdict("not identifiable", what, remedy), warnings=(*found.warnings, what))


def common_power(before: Calibration, after: Calibration) -> float | None:
    """Return the power of the earlier response and vignette that the later ones are; None if they are no such power.

    If the recorded exposures are a power of the true ones, the images show the same power of response and vignette.
    Another response leaves the vignette as it was, and another lens the response.
    """
    if before.response is None or after.response is None or before.vignette is None or after.vignette is None:
        return None
    if before.vignette_sigma is None or after.vignette_sigma is None:
        return None
    of_response, misfit = _power(*_log_responses(before.response, after.response))
    earlier, later = (diagonal_profile(one, PROFILE_RADII) for one in (before.vignette, after.vignette))
    of_vignette, _ = _power(np.log(earlier), np.log(later))
    usable = min(usable_radius_of(before.vignette), usable_radius_of(after.vignette))
    edge = np.flatnonzero(usable >= PROFILE_RADII)[-1]
    log_sigma = before.vignette_sigma[edge] / earlier[edge] + after.vignette_sigma[edge] / later[edge]
    sigma = log_sigma / max(abs(np.log(earlier[edge])), np.finfo(np.float64).tiny)
    alike = abs(of_response - of_vignette) < COMMON_POWER_TOLERANCE + COMMON_POWER_SIGMAS * sigma
    clear = of_vignette > 0 and abs(np.log(of_vignette)) > MIN_COMMON_POWER_LOG + COMMON_POWER_SIGMAS * sigma
    return of_response if alike and clear and misfit < COMMON_POWER_TOLERANCE else None


def _log_responses(before: Response, after: Response) -> tuple[FloatArray, FloatArray]:
    """Return ln g of both, relative to the middle of the grey levels that both have measured, shape (32,) each."""
    lowest = max(before.support[0], after.support[0])
    highest = max(min(before.support[1], after.support[1]), lowest)
    levels = np.linspace(lowest, highest, COMMON_POWER_GREYS)
    first, second = (np.log(one.inverse(levels) / one.inverse((lowest + highest) / 2)) for one in (before, after))
    return np.asarray(first), np.asarray(second)


def _power(before: FloatArray, after: FloatArray) -> tuple[float, float]:
    """Return the factor from one logarithm to another, and the misfit relative to the other."""
    squared = float(before @ before)
    power = float(before @ after) / squared if squared > 0 else 0.0
    left = after - power * before
    return power, float(np.sqrt(left @ left / max(float(after @ after), np.finfo(np.float64).tiny)))


def judged(known: Calibration, found: ExposureFindings, cause: str, changes: Sequence[str]) -> Calibration:
    """Return a calibration with the verdicts and warnings that its exposures and images allow.

    Parameters
    ----------
    known
        The calibration that the method returned.
    found
        The findings about its exposures.
    cause
        Why more frames like these would not help, which replaces the remedies of the verdicts; empty if they would.
    changes
        Earlier changes of the camera, as sentences.
    """
    verdicts = {name: found.doubted(verdict) for name, verdict in known.verdicts.items()}
    verdicts["exposures"] = found.verdict
    advice = (found.verdict.remedy, *known.advice) if found.warnings else known.advice
    if cause:
        verdicts = {n: v if v.state == "identifiable" else replace(v, remedy=cause) for n, v in verdicts.items()}
        advice = (cause, *advice)
    changed = (f"{change}; the calibration is for later frames" for change in changes)
    result = replace(
        known,
        verdicts=verdicts,
        converged=known.converged and not found.warnings,
        advice=tuple(dict.fromkeys(filter(None, advice))),
        source=known.source | as_source(found),
        notes=(*found.notes, *known.notes),
        warnings=(*found.warnings, *known.warnings, *changed),
    )
    return labelled(result) if found.evidence.choice == "estimated" else result
