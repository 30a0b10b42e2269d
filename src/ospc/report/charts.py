"""The charts of reports and pictures, each with title, caption and drawing function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ospc.arrays import FloatArray
from ospc.photometry.calibration import Calibration
from ospc.photometry.coverage import Coverage, ExposureRatios
from ospc.report import curves, evidence
from ospc.report.style import BLUE, ORANGE, as_svg, new_figure, rules

if TYPE_CHECKING:
    from ospc.formats.opening import Photometry

WIDTH_IN = 4.6
"""Width of a chart; with letters of 9 points, charts are readable on a phone too."""

_HEIGHT_IN, _HEIGHT_WITH_PANELS_IN = 3.2, 4.6

_MARGINS_IN = {"left": 0.86, "right": 0.12, "top": 0.28, "bottom": 0.48}
"""Room around the axes of a chart for its title and labels."""


@dataclass(frozen=True)
class ReportFindings:
    """The data for charts; unknown parts are None.

    ``exposures_ms`` are those of the metadata, shape (frames,), or estimated ones if the calibration states that they
    were unknown. ``truth`` is a reference that is drawn with the calibration.
    """

    calibration: Calibration
    exposures_ms: FloatArray | None = None
    truth: Photometry | None = None

    @cached_property
    def charts(self) -> dict[str, Chart]:
        """The charts that can be drawn, by name, in the order of a report.

        "response" and "vignette" are always included; if one is unknown, its chart says so.
        """
        calibration, coverage = self.calibration, self.calibration.coverage
        known = not calibration.exponent_sigma
        charts = _curves(calibration, self.truth)
        charts |= _exposures(calibration.exposure_ratios, self.exposures_ms, known=known)
        return charts if coverage is None else charts | _coverage(coverage, calibration.max_grey, known=known)


@dataclass(frozen=True)
class Chart:
    """A chart that can be drawn into any figure: ``draw`` takes a cell of a grid and returns the topmost axes.

    The height is for a width of :data:`WIDTH_IN`. ``unknown`` is the reason why there is nothing to draw, or empty.
    """

    title: str
    caption: str
    draw: Callable[[Any], Any]
    height_in: float = _HEIGHT_IN
    unknown: str = ""

    def draw_into(self, cell: Any) -> None:
        """Draw the chart with its title into a cell of a grid."""
        axes = curves.draw_text(cell, self.unknown) if self.unknown else self.draw(cell)
        axes.set_title(self.title)


def charts_as_svg(findings: ReportFindings) -> dict[str, str]:
    """Return the charts with content as elements for HTML, by title."""
    return {chart.title: chart_as_svg(chart) for chart in findings.charts.values() if not chart.unknown}


def chart_as_svg(chart: Chart) -> str:
    """Return a chart as an element for HTML."""
    with rules():
        figure = new_figure(WIDTH_IN, chart.height_in, _MARGINS_IN)
        chart.draw_into(figure.add_gridspec(1, 1)[0])
        return as_svg(figure, chart.title)


def _curves(calibration: Calibration, truth: Photometry | None) -> dict[str, Chart]:
    response, vignette = (None, None) if truth is None else (truth.response, truth.vignette)
    charts = {
        "response": Chart(
            "Inverse response g",
            "Irradiance of each grey level, relative to saturation: g(0) = 0 and g(largest grey level) = 1 by "
            "convention. The lowest panel shows the number of observations.",
            partial(curves.draw_response, calibration=calibration, reference=response),
            _HEIGHT_WITH_PANELS_IN,
            _unknown(calibration, "response"),
        ),
        "vignette": Chart(
            "Vignette V",
            "Attenuation at each distance from the image centre, relative to the centre: the mean along the four "
            "half diagonals.",
            partial(curves.draw_vignette, calibration=calibration, reference=vignette),
            _HEIGHT_WITH_PANELS_IN,
            _unknown(calibration, "vignette"),
        ),
    }
    if calibration.vignette is not None:
        charts["vignette map"] = Chart(
            "Vignette over the image",
            "The attenuation at each pixel.",
            partial(curves.draw_vignette_map, vignette=calibration.vignette),
        )
    return charts


def _unknown(calibration: Calibration, part: str) -> str:
    if getattr(calibration, part) is not None:
        return ""
    verdict = calibration.verdicts.get(part)
    return "Unknown." if verdict is None else f"Unknown: {verdict.reason}."


_DOTS_OFF_THE_LINE = (
    "Dots off the line indicate exposures that belong to other frames, unrecorded changes of gain, or badly matched "
    "frames."
)
_CIRCULAR = "The exposures are themselves estimated from the images, so agreement does not confirm them."


def _exposures(ratios: ExposureRatios, exposures_ms: FloatArray | None, *, known: bool) -> dict[str, Chart]:
    charts: dict[str, Chart] = {}
    if not ratios.metadata.size:
        return charts
    if exposures_ms is not None and len(exposures_ms) > int(ratios.frames.max()):
        charts["exposures"] = Chart(
            "Exposures over time",
            "Each dot is the exposure of a frame as estimated from the images of a pair: the exposure of the earlier "
            f"frame, divided by the estimated ratio of the two. {_DOTS_OFF_THE_LINE if known else _CIRCULAR}",
            partial(evidence.draw_exposures, exposures_ms=exposures_ms, ratios=ratios, known=known),
        )
    charts["ratios"] = Chart(
        "Exposure ratios of pairs of frames",
        f"{'Dots on the line indicate agreement of images and metadata.' if known else _CIRCULAR} The median weights "
        "each pair by its samples.",
        partial(evidence.draw_ratios, ratios=ratios, known=known),
    )
    return charts


def _coverage(coverage: Coverage, max_grey: int, *, known: bool) -> dict[str, Chart]:
    by_grey, by_radius, by_place = (getattr(coverage, f"residual_by_{name}") for name in ("grey", "radius", "place"))
    charts = {
        "grey coverage": Chart(
            "Observations by grey level and exposure",
            "The response is estimated from the same light at several exposures. Filled columns are good; empty "
            "columns are grey levels that were never observed.",
            partial(evidence.draw_grey_coverage, coverage=coverage, max_grey=max_grey, known=known),
        ),
        "radius coverage": Chart(
            "Observations by radius in two frames",
            "The vignette is estimated from scene points that move between centre and corner. Observations away from "
            "the diagonal determine it; those on the diagonal do not.",
            partial(evidence.draw_radius_coverage, coverage=coverage),
        ),
    }
    if by_grey is not None:
        charts["grey residual"] = Chart(
            "Residuals over grey levels",
            "A median away from zero means that the model does not fit the response there. The width of the band "
            "shows noise and imperfect matching.",
            partial(evidence.draw_residual, quantiles=by_grey, x_end=max_grey, x_label="grey level M", colour=BLUE),
        )
    if by_radius is not None:
        charts["radius residual"] = Chart(
            "Residuals over the radius",
            "A median away from zero means that the model does not fit the vignette there.",
            partial(evidence.draw_residual, quantiles=by_radius, x_end=1, x_label=curves.RADIUS_LABEL, colour=ORANGE),
        )
    if by_place is not None and np.isfinite(by_place).any():
        charts["place residual"] = Chart(
            "Residuals over the image",
            "A large patch of one colour indicates shading that the model does not describe, or dirt on the lens. "
            "A random mixture of colours is noise.",
            partial(evidence.draw_place_residual, by_place=by_place),
        )
    return charts
