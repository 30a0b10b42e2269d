"""The calibration in words: headline, facts, and the figures of tracking."""

from __future__ import annotations

import json
from collections.abc import Iterator

import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import counted
from ospc.evaluation.tracking import TrackingComparison
from ospc.evaluation.tracks import TrackFigures
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette, diagonal_profile, unknown_part_in_words

_LONGEST_LIST = 24
"""Most entries of a list that are shown."""


def tracking_rows(tracking: TrackingComparison) -> Iterator[tuple[str, str, str, str]]:
    """Yield label, figure as recorded, figure corrected, and unit of each row."""
    causes = tuple(tracking.raw.lost)

    def figures(tracks: TrackFigures) -> list[str]:
        median = f"> {tracking.horizon}" if tracks.median_life is None else str(tracks.median_life)
        lost = [tracks.lost[cause] for cause in causes]
        shares = [f"{count / max(tracks.steps, 1):.2%}" for count in (sum(lost), *lost)]
        return [f"{tracks.mean_life:.1f}", median, *shares, f"{tracks.residual:.3f}"]

    labels = {
        "mean lifetime of a track": f"frames, of at most {tracking.horizon}",
        "median lifetime": "frames",
        "tracks lost": "of the steps from frame to frame",
        **{f"  {cause}": "" for cause in causes},
        "brightness residual": "of the local contrast, median",
    }
    for (label, unit), before, after in zip(
        labels.items(), figures(tracking.raw), figures(tracking.corrected), strict=True
    ):
        yield label, before, after, unit


def name_of(calibration: Calibration) -> str:
    """Return the name of the recording."""
    return str(calibration.source.get("name") or "a camera")


def basis_of(calibration: Calibration) -> str:
    """Return a one-line description of the data behind the calibration."""
    counts = calibration.counts
    parts = [f"{calibration.size[0]}×{calibration.size[1]} pixels", f"grey levels up to {calibration.max_grey}"]
    parts += [counted(counts[f"{noun}s"], noun) for noun in ("frame", "pair", "sample") if f"{noun}s" in counts]
    if counts.get("skipped"):
        parts.append(f"{counted(counts['skipped'], 'frame')} skipped")
    if calibration.partial:
        parts.append("partial")
    return " · ".join(parts)


def shown(value: object) -> str:
    """Return the value of a setting as short text."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        text = ", ".join(shown(item) for item in value[:_LONGEST_LIST])
        return f"{text}, … ({len(value)} in all)" if len(value) > _LONGEST_LIST else text
    return value if isinstance(value, str) else json.dumps(value, default=str)


def sentence(text: str) -> str:
    """Return a text as a sentence, with an initial capital and a full stop."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}." if text else ""


_LINEAR_WITHIN = 0.05
"""Largest distance of the gamma exponent from 1 at which a response is called linear."""
_UNEVEN = 0.01
"""Smallest difference that is mentioned between the corners, or between the centre and the brightest point."""
_HARDLY_VIGNETTED = 0.98
"""Attenuation at the corners above which there is hardly any vignetting: less than 3 hundredths of a stop."""


def headline(calibration: Calibration) -> str:
    """Return the overall result in one or two sentences."""
    states = {name: verdict.state for name, verdict in calibration.verdicts.items()}
    known = [name for name, state in states.items() if state == "identifiable"]
    rough = [name for name, state in states.items() if state == "marginal"]
    unknown = [name for name, state in states.items() if state == "not identifiable"]
    parts = []
    for names, said in ((known, "of this camera {} well determined"), (rough, "{} known only approximately")):
        if names:
            verb = "is" if names in (["response"], ["vignette"]) else "are"
            parts.append(f"The {_listed(names)} {said.format(verb)}.")
    if curves := [name for name in unknown if name != "exposures"]:
        parts.append(f"This recording does not determine the {_listed(curves)}; no estimate is given.")
    if "exposures" in unknown:
        parts.append("The exposures could not be confirmed.")
    if calibration.exponent_sigma:
        parts.append(f"{calibration.caveat}, chosen so that the response resembles that of a typical camera.")
    elif calibration.caveat:
        parts.append(f"{calibration.caveat}.")
    if calibration.partial:
        parts.append("The run stopped early, so this result is partial.")
    return " ".join(parts) or "This calibration does not state its uncertainty."


def overall_state(calibration: Calibration) -> str:
    """Return the common state of all verdicts; "marginal" if they differ."""
    states = {verdict.state for verdict in calibration.verdicts.values()}
    return states.pop() if len(states) == 1 else "marginal"


