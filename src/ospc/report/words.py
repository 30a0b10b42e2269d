"""A calibration in plain words: what is known, how well, what it means."""

from __future__ import annotations

import numpy as np

from ospc.arrays import BoolArray, FloatArray
from ospc.photometry.calibration import PROFILE_RADII, Calibration, ExposureRatios
from ospc.photometry.coverage import Coverage
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette, radial_profile

FOUNDED, WELL_FOUNDED = 50, 120
"""Samples from which the exposure ratio of a pair of frames is worth looking at by itself; those of pairs that were
matched wrongly are seldom that many, and hardly ever so many as the second."""

_ENOUGH_PAIRS = 20
_FEW = 30


def headline(calibration: Calibration) -> str:
    """Return the verdict on the whole in one sentence or two."""
    states = {name: verdict.state for name, verdict in calibration.verdicts.items()}
    known = [name for name, state in states.items() if state == "identifiable"]
    rough = [name for name, state in states.items() if state == "marginal"]
    lost = [name for name, state in states.items() if state == "not identifiable"]
    parts = []
    if known:
        parts.append(f"The {_both(known)} of this camera {_are(known)} known well.")
    if rough:
        parts.append(f"The {_both(rough)} {_are(rough)} known only roughly.")
    if lost:
        parts.append(f"This recording does not tell the {_both(lost)}, so none is given.")
    if calibration.exponent_sigma:
        parts.append(
            "No exposures were known: response, vignette and exposures are estimated up to one common exponent, "
            "which is assumed to be that of a usual camera."
        )
    if calibration.partial:
        parts.append("The run ended before the end of the recording; more frames would tell more.")
    return " ".join(parts) or "Nothing is said about how well this calibration is known."


def overall_state(calibration: Calibration) -> str:
    """Return the state that all parts share; "marginal" where they differ."""
    states = {verdict.state for verdict in calibration.verdicts.values()}
    return states.pop() if len(states) == 1 else "marginal"


def facts(calibration: Calibration) -> list[str]:
    """Return what the calibration says of the camera, one sentence each."""
    found: list[str] = []
    if calibration.response is not None:
        found.append(_response_fact(calibration.response, calibration.max_grey))
    if calibration.vignette is not None:
        found.append(_vignette_fact(calibration.vignette, calibration.vignette_sigma))
    ratios = calibration.exposure_ratios
    founded = ratios.samples >= least_samples(ratios)
    if founded.any() and calibration.response is not None and not calibration.exponent_sigma:
        misfit = float(np.median(np.abs(ratios.log_residual[founded])))
        found.append(
            f"Ratios of exposures, taken from the images alone, agree with those stated to {_percent(misfit)} "
            f"(median over {int(founded.sum())} pairs of frames)."
        )
    return found


def uncovered_greys(coverage: Coverage, max_grey: int) -> str:
    """Return which grey levels were hardly seen, in words; empty where none."""
    spans = _spans(coverage.by_grey < _FEW)
    classes = len(coverage.by_grey)
    named = [f"{round(a * max_grey / classes)}–{round(b * max_grey / classes)}" for a, b in spans]
    return f"grey levels {', '.join(named)}" if named else ""


def uncovered_radii(coverage: Coverage) -> str:
    """Return which distances from the centre were hardly seen, in words; empty where none."""
    classes = len(coverage.by_radius)
    named = [f"{a / classes:.2f}–{b / classes:.2f}" for a, b in _spans(coverage.by_radius < _FEW)]
    return f"radii {', '.join(named)}" if named else ""


def least_samples(ratios: ExposureRatios) -> int:
    """Return from how many samples on a pair of frames counts as well-founded: more where there are many pairs."""
    return WELL_FOUNDED if np.sum(ratios.samples >= WELL_FOUNDED) >= _ENOUGH_PAIRS else FOUNDED


def misfit_of(ratios: ExposureRatios) -> float:
    """Return the median misfit |Δ ln k| of well-founded pairs, of all where there are none; NaN without pairs."""
    founded = ratios.samples >= least_samples(ratios)
    residual = np.abs(ratios.log_residual[founded] if founded.any() else ratios.log_residual)
    return float(np.median(residual)) if residual.size else float("nan")


def corner(vignette: Vignette) -> float:
    """Return V near the corners, the mean over them."""
    profile = radial_profile(vignette)
    return float(profile[np.isfinite(profile)][-1])


def _response_fact(response: Response, max_grey: int) -> str:
    middle, sigma = float(response.inverse(0.5)), None
    if response.inverse_sigma is not None:
        sigma = float(np.interp(0.5, response.levels, response.inverse_sigma))
    low, high = response.inverse([0.25, 0.75])
    exponent = float(np.log(high / low) / np.log(3))  # between greys that were measured, unlike the ends
    return (
        f"Middle grey ({max_grey / 2:.0f} of {max_grey}) is {_percent(middle, sigma)} of the light that "
        f"saturates the sensor, {_kind_of_curve(exponent)}."
    )


def _kind_of_curve(exponent: float) -> str:
    if abs(exponent - 1) < 0.05:
        return "as of a linear camera"
    return f"as of a gamma curve with exponent {exponent:.2g}"


def _vignette_fact(vignette: Vignette, sigma: FloatArray | None) -> str:
    value = corner(vignette)
    spread = None if sigma is None else float(np.interp(0.98, PROFILE_RADII, sigma))
    said = f"The corners get {_percent(value, spread)} of the light of the centre"
    return f"{said}: there is hardly a vignette." if value > 0.98 else f"{said}, {-np.log2(value):.1f} stops less."


def _percent(share: float, sigma: float | None = None) -> str:
    """Return a share, with its standard deviation where known, and digits enough to mean something."""
    percent, spread = 100 * share, 100 * (share / 10 if sigma is None else sigma)
    digits = int(np.clip(np.ceil(-np.log10(max(spread, 1e-9))), 0, 3))
    return f"{percent:.{digits}f} %" if sigma is None else f"{percent:.{digits}f} ± {spread:.{digits}f} %"


def _both(names: list[str]) -> str:
    return " and the ".join(names)


def _are(names: list[str]) -> str:
    return "is" if len(names) == 1 else "are"


def _spans(mask: BoolArray) -> list[tuple[int, int]]:
    """Return where a mask is true, as half-open ranges."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], np.asarray(mask, bool), [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
