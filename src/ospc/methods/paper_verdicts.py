"""What the paper's method could and could not find, and why."""

from __future__ import annotations

from ospc.estimation.repetition import Estimates
from ospc.photometry.calibration import Verdict
from ospc.settings import PaperSettings


def response_verdict(
    settings: PaperSettings, estimates: Estimates, exposure_range_ms: tuple[float, float]
) -> Verdict:
    """Return whether the response is known, and what to record instead where it is not."""
    low, high = exposure_range_ms
    if high / low < settings.exposure_ratio_high:
        return Verdict(
            "not identifiable",
            f"the exposure hardly changes ({low:.4g} to {high:.4g} ms), so the response leaves no trace",
            "record with auto exposure on while moving between dark and bright places, or sweep the exposure",
        )
    if not estimates.accepted:
        return Verdict("not identifiable", _why_none(estimates, "small radial displacement"), _remedy(estimates))
    if len(estimates.accepted) < 2:
        return Verdict("marginal", "a single window of frames gave an estimate", "record longer")
    return Verdict("identifiable", f"{len(estimates.accepted)} windows of frames gave estimates that were accepted")


def vignette_verdict(settings: PaperSettings, estimates: Estimates, reach: float, response_known: bool) -> Verdict:
    """Return whether the vignette is known, and what to record instead where it is not.

    Parameters
    ----------
    settings
        The method's settings.
    estimates
        The vignettes accepted so far.
    reach
        Largest radial displacement that a tenth of some pair's matches exceeded.
    response_known
        Whether there is a response to correct the grey levels with.
    """
    needed = settings.vignette_min_radial_displacement
    if not response_known:
        return Verdict("not identifiable", "without a response there is no irradiance to compare", "")
    if not estimates.accepted:
        reason = (
            f"hardly any scene point moves radially by {needed:g} of the half diagonal "
            f"(nine in ten move less than {reach:.2g})"
            if reach < needed
            else _why_none(estimates, "large radial displacement")
        )
        remedy = "pan and roll the camera so that the same objects cross the image between centre and corners"
        return Verdict("not identifiable", reason, remedy)
    if len(estimates.accepted) < 2:
        return Verdict("marginal", "a single window of frames gave an estimate", "record longer")
    return Verdict("identifiable", f"{len(estimates.accepted)} windows of frames gave estimates that were accepted")


def _why_none(estimates: Estimates, wanted: str) -> str:
    if estimates.impossible and not estimates.rejected:
        return f"none of {estimates.impossible} estimates is positive everywhere"
    if estimates.rejected:
        return f"none of {estimates.rejected} estimates predicted the exposure ratios of the metadata"
    return f"too few matches with {wanted} between frames of different exposure"


def _remedy(estimates: Estimates) -> str:
    if estimates.rejected:
        return "check that exposures belong to their frames, and that gain and tone mapping are fixed"
    return "record a scene with more texture, moving slowly while the exposure changes"
