"""Vignetting in lensfun's database files.

Its models ``pa`` and ``acm`` are the same polynomial of the attenuation, with the radius in half diagonals and in
focal lengths; lensfun corrects by division.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from xml.etree.ElementTree import Element, SubElement

from ospc.arrays import ImageSize
from ospc.errors import FormatError, SettingError
from ospc.formats.files import write_text
from ospc.formats.radial import Optics, RadialFit, fit_radial, rescaled, vignette_of
from ospc.formats.safe_xml import local_name, read_xml, write_xml
from ospc.photometry.vignette import Vignette

_TERMS = {"pa": ("k1", "k2", "k3"), "acm": ("alpha1", "alpha2", "alpha3")}


@dataclass(frozen=True)
class LensfunVignetting:
    """One entry of a lens: the vignette at one focal length, aperture and distance.

    Attributes
    ----------
    lens
        Name of the lens.
    model
        ``pa`` (radius in half diagonals) or ``acm`` (in focal lengths).
    terms
        Its three coefficients.
    focal_mm, aperture, distance_m
        What it holds for.
    crop_factor
        Of the camera the lens was measured with.
    """

    lens: str
    model: Literal["pa", "acm"]
    terms: tuple[float, float, float]
    focal_mm: float
    aperture: float
    distance_m: float
    crop_factor: float

    def vignette(self, size: ImageSize) -> Vignette:
        """Return the vignette for images of a camera with the same crop factor.

        Raises
        ------
        FormatError
            If the polynomial is not positive all over the image.
        """
        terms = self.terms
        if self.model == "acm":
            optics = Optics(focal_mm=self.focal_mm, crop_factor=self.crop_factor)
            terms = rescaled(terms, 1 / optics.focal_ratio(size))
        return vignette_of(RadialFit(size, terms))


def write_lensfun(
    vignette: Vignette, path: str | Path, optics: Optics, model: Literal["pa", "acm"] = "pa"
) -> RadialFit:
    """Write a database file with one lens and return the polynomial that stands for its vignette.

    Parameters
    ----------
    vignette
        Fitted about the image centre, for the format has no other.
    path
        Where to.
    optics
        Crop factor, aperture, and focal length are needed.
    model
        Unit of the radius.

    Raises
    ------
    SettingError
        If something is missing in ``optics``.
    FormatError
        If the polynomial is no vignette, or the file cannot be written.
    """
    if optics.crop_factor is None or optics.aperture is None:
        raise SettingError("lensfun needs crop factor and aperture of camera and lens: --crop-factor, --aperture")
    fit = fit_radial(vignette)
    focal_mm = optics.focal_in_mm(fit.size)
    terms = fit.coefficients if model == "pa" else rescaled(fit.coefficients, optics.focal_ratio(fit.size))
    divisor = math.gcd(*fit.size)
    database = Element("lensdatabase", version="1")
    lens = SubElement(database, "lens")
    for name, text in (
        ("maker", optics.maker),
        ("model", optics.lens),
        ("mount", "Generic"),
        ("cropfactor", f"{optics.crop_factor:.9g}"),
        ("aspect-ratio", f"{fit.size[0] // divisor}:{fit.size[1] // divisor}"),
    ):
        SubElement(lens, name).text = text
    SubElement(
        SubElement(lens, "calibration"),
        "vignetting",
        {
            "model": model,
            "focal": f"{focal_mm:.9g}",
            "aperture": f"{optics.aperture:.9g}",
            "distance": f"{optics.distance_m:.9g}",
            **{name: f"{term:.9g}" for name, term in zip(_TERMS[model], terms, strict=True)},
        },
    )
    write_text(path, write_xml(database))
    return fit


def read_lensfun(path: str | Path) -> tuple[LensfunVignetting, ...]:
    """Read the vignetting entries of all lenses of a database file.

    Raises
    ------
    FormatError
        If it is no such file, or an entry is incomplete.
    """
    root = read_xml(path)
    if local_name(root.tag) != "lensdatabase":
        raise FormatError(f"{path}: not a lensfun database, its root is <{local_name(root.tag)}>")
    return tuple(
        _entry(path, lens, element)
        for lens in root.iter("lens")
        for element in lens.iter("vignetting")
        if element.get("model") in _TERMS
    )


def _entry(path: str | Path, lens: Element, element: Element) -> LensfunVignetting:
    name = (lens.findtext("model") or "unknown").strip()
    model: Literal["pa", "acm"] = "acm" if element.get("model") == "acm" else "pa"
    # either model's terms go by either name in lensfun
    first, second, third = (
        _number(path, name, f"k{n}", element.get(f"k{n}", element.get(f"alpha{n}", "0"))) for n in (1, 2, 3)
    )
    return LensfunVignetting(
        lens=name,
        model=model,
        terms=(first, second, third),
        focal_mm=_number(path, name, "focal", element.get("focal")),
        aperture=_number(path, name, "aperture", element.get("aperture")),
        distance_m=_number(path, name, "distance", element.get("distance", "1000")),
        crop_factor=_number(path, name, "cropfactor", lens.findtext("cropfactor")),
    )


def _number(path: str | Path, lens: str, name: str, text: str | None) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FormatError(f"{path}: lens {lens!r} has no number as {name} of its vignetting, but {text!r}")
    return value
