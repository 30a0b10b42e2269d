"""The panels that pictures are made of: response, vignette, exposure ratios."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ospc.arrays import BoolArray, FloatArray, IntArray
from ospc.photometry.calibration import PROFILE_RADII, Calibration, ExposureRatios
from ospc.photometry.response import Response
from ospc.photometry.vignette import LogVignette, PolynomialVignette, Vignette, radial_profile
from ospc.report.style import BLACK, BLUE, GREEN, GREY, ORANGE
from ospc.report.words import least_samples, misfit_of

_BANDS = ((2, 0.2), (1, 0.35))
_MOST_POINTS = 4000
_PROFILE_SIDE = 400


def draw_response(axes: Any, calibration: Calibration, truth: Response | None = None) -> None:
    """Draw g over grey levels with its uncertainty; where no measurement carries it, the ground is grey."""
    response = calibration.response
    axes.set(title="Inverse response g", xlabel="grey level M", ylabel="irradiance g(M)")
    if response is None:
        _say_unknown(axes, calibration, "response")
        return
    _shade_unmeasured(axes, calibration, response)
    grey = response.levels * calibration.max_grey
    _band(axes, grey, response.inverse_table, response.inverse_sigma, BLUE)
    axes.plot(grey, response.inverse_table, color=BLUE, lw=2, label="estimate")
    if truth is not None:
        axes.plot(truth.levels * calibration.max_grey, truth.inverse_table, "--", color=BLACK, lw=1.3, label="truth")
    axes.set(xlim=(0, calibration.max_grey), ylim=(0, 1.02))
    axes.legend(loc="upper left")


def draw_response_error(axes: Any, calibration: Calibration, truth: Response | None = None) -> None:
    """Draw the uncertainty of g by itself, where it can be seen, and the error where the truth is known."""
    response = calibration.response
    axes.set(xlabel="grey level M", ylabel="error of g" if truth is not None else "±σ of g")
    if response is None or (response.inverse_sigma is None and truth is None):
        axes.set_visible(False)
        return
    _shade_unmeasured(axes, calibration, response, label=None)
    grey = response.levels * calibration.max_grey
    error = None if truth is None else response.inverse_table - truth.inverse(response.levels)
    _error_strip(axes, grey, error, response.inverse_sigma, BLUE)
    axes.set(xlim=(0, calibration.max_grey))


def draw_vignette(axes: Any, calibration: Calibration, truth: Vignette | None = None) -> None:
    """Draw the radial profile of V, 1 at the centre, with its uncertainty."""
    vignette = calibration.vignette
    axes.set(title="Vignette V", xlabel="distance from the image centre R (1 = corner)", ylabel="attenuation V(R)")
    if vignette is None:
        _say_unknown(axes, calibration, "vignette")
        return
    radius, profile = _profile(vignette)
    _band(axes, radius, profile, _vignette_sigma(calibration, radius), ORANGE)
    axes.plot(radius, profile, color=ORANGE, lw=2, label="estimate, mean over angles")
    lowest = float(profile.min())
    if truth is not None:
        radius, profile = _profile(truth)
        axes.plot(radius, profile, "--", color=BLACK, lw=1.3, label="truth")
        lowest = min(lowest, float(profile.min()))
    axes.set(xlim=(0, 1), ylim=(max(min(0.9, lowest - 0.1), 0.0), 1.05))
    axes.legend(loc="lower left")


def draw_vignette_error(axes: Any, calibration: Calibration, truth: Vignette | None = None) -> None:
    """Draw the uncertainty of V by itself, where it can be seen, and the error where the truth is known."""
    axes.set(
        xlabel="distance from the image centre R (1 = corner)",
        ylabel="error of V" if truth is not None else "±σ of V",
    )
    if calibration.vignette is None or (calibration.vignette_sigma is None and truth is None):
        axes.set_visible(False)
        return
    radius, profile = _profile(calibration.vignette)
    error = None
    if truth is not None:
        error = profile - np.interp(radius, *_profile(truth))
    _error_strip(axes, radius, error, _vignette_sigma(calibration, radius), ORANGE)
    axes.set(xlim=(0, 1))


def draw_vignette_map(axes: Any, vignette: Vignette) -> None:
    """Draw V over the image, with lines of equal attenuation."""
    image = vignette.image()
    step = max(1, max(image.shape) // 400)
    low = min(float(image.min()), 0.9)
    extent = (0, image.shape[1], image.shape[0], 0)
    shown = axes.imshow(image[::step, ::step], cmap="cividis", vmin=low, vmax=float(image.max()), extent=extent)
    x, y = (np.arange(0, n, step) for n in reversed(image.shape))
    lines = axes.contour(x, y, image[::step, ::step], levels=8, colors="white", linewidths=0.7)
    axes.clabel(lines, fontsize=7, fmt="%.2f")
    axes.figure.colorbar(shown, ax=axes, shrink=0.75, label="V")
    axes.set(title="Vignette over the image", xlabel="x [pixel]", ylabel="y [pixel]")
    axes.grid(visible=False)


def draw_exposures(axes: Any, calibration: Calibration) -> None:
    """Draw estimated against stated exposure ratios of pairs of frames."""
    axes.set(title="Exposure ratios k of pairs of frames", xlabel="k by the metadata", ylabel="k from the images")
    ratios = calibration.exposure_ratios
    if not ratios.metadata.size:
        _say(axes, "no pairs of frames could be compared")
        return
    chosen, founded = _chosen_pairs(ratios)
    metadata, estimated = ratios.metadata[chosen], ratios.estimated[chosen]
    limits = _limits(metadata, estimated, founded)
    axes.plot(limits, limits, "--", color=BLACK, lw=1.3, label="equal", zorder=1)
    axes.scatter(
        metadata[founded],
        estimated[founded],
        s=16,
        color=GREEN,
        alpha=0.65,
        lw=0,
        label=f"pair of frames\n(median |Δ ln k|: {misfit_of(ratios):.2g})",
    )
    if not founded.all():
        label = f"{np.sum(~founded)} pairs with fewer than {least_samples(ratios)} samples"
        axes.scatter(metadata[~founded], estimated[~founded], s=12, facecolors="none", edgecolors=GREY, label=label)
    logarithmic(axes, *limits, "xy")
    room_for_legend = (limits[1] / limits[0]) ** 0.25
    axes.set(xlim=limits, ylim=(limits[0], limits[1] * room_for_legend))
    axes.legend(loc="upper left")


def draw_exposures_over_time(axes: Any, calibration: Calibration) -> None:
    """Draw estimated and stated exposure ratios over the later frame of each pair."""
    ratios = calibration.exposure_ratios
    chosen, founded = _chosen_pairs(ratios)
    chosen = chosen[founded] if founded.any() else chosen
    chosen = chosen[np.argsort(ratios.frames[chosen].max(axis=1), kind="stable")]
    frame, metadata, estimated = ratios.frames[chosen].max(axis=1), ratios.metadata[chosen], ratios.estimated[chosen]
    axes.set(title="The same along the recording", xlabel="frame", ylabel="exposure ratio k")
    axes.locator_params(axis="x", integer=True)
    axes.plot(frame, metadata, "x", color=BLACK, ms=5, mew=1.1, label="metadata", zorder=3)
    axes.plot(frame, estimated, "o", color=GREEN, ms=5, mew=0, alpha=0.7, label="from the images")
    limits = _limits(metadata, estimated, np.ones(len(chosen), dtype=np.bool_))
    logarithmic(axes, *limits, "y")
    axes.set(ylim=limits)
    axes.legend(loc="best")


def _chosen_pairs(ratios: ExposureRatios) -> tuple[IntArray, BoolArray]:
    """Return indices of the pairs to draw, and which of them rest on enough samples."""
    step = int(np.ceil(ratios.metadata.size / _MOST_POINTS))
    chosen = np.arange(0, ratios.metadata.size, step)
    return chosen, ratios.samples[chosen] >= least_samples(ratios)


def _limits(metadata: FloatArray, estimated: FloatArray, founded: BoolArray) -> tuple[float, float]:
    """Return limits that show all well-founded pairs; a failed registration must not squeeze them together."""
    if 2 * np.sum(founded) >= founded.size:
        metadata, estimated = metadata[founded], estimated[founded]
    shown = np.concatenate([metadata, estimated])
    return float(shown.min() / 1.15), float(shown.max() * 1.15)


def _shade_unmeasured(
    axes: Any, calibration: Calibration, response: Response, label: str | None = "extrapolated"
) -> None:
    low, high = (end * calibration.max_grey for end in response.support)
    for start, end in ((0.0, low), (high, float(calibration.max_grey))):
        if end > start:
            axes.axvspan(start, end, color=GREY, alpha=0.3, lw=0, label=label)
            label = None


def _error_strip(axes: Any, x: FloatArray, error: FloatArray | None, sigma: FloatArray | None, colour: str) -> None:
    _band(axes, x, np.zeros_like(x), sigma, colour)
    if error is not None:
        axes.plot(x, error, color=BLACK, lw=1.2, label="estimate − truth")
    axes.axhline(0, color=colour, lw=1)
    extent = max(
        float(np.max(np.abs(values)))
        for values in (error, None if sigma is None else 2 * sigma)
        if values is not None
    )
    extent = 1.1 * max(extent, 1e-4)
    axes.set(ylim=(-extent, 1.8 * extent))  # room for the legend
    axes.legend(loc="upper left", ncols=3)


def _vignette_sigma(calibration: Calibration, radius: FloatArray) -> FloatArray | None:
    sigma = calibration.vignette_sigma
    return None if sigma is None else np.interp(radius, PROFILE_RADII, sigma)


def logarithmic(axes: Any, low: float, high: float, names: str) -> None:
    """Scale axes logarithmically, with ticks as plain numbers, few enough to be read."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

    decades = np.array([m * 10.0**e for e in range(-6, 7) for m in (1, 2, 5)])
    ticks = decades[(decades >= low) & (decades <= high)]
    if ticks.size < 4:
        ticks = np.array([tick for tick in MaxNLocator(6).tick_values(low, high) if low <= tick <= high])
    for name in names:
        getattr(axes, f"set_{name}scale")("log")
        axis = getattr(axes, f"{name}axis")
        axis.set_major_locator(FixedLocator(ticks[:: int(np.ceil(ticks.size / 7))].tolist()))
        axis.set_major_formatter(FuncFormatter(lambda value, _position: f"{value:g}"))
        axis.set_minor_locator(NullLocator())


def _profile(vignette: Vignette) -> tuple[FloatArray, FloatArray]:
    """Return radii and profile, beginning at the centre where it is 1 by convention."""
    if isinstance(vignette, PolynomialVignette | LogVignette):
        # A smooth model has the same profile in a smaller image.
        shrink = max(1, max(vignette.size) // _PROFILE_SIDE)
        vignette = replace(vignette, size=(vignette.size[0] // shrink, vignette.size[1] // shrink))
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
