"""A picture of several calibrations' responses and vignettes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ospc.errors import FormatError, MissingExtraError
from ospc.formats.opening import Photometry
from ospc.photometry.vignette import radial_profile


def plot_photometries(photometries: Sequence[Photometry], path: str | Path) -> Path:
    """Draw inverse responses and radial profiles of vignettes, and return the picture's path.

    Parameters
    ----------
    photometries
        At least one; names serve as legend.
    path
        Where to; the suffix says the kind of picture.

    Raises
    ------
    MissingExtraError
        Without matplotlib.
    FormatError
        If the picture cannot be written.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtraError("a plot", "plots") from None
    figure = Figure(figsize=(10, 4.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    for photometry in photometries:
        if photometry.response is not None:
            response = photometry.response
            (line,) = left.plot(255 * response.levels, response.inverse_table, label=photometry.name)
            if response.inverse_sigma is not None:
                low, high = (response.inverse_table + s * response.inverse_sigma for s in (-2, 2))
                left.fill_between(255 * response.levels, low, high, color=line.get_color(), alpha=0.2, lw=0)
        if photometry.vignette is not None:
            profile = radial_profile(photometry.vignette)
            right.plot((np.arange(profile.size) + 0.5) / profile.size, profile, label=photometry.name)
    left.set(
        title="Inverse response, with ±2σ where known",
        xlabel="grey value",
        ylabel="g, relative irradiance",
        xlim=(0, 255),
    )
    right.set(title="Vignette", xlabel="R (1 = corner)", ylabel="V, relative to the centre", xlim=(0, 1))
    for axes in (left, right):
        axes.grid(alpha=0.3)
        if axes.lines:
            axes.legend(fontsize="small")
    try:
        figure.savefig(path, dpi=120)
    except (OSError, ValueError) as error:
        raise FormatError(f"{path}: the plot cannot be written ({error})") from None
    return Path(path)
