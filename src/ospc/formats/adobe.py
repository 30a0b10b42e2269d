"""Vignettes in Adobe's lens correction profiles (LCP).

The radius is in focal lengths, and those are in units of the longer side of the image (Adobe camera model, 2010).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, register_namespace

from ospc.arrays import ImageSize
from ospc.errors import FormatError, SettingError
from ospc.formats.files import write_text
from ospc.formats.radial import (
    FULL_FRAME_HALF_DIAGONAL_MM,
    Optics,
    RadialFit,
    checked,
    fit_radial,
    rescaled,
    vignette_of,
)
from ospc.formats.safe_xml import local_name, read_xml, write_xml
from ospc.photometry.geometry import half_diagonal
from ospc.photometry.vignette import Vignette

_NAMESPACES = {
    "x": "adobe:ns:meta/",
    "rdf": "http://www.w3.org/1999/02/22-rdf-syntax-ns#",
    "photoshop": "http://ns.adobe.com/photoshop/1.0/",
    "stCamera": "http://ns.adobe.com/photoshop/1.0/camera-profile",
}


@dataclass(frozen=True)
class LcpVignette:
    """The vignette model of one entry of a profile.

    Attributes
    ----------
    lens
        Name of the lens.
    terms
        (α₁, α₂, α₃), for radii in focal lengths.
    focal_ratio
        Focal length over the longer side of the image.
    centre
        Centre as a share of width and height.
    size
        Width and height of the images it was made from; None where the profile does not say.
    focal_mm, aperture
        What it holds for; None where the profile does not say. The aperture is an f-number.
    """

    lens: str
    terms: tuple[float, float, float]
    focal_ratio: float
    centre: tuple[float, float]
    size: ImageSize | None
    focal_mm: float | None
    aperture: float | None

    def vignette(self, size: ImageSize | None = None) -> Vignette:
        """Return the vignette for images of a size; of the profile's own where not given.

        Raises
        ------
        SettingError
            If neither says the size.
        FormatError
            If the polynomial is not positive all over the image.
        """
        chosen = size or self.size
        if chosen is None:
            raise SettingError(f"the profile of {self.lens!r} does not say for which image size it is; give the size")
        return vignette_of(self.fit(chosen))

    def fit(self, size: ImageSize) -> RadialFit:
        """Return the polynomial in half diagonals.

        Raises
        ------
        FormatError
            If it is not positive all over the image.
        """
        half = half_diagonal(size)
        shift = (
            (self.centre[0] * size[0] - size[0] / 2) / half,
            (self.centre[1] * size[1] - size[1] / 2) / half,
        )
        return checked(RadialFit(size, rescaled(self.terms, half / (self.focal_ratio * max(size))), shift))


def write_lcp(vignette: Vignette, path: str | Path, optics: Optics) -> RadialFit:
    """Write a profile with one entry and return the polynomial that stands for the vignette.

    Parameters
    ----------
    vignette
        Fitted about its own centre where it has one.
    path
        Where to.
    optics
        The focal length is needed, in pixels, or in millimetres with the crop factor.

    Raises
    ------
    SettingError
        If it is missing.
    FormatError
        If the polynomial is no vignette, or the file cannot be written.
    """
    fit = fit_radial(vignette, about_its_centre=True)
    width, height = fit.size
    half = half_diagonal(fit.size)
    ratio = optics.focal_ratio(fit.size)
    focal = f"{ratio * half / max(fit.size):.9g}"
    root = Element(_tag("x", "xmpmeta"))
    description = SubElement(SubElement(root, _tag("rdf", "RDF")), _tag("rdf", "Description"))
    profiles = SubElement(SubElement(description, _tag("photoshop", "CameraProfiles")), _tag("rdf", "Seq"))
    entry = _resource(profiles, "rdf", "li")
    _properties(
        entry,
        Make=optics.maker,
        Model=optics.camera,
        Lens=optics.lens,
        LensPrettyName=optics.lens,
        ProfileName=f"{optics.camera} ({optics.lens})",
        CameraRawProfile="True",
        ImageWidth=str(width),
        ImageLength=str(height),
        SensorFormatFactor=None if optics.crop_factor is None else f"{optics.crop_factor:.9g}",
        FocalLength=None if optics.focal_mm is None else f"{optics.focal_mm:.9g}",
        ApertureValue=None if optics.aperture is None else f"{2 * math.log2(optics.aperture):.9g}",
    )
    model = _resource(entry, "stCamera", "PerspectiveModel")
    _properties(model, Version="2", FocalLengthX=focal, FocalLengthY=focal)
    terms = rescaled(fit.coefficients, ratio)
    _properties(
        _resource(model, "stCamera", "VignetteModel"),
        FocalLengthX=focal,
        FocalLengthY=focal,
        ImageXCenter=f"{0.5 + fit.centre[0] * half / width:.9g}",
        ImageYCenter=f"{0.5 + fit.centre[1] * half / height:.9g}",
        **{f"VignetteModelParam{n}": f"{term:.9g}" for n, term in enumerate(terms, start=1)},
    )
    for prefix, uri in _NAMESPACES.items():
        register_namespace(prefix, uri)
    write_text(path, write_xml(root))
    return fit


def read_lcp(path: str | Path) -> tuple[LcpVignette, ...]:
    """Read the vignette models of all entries of a profile that have one.

    Raises
    ------
    FormatError
        If it is no such profile, or an entry's numbers are none.
    """
    root = read_xml(path)
    entries = [element for element in root.iter() if local_name(element.tag) == "li"]
    found = tuple(vignette for entry in entries if (vignette := _entry(path, entry)) is not None)
    if not found:
        raise FormatError(f"{path}: holds no vignette model of an Adobe lens profile")
    return found


def _entry(path: str | Path, entry: Element) -> LcpVignette | None:
    model = next((element for element in entry.iter() if local_name(element.tag) == "VignetteModel"), None)
    if model is None:
        return None
    own = _values(model)
    geometry = next((e for e in entry.iter() if local_name(e.tag) in ("PerspectiveModel", "FisheyeModel")), None)
    general = _values(entry)
    inherited = general | ({} if geometry is None else _values(geometry))

    def number(name: str, default: float | None = None) -> float | None:
        text = own.get(name, inherited.get(name))
        if text is None:
            return default
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise FormatError(f"{path}: {name} is {text!r}, not a number")
        return value

    width, height = number("ImageWidth"), number("ImageLength")
    size = (int(width), int(height)) if width and height else None
    focal_mm, apex = number("FocalLength"), number("ApertureValue")
    ratio = number("FocalLengthX")
    factor = number("SensorFormatFactor")
    if ratio is None and focal_mm and factor and size:
        ratio = focal_mm * factor / FULL_FRAME_HALF_DIAGONAL_MM * half_diagonal(size) / max(size)
    lens = general.get("LensPrettyName", general.get("Lens", "unknown"))
    if not ratio or ratio < 0:
        raise FormatError(f"{path}: the entry of {lens!r} does not say its focal length, the unit of its radius")
    first, second, third = (number(f"VignetteModelParam{n}", 0.0) or 0.0 for n in (1, 2, 3))
    return LcpVignette(
        lens=lens,
        terms=(first, second, third),
        focal_ratio=ratio,
        centre=(number("ImageXCenter", 0.5) or 0.5, number("ImageYCenter", 0.5) or 0.5),
        size=size,
        focal_mm=focal_mm,
        aperture=None if apex is None else 2 ** (apex / 2),
    )


def _values(element: Element) -> dict[str, str]:
    """Return the properties of a node, written as attributes, as elements, or inside an rdf:Description."""
    values = {local_name(key): text for key, text in element.attrib.items()}
    for child in element:
        if local_name(child.tag) == "Description":
            values |= _values(child)
        elif len(child) == 0 and child.text and child.text.strip():
            values[local_name(child.tag)] = child.text.strip()
    return values


def _tag(prefix: str, name: str) -> str:
    return f"{{{_NAMESPACES[prefix]}}}{name}"


def _resource(parent: Element, prefix: str, name: str) -> Element:
    return SubElement(parent, _tag(prefix, name), {_tag("rdf", "parseType"): "Resource"})


def _properties(parent: Element, **values: str | None) -> None:
    for name, text in values.items():
        if text is not None:
            SubElement(parent, _tag("stCamera", name)).text = text
