"""The recordings of the accuracy gate, and its error limits."""

from __future__ import annotations

from dataclasses import replace

from ospc.simulation import SimulationSettings

_SHORT = SimulationSettings(size=(320, 240), frames=110)

RECORDINGS = {
    # Edges everywhere, moving objects, and a lens that loses more than half of the light in the corners.
    "texture": replace(
        _SHORT, frames=80, seed=3, response="srgb", vignette_coefficients=(-0.45, 0.05, -0.15), moving_objects=6
    ),
    # So strongly curved and noisy that the point of linearisation matters.
    "curved": replace(_SHORT, seed=5, response="log", noise="high"),
    # Dark, noisy and steep: the mean of noisy pixels is not the grey level of their mean.
    "dark": replace(
        _SHORT,
        frames=180,
        seed=26,
        response="log",
        exposure="cycle",
        exposures_ms=(1.5, 3.0, 6.0, 12.0),
        full_well_electrons=1200.0,
        read_noise_electrons=10.0,
    ),
    # A wide lens and little noise: any error of the vignette shows.
    "wide": replace(_SHORT, seed=4, scene_seed=3, response="filmic", vignette="cos4", horizontal_fov_deg=90.0),
    # So fast that most frames do not overlap: registration finds only chance matches in these.
    "fast": replace(_SHORT, frames=80, seed=7, scene_seed=3, response="srgb", speed=12.0),
}
"""Recordings, each sensitive to a different kind of error."""

LIMITS: dict[str, dict[str, float]] = {
    "texture": {"shape": 0.0015, "kappa": 0.002, "vignette": 0.002},
    "curved": {"shape": 0.0035, "kappa": 0.01, "vignette": 0.0033},
    "dark": {"shape": 0.0014, "kappa": 0.0012, "dark": 0.007, "vignette": 0.0034},
    "wide": {"shape": 0.001, "kappa": 0.0024, "vignette": 0.0018},
    "fast": {"shape": 0.0018, "kappa": 0.0028, "vignette": 0.0022},
}
"""The largest accepted errors: twice the measured ones."""
