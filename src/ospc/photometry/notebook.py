"""Small SVG plots of the curves of a calibration, for notebooks."""

from __future__ import annotations

import numpy as np

from ospc.arrays import FloatArray

_WIDTH, _HEIGHT, _MARGIN = 220, 150, 24
"""Size of a plot and the margin around its axes, in pixels."""
_SIGMAS = 2.0
"""Half width of a confidence band in standard deviations, as in the report."""


def curve_as_svg(title: str, x_label: str, x: FloatArray, y: FloatArray, sigma: FloatArray | None) -> str:
    """Return a curve over [0, 1] × [0, 1], with its confidence band if ``sigma`` is known."""
    band = ""
    if sigma is not None:
        around = _points(x, y + _SIGMAS * sigma) + _points(x, y - _SIGMAS * sigma)[::-1]
        band = f'<polygon points="{" ".join(around)}" fill="currentColor" opacity="0.25"/>'
    left, right, top, bottom = _MARGIN, _WIDTH - _MARGIN, _MARGIN, _HEIGHT - _MARGIN
    parts = [
        f'<svg width="{_WIDTH}" height="{_HEIGHT}" role="img" aria-label="{title}" ',
        'font-size="11" fill="currentColor">',
        f'<text x="{left}" y="15">{title}</text>',
        f'<text x="{right}" y="{_HEIGHT - 8}" text-anchor="end">{x_label}</text>',
        f'<text x="{left - 12}" y="{top + 8}">1</text><text x="{left - 12}" y="{bottom}">0</text>',
        f'<path d="M{left} {top}V{bottom}H{right}" fill="none" stroke="currentColor" opacity="0.5"/>',
        band,
        f'<polyline points="{" ".join(_points(x, y))}" fill="none" stroke="currentColor" stroke-width="1.5"/></svg>',
    ]
    return "".join(parts)


def _points(x: FloatArray, y: FloatArray) -> list[str]:
    across = _MARGIN + x * (_WIDTH - 2 * _MARGIN)
    down = _HEIGHT - _MARGIN - np.clip(y, 0, 1) * (_HEIGHT - 2 * _MARGIN)
    return [f"{right:.1f},{below:.1f}" for right, below in zip(across, down, strict=True)]
