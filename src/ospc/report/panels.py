"""The panels that pictures are made of: response, vignette, exposure ratios."""

from __future__ import annotations

from typing import Any

import numpy as np

from ospc.arrays import FloatArray
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette, radial_profile
from ospc.report.style import BLACK, BLUE, GREEN, GREY, ORANGE

_BANDS = ((2, 0.18), (1, 0.32))
_MOST_POINTS = 4000


def draw_response(axes: Any, calibration: Calibration, truth: Response | None = None) -> None:
    """Draw g over grey levels with its uncertainty; where no measurement carries it, the ground is grey."""
    response = calibration.response
    axes.set(title="Inverse response g", xlabel="grey level", ylabel="irradiance g(M), 1 at the brightest")
    if response is None:
        _say_unknown(axes, calibration, "response")
        return
    grey = response.levels * calibration.max_grey
    low, high = (end * calibration.max_grey for end in response.support)
    for start, end, label in ((0, low, "not measured: continued"), (high, calibration.max_grey, None)):
        if end > start:
            axes.axvspan(start, end, color=GREY, alpha=0.25, lw=0, label=label)
    _band(axes, grey, response.inverse_table, response.inverse_sigma, BLUE)
    axes.plot(grey, response.inverse_table, color=BLUE, lw=2, label="estimate")
    if truth is not None:
        axes.plot(truth.levels * calibration.max_grey, truth.inverse_table, "--", color=BLACK, lw=1.3, label="truth")
    axes.set(xlim=(0, calibration.max_grey), ylim=(0, 1.02))
    axes.legend(loc="upper left")


def draw_vignette(axes: Any, calibration: Calibration, truth: Vignette | None = None) -> None:
    """Draw the radial profile of V, normalised to the centre, with its uncertainty."""
    vignette = calibration.vignette
    axes.set(title="Vignette V", xlabel="distance from the centre R, 1 at the corner", ylabel="attenuation V(R)")
    if vignette is None:
        _say_unknown(axes, calibration, "vignette")
        return
    radius, profile = _profile(vignette)
    sigma = calibration.vignette_sigma
    if sigma is not None:
        _band(axes, radius, profile, np.interp(radius, PROFILE_RADII, sigma), ORANGE)
    axes.plot(radius, profile, color=ORANGE, lw=2, label="estimate, mean over angles")
    lowest = float(np.nanmin(profile))
    if truth is not None:
        radius, profile = _profile(truth)
        axes.plot(radius, profile, "--", color=BLACK, lw=1.3, label="truth")
        lowest = min(lowest, float(np.nanmin(profile)))
    axes.set(xlim=(0, 1), ylim=(max(min(0.9, lowest - 0.1), 0.0), 1.05))
    axes.legend(loc="lower left")


def draw_exposures(axes: Any, calibration: Calibration) -> None:
    """Draw estimated against stated exposure ratios of pairs of frames."""
    ratios = calibration.exposure_ratios
    axes.set(
        title="Exposure ratios of pairs of frames",
        xlabel="k by the metadata",
        ylabel="k estimated from the images",
    )
    good = (ratios.metadata > 0) & (ratios.estimated > 0)
    if not good.any():
        _say(axes, "no pairs of frames could be compared")
        return
    step = int(np.ceil(good.sum() / _MOST_POINTS))
    metadata, estimated = ratios.metadata[good][::step], ratios.estimated[good][::step]
    both = np.concatenate([metadata, estimated])
    low, high = both.min() / 1.15, both.max() * 1.15
    axes.plot([low, high], [low, high], "--", color=BLACK, lw=1.3, label="equal", zorder=1)
    spread = float(np.median(np.abs(np.log(estimated / metadata))))
    label = f"{good.sum()} pairs, median |Δ ln k| {spread:.3g}"
    axes.scatter(metadata, estimated, s=14, color=GREEN, alpha=0.6, lw=0, label=label)
    _logarithmic(axes, low, high)
    axes.legend(loc="upper left")


def _logarithmic(axes: Any, low: float, high: float) -> None:
    """Scale both axes logarithmically, with ticks as plain numbers, few enough to be read."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    candidates = np.array([m * 10.0**e for e in range(-4, 5) for m in (1, 2, 5)])
    ticks = candidates[(candidates >= low) & (candidates <= high)]
    if ticks.size < 3:
        ticks = np.geomspace(low * 1.05, high / 1.05, 4)
    for name in ("x", "y"):
        getattr(axes, f"set_{name}scale")("log")
        axis = getattr(axes, f"{name}axis")
        axis.set_major_locator(FixedLocator(ticks[:: int(np.ceil(ticks.size / 7))].tolist()))
        axis.set_major_formatter(FuncFormatter(lambda value, _position: f"{value:.3g}"))
        axis.set_minor_locator(NullLocator())
    axes.set(xlim=(low, high), ylim=(low, high))


def _profile(vignette: Vignette) -> tuple[FloatArray, FloatArray]:
    """Return radii and profile, beginning at the centre where it is 1 by convention."""
    profile = radial_profile(vignette)
    radius = (np.arange(profile.size) + 0.5) / profile.size
    known = np.isfinite(profile)
    return np.concatenate([[0.0], radius[known]]), np.concatenate([profile[known][:1], profile[known]])


def _band(axes: Any, x: FloatArray, y: FloatArray, sigma: FloatArray | None, colour: str) -> None:
    if sigma is None:
        return
    for times, strength in _BANDS:
        low, high = y - times * sigma, y + times * sigma
        axes.fill_between(x, low, high, color=colour, alpha=strength, lw=0, label=f"±{times}σ")


def _say_unknown(axes: Any, calibration: Calibration, part: str) -> None:
    verdict = calibration.verdicts.get(part)
    _say(axes, f"not known:\n{verdict.reason}" if verdict is not None else "not known")


def _say(axes: Any, text: str) -> None:
    import textwrap

    wrapped = "\n".join(line for part in text.split("\n") for line in textwrap.wrap(part, 38))
    axes.set(xticks=[], yticks=[], xlim=(0, 1), ylim=(0, 1))
    axes.text(0.5, 0.5, wrapped, ha="center", va="center", transform=axes.transAxes, color=BLACK)
