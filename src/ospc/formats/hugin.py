"""Responses and vignettes in project files of hugin (.pto).

An image line has the vignette as Vb, Vc, Vd for radii that are 1 at the outer corner of a corner pixel, with a shift
Vx, Vy of its centre in pixels, and the response as five coefficients Ra to Re of the empirical model of response
(EMoR, Grossberg and Nayar 2004). The base curves of this model are not distributed with this package; they are read
from ``emor.txt`` of the authors.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ospc.arrays import FloatArray, ImageSize
from ospc.errors import FormatError
from ospc.formats.files import read_text, write_text
from ospc.formats.radial import RadialFit, fit_radial, rescaled
from ospc.formats.scanning import finite_number
from ospc.photometry.geometry import half_diagonal, image_size
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette

COMPONENTS = 5
"""Number of EMoR coefficients that hugin uses."""

EMOR_SAMPLES = 1024
"""Number of values of each curve in ``emor.txt``."""

_LEAST_STEP = 1e-7
"""Smallest step of a fitted response between samples; a linear response has steps of 1e-3."""

_FIELD = re.compile(r'([A-Za-z]+)(=?-?[0-9.][0-9.eE+-]*|"[^"]*")')
_LINK = re.compile(r"=(\d{1,6})", re.ASCII)


@dataclass(frozen=True)
class EmorBasis:
    """Irradiances from 0 to 1 and the mean response f₀, shape (1024,), and h₁, h₂, …, shape (n, 1024)."""

    irradiance: FloatArray
    mean: FloatArray
    components: FloatArray

    def response(self, coefficients: tuple[float, ...]) -> Response:
        """Return the response f = f₀ + Σ cᵢhᵢ; FormatError if it does not increase."""
        forward = self.mean + np.asarray(coefficients) @ self.components
        if np.any(np.diff(forward) <= 0):
            raise FormatError("the response of these EMoR coefficients does not increase everywhere")
        forward = (forward - forward[0]) / (forward[-1] - forward[0])
        inverse = np.interp(np.linspace(0, 1, 256), forward, self.irradiance)
        return Response.from_values(inverse, model={"name": "emor", "coefficients": list(coefficients)})

    def fit(self, response: Response) -> tuple[tuple[float, ...], float]:
        """Return the best coefficients for which f increases, and the root mean square residual."""
        target = response(self.irradiance) - self.mean
        coefficients = np.linalg.lstsq(self.components.T, target, rcond=None)[0]
        mean_steps, steps = np.diff(self.mean), np.diff(self.components, axis=1)
        if np.any(mean_steps + coefficients @ steps <= _LEAST_STEP):
            from scipy.optimize import minimize  # slow to import and rarely needed

            normal, moment = self.components @ self.components.T, self.components @ target
            coefficients = minimize(
                lambda c: c @ normal @ c / 2 - moment @ c,
                np.zeros(COMPONENTS),  # feasible: the mean response increases
                jac=lambda c: normal @ c - moment,
                method="SLSQP",
                constraints={
                    "type": "ineq",
                    "fun": lambda c: (mean_steps + c @ steps - 2 * _LEAST_STEP) * EMOR_SAMPLES,
                    "jac": lambda _c: steps.T * EMOR_SAMPLES,
                },
            ).x
        residual = target - coefficients @ self.components
        return tuple(float(c) for c in coefficients), float(np.sqrt(np.mean(residual**2)))


def read_emor(path: str | Path, components: int = COMPONENTS) -> EmorBasis:
    """Read the first base curves from ``emor.txt`` of the authors; FormatError if it is another file."""
    blocks: dict[str, list[float]] = {}
    current: list[float] = []
    try:
        for line in read_text(path).splitlines():
            name, equals, _ = line.partition("=")
            if equals:
                current = blocks.setdefault(name.strip(), [])
            else:
                current += [float(word) for word in line.split()]
        names = ("E", "f0", *(f"h({i})" for i in range(1, components + 1)))
        table = np.array([blocks[name] for name in names], dtype=np.float64)
    except (ValueError, KeyError):
        raise FormatError(f"{path}: not the file emor.txt of the empirical model of response") from None
    if table.shape != (components + 2, EMOR_SAMPLES) or not np.all(np.isfinite(table)):
        raise FormatError(f"{path}: not the file emor.txt, which has {EMOR_SAMPLES} values per curve")
    return EmorBasis(table[0], table[1], table[2:])


def write_pto(
    path: str | Path,
    vignette: Vignette | None = None,
    response: Response | None = None,
    emor: EmorBasis | None = None,
    size: ImageSize = (0, 0),
) -> tuple[RadialFit | None, float | None]:
    """Write a project file with one image line, to be used as a template.

    The response is only written if base curves are given; otherwise the file has the mean response of EMoR. ``size``
    is the size of the images if there is no vignette.

    Returns
    -------
    fit
        The polynomial fitted to the vignette, about its own centre; None without a vignette.
    residual
        Root mean square residual of the response f; None if it was not written.

    Raises
    ------
    FormatError
        If a fit is not a valid vignette or response, or the file cannot be written.
    """
    fit = None if vignette is None else fit_radial(vignette, about_its_centre=True)
    coefficients: tuple[float, ...] = (0.0,) * COMPONENTS
    residual = None
    if response is not None and emor is not None:
        coefficients, residual = emor.fit(response)
        emor.response(coefficients)  # raises an error if the curve cannot be inverted
    width, height = size if fit is None else fit.size
    v = (0.0, 0.0, 0.0) if fit is None else rescaled(fit.coefficients, _unit(fit.size))
    shift = (0.0, 0.0) if fit is None else tuple(c * half_diagonal(fit.size) for c in fit.centre)
    curve = " ".join(
        f"{key}{value:.12g}" for key, value in zip(("Ra", "Rb", "Rc", "Rd", "Re"), coefficients, strict=True)
    )
    write_text(
        path,
        "# hugin project file\n"
        "#hugin_ptoversion 2\n"
        f'p f0 w{width} h{height} v50 E0 R0 n"TIFF_m"\n'
        "m i0\n"
        f"i w{width} h{height} f0 v50 {curve} Eev0 Er1 Eb1 r0 p0 y0 TrX0 TrY0 TrZ0 Tpy0 Tpp0 j0 a0 b0 c0 d0 e0 g0 t0 "
        f"Va1 Vb{v[0]:.12g} Vc{v[1]:.12g} Vd{v[2]:.12g} Vx{shift[0]:.12g} Vy{shift[1]:.12g} Vm5 "
        'n"image.jpg"\n',
    )
    return fit, residual


def read_pto(path: str | Path) -> tuple[RadialFit, ...]:
    """Read the vignette of every image line; FormatError if there is none, or a line is damaged or invalid."""
    lines = [line for line in read_text(path).splitlines() if line.startswith("i ")]
    if not lines:
        raise FormatError(f"{path}: has no image lines, which begin with 'i'")
    images = [dict(_FIELD.findall(line[2:])) for line in lines]
    try:
        return tuple(_fit(images, index) for index in range(len(images)))
    except FormatError as error:
        raise FormatError(f"{path}: {error}") from None


def _fit(images: list[dict[str, str]], index: int) -> RadialFit:
    def value(key: str) -> float:
        text = images[index].get(key, "0")
        # "Vb=0" means the value of image 0.
        link = _LINK.fullmatch(text)
        if link is not None and int(link[1]) < len(images):
            text = images[int(link[1])].get(key, "0")
        return finite_number(text, f"{key} of image {index}")

    size = image_size(value("w"), value("h"))
    half = half_diagonal(size)
    coefficients = rescaled((value("Vb"), value("Vc"), value("Vd")), 1 / _unit(size))
    return RadialFit(size, coefficients, (value("Vx") / half, value("Vy") / half))


def _unit(size: ImageSize) -> float:
    """Return the unit of hugin's radii in half diagonals, which end at the centre of a corner pixel."""
    return math.hypot(*size) / 2 / half_diagonal(size)
