"""Responses and vignettes in hugin's project files (.pto).

An image line holds the vignette as Vb, Vc, Vd for radii in half diagonals with a shift Vx, Vy of its centre in
pixels, and the response as five coefficients Ra to Re of the empirical model of response (EMoR, Grossberg and Nayar
2004). The base curves of that model are data of their authors and are read from their file ``emor.txt``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.optimize

from ospc.arrays import FloatArray, ImageSize
from ospc.errors import FormatError
from ospc.formats.files import read_text, write_text
from ospc.formats.radial import RadialFit, fit_radial, vignette_of
from ospc.photometry.geometry import half_diagonal
from ospc.photometry.response import Response
from ospc.photometry.vignette import Vignette

COMPONENTS = 5
"""Coefficients of EMoR that hugin uses."""

_SAMPLES = 1024
_LEAST_STEP = 1e-7
_FIELD = re.compile(r'([A-Za-z]+)(=?-?[0-9.][0-9.eE+-]*|"[^"]*")')
_RESPONSE_KEYS = ("Ra", "Rb", "Rc", "Rd", "Re")
_LARGEST_SIDE = 100_000


@dataclass(frozen=True)
class EmorBasis:
    """Mean and first components of EMoR.

    Attributes
    ----------
    irradiance
        From 0 to 1, shape (1024,).
    mean
        f₀, the mean response, shape (1024,).
    components
        h₁ … h₅, shape (5, 1024).
    """

    irradiance: FloatArray
    mean: FloatArray
    components: FloatArray

    def response(self, coefficients: tuple[float, ...]) -> Response:
        """Return the response with f = f₀ + Σ cᵢhᵢ.

        Raises
        ------
        FormatError
            If that does not increase, and so cannot be inverted.
        """
        forward = self.mean + np.asarray(coefficients) @ self.components
        if np.any(np.diff(forward) <= 0):
            raise FormatError("the response of these EMoR coefficients does not increase everywhere")
        forward = (forward - forward[0]) / (forward[-1] - forward[0])
        inverse = np.interp(np.linspace(0, 1, 256), forward, self.irradiance)
        return Response.from_values(inverse, model={"name": "emor", "coefficients": list(coefficients)})

    def fit(self, response: Response) -> tuple[tuple[float, ...], float]:
        """Return the coefficients nearest to a response with which f increases, and the root mean square residual."""
        target = response(self.irradiance) - self.mean
        coefficients = np.linalg.lstsq(self.components.T, target, rcond=None)[0]
        mean_steps, steps = np.diff(self.mean), np.diff(self.components, axis=1)
        if np.any(mean_steps + coefficients @ steps <= _LEAST_STEP):
            normal, moment = self.components @ self.components.T, self.components @ target
            coefficients = scipy.optimize.minimize(
                lambda c: c @ normal @ c / 2 - moment @ c,
                np.zeros(COMPONENTS),  # the mean response increases
                jac=lambda c: normal @ c - moment,
                method="SLSQP",
                constraints={
                    "type": "ineq",
                    "fun": lambda c: (mean_steps + c @ steps - 2 * _LEAST_STEP) * _SAMPLES,
                    "jac": lambda _c: steps.T * _SAMPLES,
                },
            ).x
        residual = target - coefficients @ self.components
        return tuple(float(c) for c in coefficients), float(np.sqrt(np.mean(residual**2)))


@dataclass(frozen=True)
class HuginPhotometry:
    """Photometric values of an image line.

    Attributes
    ----------
    fit
        The vignette.
    response
        (Ra, Rb, Rc, Rd, Re).
    exposure_value
        Eev; a frame with a value larger by one has half the exposure.
    """

    fit: RadialFit
    response: tuple[float, ...]
    exposure_value: float

    def vignette(self) -> Vignette:
        """Return the vignette."""
        return vignette_of(self.fit)


def read_emor(path: str | Path) -> EmorBasis:
    """Read the base curves from the file ``emor.txt`` their authors distribute.

    Raises
    ------
    FormatError
        If it is not that file.
    """
    blocks: dict[str, list[float]] = {}
    current: list[float] = []
    try:
        for line in read_text(path).splitlines():
            name, equals, _ = line.partition("=")
            if equals:
                current = blocks.setdefault(name.strip(), [])
            else:
                current += [float(word) for word in line.split()]
        table = np.array(
            [blocks["E"], blocks["f0"], *(blocks[f"h({i})"] for i in range(1, COMPONENTS + 1))], dtype=np.float64
        )
    except (ValueError, KeyError):
        raise FormatError(f"{path}: not the file emor.txt of the empirical model of response") from None
    if table.shape != (COMPONENTS + 2, _SAMPLES) or not np.all(np.isfinite(table)):
        raise FormatError(f"{path}: not the file emor.txt, which has {_SAMPLES} values a curve")
    return EmorBasis(table[0], table[1], table[2:])


def write_pto(
    path: str | Path,
    vignette: Vignette | None = None,
    response: Response | None = None,
    emor: EmorBasis | None = None,
    size: ImageSize = (0, 0),
) -> tuple[RadialFit | None, float | None]:
    """Write a project file with one image line, to be taken as a template.

    Parameters
    ----------
    path
        Where to.
    vignette
        Fitted about its own centre where it has one; none in the file where not given.
    response
        Written only together with ``emor``; the mean response of EMoR otherwise.
    emor
        Base curves.
    size
        Of the images where there is no vignette to tell.

    Returns
    -------
    fit
        The polynomial that stands for the vignette; None without one.
    residual
        Root mean square residual of the response f; None where it was not written.

    Raises
    ------
    FormatError
        If the polynomial is no vignette, the five numbers are no response, or the file cannot be written.
    """
    fit = None if vignette is None else fit_radial(vignette, about_its_centre=True)
    coefficients: tuple[float, ...] = (0.0,) * COMPONENTS
    residual = None
    if response is not None and emor is not None:
        coefficients, residual = emor.fit(response)
        emor.response(coefficients)  # refuses what cannot be inverted
    width, height = size if fit is None else fit.size
    v = (0.0, 0.0, 0.0) if fit is None else fit.coefficients
    shift = (0.0, 0.0) if fit is None else tuple(c * half_diagonal(fit.size) for c in fit.centre)
    curve = " ".join(f"{key}{value:.12g}" for key, value in zip(_RESPONSE_KEYS, coefficients, strict=True))
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


def read_pto(path: str | Path) -> tuple[HuginPhotometry, ...]:
    """Read the photometric values of every image line; ``Vb=0`` means: as in image 0.

    Raises
    ------
    FormatError
        If there is no image line, or one is damaged.
    """
    lines = [line for line in read_text(path).splitlines() if line.startswith("i ")]
    if not lines:
        raise FormatError(f"{path}: holds no image line, which begins with 'i'")
    fields = [dict(_FIELD.findall(line[2:])) for line in lines]
    return tuple(_image(path, fields, i) for i in range(len(fields)))


def _image(path: str | Path, fields: list[dict[str, str]], index: int) -> HuginPhotometry:
    def value(key: str, default: float) -> float:
        text = fields[index].get(key)
        try:
            if text is not None and text.startswith("="):
                text = fields[int(text[1:])].get(key)
            number = default if text is None else float(text)
        except (ValueError, IndexError):
            number = float("nan")
        if not np.isfinite(number):
            raise FormatError(f"{path}: image {index} has no number as {key}, but {fields[index].get(key)!r}")
        return number

    width, height = value("w", 0), value("h", 0)
    if not (1 < width <= _LARGEST_SIDE and 1 < height <= _LARGEST_SIDE):
        raise FormatError(f"{path}: image {index} has the size {width:g}x{height:g}")
    size = (int(width), int(height))
    half = half_diagonal(size)
    centre = (value("Vx", 0) / half, value("Vy", 0) / half)
    return HuginPhotometry(
        fit=RadialFit(size, (value("Vb", 0), value("Vc", 0), value("Vd", 0)), centre),
        response=tuple(value(key, 0) for key in _RESPONSE_KEYS),
        exposure_value=value("Eev", 0),
    )
