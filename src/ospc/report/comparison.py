"""A picture that compares the responses and vignettes of several calibrations."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ospc.formats.opening import Photometry
from ospc.photometry.calibration import PROFILE_RADII
from ospc.photometry.vignette import diagonal_profile
from ospc.report.curves import RADIUS_LABEL
from ospc.report.style import BLACK, BLUE, GREEN, ORANGE, new_figure, printable, rules, save

_STYLES = ((BLUE, "-"), (ORANGE, "--"), (GREEN, "-."), (BLACK, ":"))
"""Colours and lines of successive calibrations: those that lie on one another can still be told apart."""


_LETTERS = 40
"""Most letters of a name in a legend: a longer one would leave no room for the curves. Its end tells most."""


def plot_photometries(photometries: Sequence[Photometry], path: str | Path) -> Path:
    """Draw inverse responses and radial profiles of vignettes, and return the path of the picture."""
    with rules():
        figure = new_figure(9.6, 4.4)
        left, right = figure.subplots(1, 2)
        for number, photometry in enumerate(photometries):
            colour, line = _STYLES[number % len(_STYLES)]
            name = printable(photometry.name)
            # A label that began with an underscore would be left out of the legend.
            label = f" {name}" if len(name) <= _LETTERS else f" …{name[-_LETTERS:]}"
            if photometry.response is not None:
                response = photometry.response
                left.plot(255 * response.levels, response.inverse_table, line, color=colour, label=label)
                if response.inverse_sigma is not None:
                    low, high = (response.inverse_table + s * response.inverse_sigma for s in (-2, 2))
                    left.fill_between(255 * response.levels, low, high, color=colour, alpha=0.2, lw=0)
            if photometry.vignette is not None:
                profile = diagonal_profile(photometry.vignette, PROFILE_RADII)
                right.plot(PROFILE_RADII, profile, line, color=colour, label=label)
        left.set(
            title="Inverse response, with ±2σ of its shape", xlabel="grey level, of 255", ylabel="irradiance g(M)"
        )
        left.set(xlim=(0, 255), ylim=(0, 1.02))
        right.set(title="Vignette", xlabel=RADIUS_LABEL, ylabel="attenuation V", xlim=(0, 1))
        for axes in (left, right):
            if axes.lines:
                for text in axes.legend().get_texts():
                    text.set_parse_math(False)
        return save(figure, Path(path))
