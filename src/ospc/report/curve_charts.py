"""Response and vignette with their uncertainty and the density of the data, as charts of a page."""

from __future__ import annotations

import base64
from dataclasses import dataclass, replace

import cv2
import numpy as np

from ospc.arrays import FloatArray, Image, IntArray
from ospc.formats.opening import Photometry
from ospc.photometry.calibration import PROFILE_RADII, Calibration
from ospc.photometry.vignette import Vignette, radial_profile
from ospc.report.svg import Chart, Scale, figure

_MOST_LEVELS = 257
_MAP_WIDTH_PX = 320
_MAP_STEP = 0.05


@dataclass(frozen=True)
class _Curve:
    """A curve to draw: places, estimate, its standard deviation and the truth where these are known, colour."""

    x: FloatArray
    value: FloatArray
    sigma: FloatArray | None
    known: FloatArray | None
    colour: str

    @property
    def judged(self) -> bool:
        """Whether anything is known about its error."""
        return self.sigma is not None or self.known is not None


def response_figure(calibration: Calibration, truth: Photometry | None = None) -> str:
    """Return g over grey levels, its uncertainty by itself, and how often each grey level was seen."""
    response, white = calibration.response, calibration.max_grey
    assert response is not None
    index = np.unique(np.linspace(0, response.inverse_table.size - 1, _MOST_LEVELS).round().astype(int))
    level = response.levels[index]
    curve = _Curve(
        level * white,
        response.inverse_table[index],
        None if response.inverse_sigma is None else response.inverse_sigma[index],
        None if truth is None or truth.response is None else truth.response.inverse(level),
        "blue",
    )
    x = Scale(0, white, "grey level M")
    main = Chart(x, Scale(0, 1.02, "irradiance g(M), of saturation"), "Inverse response over grey levels", bare=True)
    charts, keys = _charts(main, x, curve, "g")
    if calibration.coverage is not None:
        charts.append(_density(x, calibration.coverage.by_grey))
        keys.append(("area green density", "samples"))
    low, high = response.support
    for chart in charts:
        chart.shade(0, low * white, "grey ground")
        chart.shade(high * white, white, "grey ground")
    if low > 0 or high < 1:
        keys.append(("area grey ground", "hardly measured: continued"))
    caption = "How much light makes which grey level; g(0) = 0 and g(largest) = 1 by convention."
    return _stacked(charts, keys, caption)


def vignette_figure(calibration: Calibration, truth: Photometry | None = None) -> str:
    """Return the radial profile of V, its uncertainty by itself, and how often each radius was seen."""
    vignette, sigma = calibration.vignette, calibration.vignette_sigma
    assert vignette is not None
    radius, value = profile_of(vignette)
    true = None if truth is None else truth.vignette
    curve = _Curve(
        radius,
        value,
        None if sigma is None else np.interp(radius, PROFILE_RADII, sigma),
        None if true is None else np.interp(radius, *profile_of(true)),
        "orange",
    )
    lowest = float(min(value.min(), value.min() if curve.known is None else curve.known.min()))
    x = Scale(0, 1, "distance from the image centre, 1 = corner")
    y = Scale(max(min(0.9, lowest - 0.08), 0.0), 1.04, "V, light that arrives")
    main = Chart(x, y, "Vignette over the distance from the centre", bare=True)
    charts, keys = _charts(main, x, curve, "V")
    if calibration.coverage is not None:
        charts.append(_density(x, calibration.coverage.by_radius))
        keys.append(("area green density", "samples"))
    return _stacked(
        charts, keys, "How much of the centre's light arrives at each distance from it, mean over angles."
    )


