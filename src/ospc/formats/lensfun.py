"""Vignetting in lensfun's database files.

Its models ``pa`` and ``acm`` are the same polynomial of the attenuation, with the radius in half diagonals and in
focal lengths; lensfun corrects by division.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal
from xml.etree.ElementTree import Element, SubElement

from ospc.arrays import ImageSize
from ospc.errors import FormatError, SettingError
from ospc.formats.files import write_text
from ospc.formats.radial import Optics, RadialFit, fit_radial, rescaled
from ospc.formats.safe_xml import local_name, read_xml, write_xml
from ospc.formats.scanning import finite_number
from ospc.photometry.vignette import Vignette

_TERMS = {"pa": ("k1", "k2", "k3"), "acm": ("alpha1", "alpha2", "alpha3")}


def write_lensfun(
    vignette: Vignette, path: str | Path, optics: Optics, model: Literal["pa", "acm"] = "pa"
) -> RadialFit:
    """Write a database file with one lens and return the polynomial, about the image centre, of its vignette.

    SettingError if ``optics`` lacks crop factor, aperture or focal length; FormatError if the polynomial
    is no vignette, or the file cannot be written.
    """
    if optics.crop_factor is None or optics.aperture is None:
        raise SettingError("lensfun needs optics; add --crop-factor, --aperture and --focal-mm (or --focal-px)")
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


def read_lensfun(path: str | Path, size: ImageSize | None) -> tuple[RadialFit, ...]:
    """Read the vignetting entries of all lenses of a database file, for cameras of the crop factor that it states.

    The file does not state the size of the images: SettingError if it is None. FormatError if it is not such a file,
    or an entry is incomplete or no vignette.
    """
    root = read_xml(path)
    if local_name(root.tag) != "lensdatabase":
        raise FormatError(f"{path}: not a lensfun database, its root is <{local_name(root.tag)}>")
    entries = [
        (lens, element)
        for lens in root.iter("lens")
        for element in lens.iter("vignetting")
        if element.get("model") in _TERMS
    ]
    if entries and size is None:
        raise SettingError(f"{path}: does not state the image size; import it with 'ospc import --size WxH' first")
    try:
        return tuple(_fit(lens, element, size or (0, 0)) for lens, element in entries)
    except (FormatError, SettingError) as error:
        raise FormatError(f"{path}: {error}") from None


def _fit(lens: Element, element: Element, size: ImageSize) -> RadialFit:
    # lensfun accepts the names of either model's terms in both
    terms = (element.get(f"k{n}", element.get(f"alpha{n}", "0")) for n in (1, 2, 3))
    k1, k2, k3 = (finite_number(term, f"k{n}") for n, term in enumerate(terms, start=1))
    if element.get("model") == "pa":
        return RadialFit(size, (k1, k2, k3))
    optics = Optics(
        focal_mm=finite_number(element.get("focal"), "focal"),
        crop_factor=finite_number(lens.findtext("cropfactor"), "cropfactor"),
    )
    return RadialFit(size, rescaled((k1, k2, k3), 1 / optics.focal_ratio(size)))
