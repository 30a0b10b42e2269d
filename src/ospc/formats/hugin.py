"""Vignettes in project files of hugin (.pto).

An image line has the vignette as Vb, Vc, Vd for radii that are 1 at the outer corner of a corner pixel, with a shift
Vx, Vy of its centre in pixels. Its response is five coefficients of the empirical model of response, whose base
curves are not distributed with this package; it is neither written nor read.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

from ospc.arrays import ImageSize
from ospc.errors import FormatError
from ospc.formats.files import read_text, write_text
from ospc.formats.radial import RadialFit, fit_radial, rescaled
from ospc.formats.scanning import finite_number
from ospc.photometry.geometry import half_diagonal, image_size
from ospc.photometry.vignette import Vignette

_FIELD = re.compile(r'([A-Za-z]+)(=?-?[0-9.][0-9.eE+-]*|"[^"]*")')
_LINK = re.compile(r"=(\d{1,6})", re.ASCII)


def write_pto(vignette: Vignette, path: str | Path) -> RadialFit:
    """Write a project file with one image line, to be used as a template, and return the polynomial.

    It is fitted to the vignette, about its own centre. The response is the mean response of hugin's model.

    Raises
    ------
    FormatError
        If the fit is not a valid vignette, or the file cannot be written.
    """
    fit = fit_radial(vignette, about_its_centre=True)
    width, height = fit.size
    v = rescaled(fit.coefficients, _unit(fit.size))
    shift = tuple(c * half_diagonal(fit.size) for c in fit.centre)
    write_text(
        path,
        "# hugin project file\n"
        "#hugin_ptoversion 2\n"
        f'p f0 w{width} h{height} v50 E0 R0 n"TIFF_m"\n'
        "m i0\n"
        f"i w{width} h{height} f0 v50 Ra0 Rb0 Rc0 Rd0 Re0 Eev0 Er1 Eb1 r0 p0 y0 TrX0 TrY0 TrZ0 Tpy0 Tpp0 j0 a0 b0 "
        f"c0 d0 e0 g0 t0 Va1 Vb{v[0]:.12g} Vc{v[1]:.12g} Vd{v[2]:.12g} Vx{shift[0]:.12g} Vy{shift[1]:.12g} Vm5 "
        'n"image.jpg"\n',
    )
    return fit


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