def facts(calibration: Calibration, tracking: TrackingComparison | None = None) -> list[str]:
    """Return one sentence each on response, vignette, exposures and the effect on tracking."""
    found: list[str] = []
    if calibration.response is not None:
        found.append(_response_fact(calibration.response, calibration.max_grey))
    if calibration.vignette is not None:
        found.append(_vignette_fact(calibration.vignette, calibration.vignette_sigma))
    ratios = calibration.exposure_ratios
    if ratios.metadata.size and calibration.response is not None and not calibration.exponent_sigma:
        found.append(
            f"Exposure ratios estimated from the images agree with the metadata to {_percent(ratios.misfit)} "
            f"(median over {counted(ratios.metadata.size, 'pair')} of frames, weighted by their samples)."
        )
    if tracking is not None:
        sentence = tracking.sentence
        found.append(f"In an excerpt of this recording, {sentence[0].lower()}{sentence[1:]}")
    return found


def _response_fact(response: Response, max_grey: int) -> str:
    middle, sigma = float(response.inverse(0.5)), None
    if response.log_sigma is not None and response.scale_sigma is not None:
        sigma = middle * float(np.hypot(np.interp(0.5, response.levels, response.log_sigma), response.scale_sigma))
    return (
        f"Middle grey ({max_grey / 2:.0f} of {max_grey}) corresponds to {_percent(middle, sigma)} of the irradiance "
        f"that saturates the sensor{_like_curve(middle)}.{_shape_fact(response, max_grey)}"
    )


def _shape_fact(response: Response, max_grey: int) -> str:
    """State the uncertainty of irradiance ratios over the observed grey levels."""
    if response.log_sigma is None:
        return ""
    low, high = response.support
    seen = response.measured
    if not seen.any():
        return ""
    typical, most = (float(of(response.log_sigma[seen])) for of in (np.median, np.max))
    known = _spread(typical)
    if most > 2 * typical:
        known += f" typically and {_spread(most)} at worst"
    return (
        f" Between grey levels {low * max_grey:.0f} and {high * max_grey:.0f} the ratio of two irradiances is known "
        f"to {known}, whatever the scale of the response."
    )


def _spread(log_sigma: float) -> str:
    return f"±{100 * log_sigma:.2g} %"


def _like_curve(middle: float) -> str:
    """Describe the gamma curve, g(M) = M to the power γ, with the same irradiance at middle grey."""
    if not 0 < middle < 1:
        return ""
    exponent = float(np.log(middle) / np.log(0.5))
    if abs(exponent - 1) < _LINEAR_WITHIN:
        return ", as in a linear camera"
    return f", as on a gamma curve with exponent {exponent:.2f}"


def _vignette_fact(vignette: Vignette, sigma: FloatArray | None) -> str:
    if unknown := unknown_part_in_words(vignette):
        return f"{unknown[0].upper()}{unknown[1:]}."
    corner = float(diagonal_profile(vignette, PROFILE_RADII[-1:])[0])
    text = f"The corners receive {_percent(corner, None if sigma is None else sigma[-1])} of the light at the centre"
    image = vignette.image()
    centre = float(vignette.at((np.array(vignette.size) - 1) / 2))
    corners, brightest = image[[0, 0, -1, -1], [0, -1, 0, -1]] / centre, float(image.max()) / centre
    if np.ptp(corners) > _UNEVEN:
        text += f" on average ({100 * corners.min():.0f} to {100 * corners.max():.0f} %)"
    if corner > _HARDLY_VIGNETTED:
        text += ": there is hardly any vignetting"
    elif corner > 0:
        text += f", {-np.log2(corner):.1f} stops less"
    if brightest - 1 > _UNEVEN:
        relative = _percent(corner / brightest)
        text += f"; relative to the brightest point, as in vignette.png, they receive {relative}"
    return f"{text}."


def _percent(share: float, sigma: float | None = None) -> str:
    """Return a share in per cent, rounded to the first digit of its standard deviation, or to two digits."""
    percent, spread = 100 * share, 100 * (share / 10 if sigma is None else sigma)
    digits = int(np.clip(np.ceil(-np.log10(max(spread, 1e-9))), 0, 3))
    return f"{percent:.{digits}f} %" if sigma is None else f"{percent:.{digits}f} ± {spread:.{digits}f} %"


def _listed(names: list[str]) -> str:
    *first, last = names
    return f"{', the '.join(first)} and the {last}" if first else last
