"""What a fit shows about the exposures, and which verdicts exposures and images allow on a calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ospc.exposures.findings import ExposureFindings
from ospc.exposures.table import ExposureTable
from ospc.exposures.used import as_source
from ospc.exposures.verdicts import findings_from
from ospc.methods.method import Method
from ospc.photometry.calibration import Calibration
from ospc.photometry.grey_range import GreyRange


def checked_by_fit(
    method: Method, exposures: ExposureTable, found: ExposureFindings, grey_range: GreyRange, *, interlaced: bool
) -> tuple[ExposureTable, ExposureFindings]:
    """Return exposures and findings, checked against the method's fit, which may undo a correction of the lag."""
    evidence = replace(found.evidence, interlaced=interlaced)
    inputs = method.inputs(exposures, grey_range)
    if inputs is not None:
        evidence = evidence.with_fit(inputs.effects, inputs.ratios)
        if evidence.refutes_correction:
            exposures, evidence = replace(exposures, lag_frames=0), evidence.without_correction()
            again = method.inputs(exposures, grey_range)
            evidence = evidence if again is None else evidence.with_fit(again.effects, again.ratios)
    return exposures, findings_from(evidence)


def judged_calibration(
    known: Calibration, found: ExposureFindings, cause: str, changes: Sequence[str]
) -> Calibration:
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
    verdicts = {name: found.limited(verdict) for name, verdict in known.verdicts.items()}
    verdicts["exposures"] = found.verdict
    advice = (found.verdict.remedy, *known.advice) if found.warnings else known.advice
    if cause:
        verdicts = {n: v if v.state == "identifiable" else replace(v, remedy=cause) for n, v in verdicts.items()}
        advice = (cause, *advice)
    changed = (f"{change}; the calibration is for later frames" for change in changes)
    return replace(
        known,
        verdicts=verdicts,
        converged=known.converged and not found.warnings,
        advice=tuple(dict.fromkeys(filter(None, advice))),
        source=known.source | as_source(found),
        notes=(*found.notes, *known.notes),
        warnings=(*found.warnings, *known.warnings, *changed),
    )