def vignette_map(vignette: Vignette) -> str:
    """Return V over the image, in steps, as a picture."""
    image = vignette.image()
    step = max(1, image.shape[1] // _MAP_WIDTH_PX)
    shown = image[::step, ::step]
    low, high = float(shown.min()), float(shown.max())
    bands = np.clip(np.floor(shown / _MAP_STEP) * _MAP_STEP, 0, 1)
    first = np.floor(low / _MAP_STEP) * _MAP_STEP
    scaled = (255 * (0.12 + 0.88 * (bands - first) / max(1 - first, _MAP_STEP))).clip(0, 255).astype(np.uint8)
    uri = data_uri(cv2.applyColorMap(scaled, cv2.COLORMAP_CIVIDIS), ".png")
    return (
        f'<figure><img class="map" src="{uri}" alt="Vignette over the image">'
        f"<figcaption>The vignette over the image, in steps of {_MAP_STEP:g}, from {low:.2f} (dark) to {high:.2f} "
        f"(bright).</figcaption></figure>"
    )


def profile_of(vignette: Vignette) -> tuple[FloatArray, FloatArray]:
    """Return radii and the radial profile, from the centre where it is 1 by convention."""
    profile = radial_profile(vignette)
    radius = (np.arange(profile.size) + 0.5) / profile.size
    known = np.isfinite(profile)
    return np.concatenate([[0.0], radius[known]]), np.concatenate([profile[known][:1], profile[known]])


def data_uri(image: Image, kind: str, quality: int = 85) -> str:
    """Return an image of 8 bit as text that a page can hold; ``kind`` is ".png" or ".jpg"."""
    options = [cv2.IMWRITE_JPEG_QUALITY, quality] if kind == ".jpg" else [cv2.IMWRITE_PNG_COMPRESSION, 6]
    _done, encoded = cv2.imencode(kind, image, options)
    name = "jpeg" if kind == ".jpg" else "png"
    return f"data:image/{name};base64,{base64.b64encode(encoded.tobytes()).decode('ascii')}"


def _charts(main: Chart, x: Scale, curve: _Curve, name: str) -> tuple[list[Chart], list[tuple[str, str]]]:
    """Return the chart with the curve drawn, below it one of the uncertainty by itself, and what the marks mean."""
    _draw_curve(main, curve)
    keys = [(f"line {curve.colour}", "estimate")]
    if curve.sigma is not None:
        keys += [(f"area {curve.colour} close", "±1σ"), (f"area {curve.colour} wide", "±2σ")]
    if curve.known is not None:
        keys += [("dashed ink", "reference"), ("line ink thin", "estimate − reference")]
    return ([main, _strip(x, curve, name)] if curve.judged else [main]), keys


def _draw_curve(chart: Chart, curve: _Curve) -> None:
    if curve.sigma is not None:
        for times, strength in ((2, "wide"), (1, "close")):
            reach = times * curve.sigma
            chart.band(curve.x, curve.value - reach, curve.value + reach, f"{curve.colour} {strength}")
    chart.line(curve.x, curve.value, curve.colour)
    if curve.known is not None:
        chart.line(curve.x, curve.known, "ink dashed")


def _strip(x: Scale, curve: _Curve, name: str) -> Chart:
    """Return the uncertainty by itself, where it can be seen, and the error where the truth is known."""
    error = None if curve.known is None else curve.value - curve.known
    drawn = [np.abs(v) for v in (error, None if curve.sigma is None else 2 * curve.sigma) if v is not None]
    extent = 1.15 * max(1e-4, *(float(v.max()) for v in drawn))
    label = f"±σ of {name}" if error is None else f"±σ and error of {name}"
    chart = Chart(x, Scale(-extent, extent, label), label, height=90, bare=True)
    _draw_curve(chart, replace(curve, value=np.zeros_like(curve.value), known=None))
    if error is not None:
        chart.line(curve.x, error, "ink thin")
    return chart


def _density(x: Scale, counts: IntArray) -> Chart:
    most = max(10.0, 1.3 * float(counts.max()))
    chart = Chart(x, Scale(1.0, most, "samples", logarithmic=True), "Number of samples", height=70)
    chart.bars(np.linspace(x.low, x.high, len(counts) + 1), np.maximum(counts, 0.1), "green density")
    return chart


def _stacked(charts: list[Chart], keys: list[tuple[str, str]], caption: str) -> str:
    lowest = charts[-1]
    return figure([*(chart.svg() for chart in charts[:-1]), lowest.svg(bare=False)], keys, caption)
