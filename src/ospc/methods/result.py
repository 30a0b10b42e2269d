"""The calibration that follows from a fit: curves with their uncertainty, verdicts, exposure ratios and advice."""

from __future__ import annotations

from ospc.arrays import FloatArray, ImageSize
from ospc.estimation.fit import Fit
from ospc.methods.contradictions import contradictions_of
from ospc.methods.corrections import corrected_exposures_of, notes_of
from ospc.methods.coverage import coverage_of
from ospc.methods.exposure_ratios import unexplained_share
from ospc.methods.fit_inputs import FitInputs
from ospc.methods.identifiability import response_verdict, vignette_verdict
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.settings import DefaultSettings
from ospc.settings.methods import CONTRADICTING_UNEXPLAINED_SHARE


def calibration_of(inputs: FitInputs, settings: DefaultSettings) -> Calibration:
    """Return the calibration that follows from the inputs; curves that they do not determine are None."""
    fit, observations, ratios = inputs.fit, inputs.used, inputs.ratios
    points = 0 if observations is None else len(observations.starts)
    unexplained = unexplained_share(ratios)
    # With exposures that the images contradict, a fit is meaningless, and so are its effects.
    trusted = None if unexplained > CONTRADICTING_UNEXPLAINED_SHARE else fit
    contradictions = () if trusted is None else contradictions_of(trusted)
    verdicts = {
        "response": response_verdict(settings, fit, observations, unexplained, contradictions),
        "vignette": vignette_verdict(
            fit, inputs.radial_motion, inputs.stationary, unexplained, size=inputs.size, contradictions=contradictions
        ),
    }
    response_known, vignette_known = verdicts["response"].known, verdicts["vignette"].known
    coverage = None if observations is None else coverage_of(observations, fit, inputs.size, inputs.grey_range)
    return Calibration(
        size=inputs.size,
        response=fit.response(inputs.max_grey, inputs.support, inputs.grey_range) if fit and response_known else None,
        vignette=fit.usable_vignette(inputs.size) if fit and vignette_known else None,
        verdicts=verdicts,
        vignette_sigma=vignette_sigma(fit, inputs.size) if fit and vignette_known else None,
        noise=inputs.noise,
        exposure_ratios=ratios,
        covariance={} if fit is None else covariance_of(fit, response_known, vignette_known),
        max_grey=inputs.max_grey,
        converged=all(verdict.state == "identifiable" for verdict in verdicts.values()),
        counts={"pairs": inputs.pairs, "samples": points},
        source={} if trusted is None or observations is None else corrected_exposures_of(trusted, observations),
        advice=(
            *(remedy for _, remedy in contradictions),
            *(verdict.remedy for verdict in verdicts.values() if verdict.remedy),
            *(() if coverage is None else coverage.gaps(inputs.max_grey, inputs.grey_range)),
        ),
        effects=() if trusted is None else trusted.effect_estimates,
        notes=(
            *(() if fit is None else inputs.notes),
            *(() if trusted is None else notes_of(trusted)),
        ),
        warnings=tuple(what for what, _ in contradictions),
        coverage=coverage,
    )


def vignette_sigma(fit: Fit, size: ImageSize) -> FloatArray:
    """Return the standard deviation of the profile at :data:`PROFILE_RADII`, shape (51,)."""
    return fit.vignette_errors(size).sigma(PROFILE_RADII)


def covariance_of(fit: Fit, response: bool, vignette: bool) -> dict[str, dict[str, object]]:
    """Return the parameter names and covariances of the known curves, in the format of a calibration."""
    n = len(fit.response_basis)
    found: dict[str, dict[str, object]] = {}
    if response:
        names = [f"gamma({knot:.4f})" for knot in fit.response_basis.knots]
        found["response"] = {"parameters": names, "matrix": fit.covariance[:n, :n].tolist()}
    if vignette:
        part = fit.vignette_part
        found["vignette"] = {
            "parameters": fit.vignette_basis.names,
            "matrix": fit.covariance[part, part].tolist(),
            "prior_walk": fit.hyperparameters.vignette_walk,
            "measured_radius": fit.measured_radius,
        }
    return found
