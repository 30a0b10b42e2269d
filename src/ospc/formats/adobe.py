"""Vignettes in Adobe's lens correction profiles (LCP).

The radius is in focal lengths, which are given in units of the longer side of the image (Adobe camera model, 2010).
"""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, register_namespace

from ospc.arrays import ImageSize
from ospc.errors import FormatError, SettingError
from ospc.formats.files import write_text
from ospc.formats.radial import Optics, RadialFit, fit_radial, rescaled
from ospc.formats.safe_xml import local_name, read_xml, write_xml
from ospc.formats.scanning import finite_number
from ospc.photometry.geometry import half_diagonal, image_size
from ospc.photometry.vignette import Vignette

_NAMESPACES = {
    "x": "adobe:ns:meta/",
    "rdf": "http://www.w3.org/1999/02/22-rdf-syntax-ns#",
    "photoshop": "http://ns.adobe.com/photoshop/1.0/",
    "stCamera": "http://ns.adobe.com/photoshop/1.0/camera-profile",
}


def write_lcp(vignette: Vignette, path: str | Path, optics: Optics) -> RadialFit:
    """Write a profile with one entry and return the polynomial that stands for the vignette, about its own centre.

    SettingError if ``optics`` has no focal length, in pixels, or in millimetres with the crop factor; FormatError if
    the polynomial is no vignette, or the file cannot be written.
    """
    fit = fit_radial(vignette, about_its_centre=True)
    width, height = fit.size
    half = half_diagonal(fit.size)
    ratio = optics.focal_ratio(fit.size)
    focal = ratio * half / max(fit.size)
    root = Element(_tag("x", "xmpmeta"))
    description = SubElement(SubElement(root, _tag("rdf", "RDF")), _tag("rdf", "Description"))
    profiles = SubElement(SubElement(description, _tag("photoshop", "CameraProfiles")), _tag("rdf", "Seq"))
    entry = _resource(
        profiles,
        _tag("rdf", "li"),
        Make=optics.maker,
        Model=optics.camera,
        Lens=optics.lens,
        LensPrettyName=optics.lens,
        ProfileName=f"{optics.camera} ({optics.lens})",
        CameraRawProfile="True",
        ImageWidth=width,
        ImageLength=height,
        SensorFormatFactor=optics.crop_factor,
        FocalLength=optics.focal_mm,
        ApertureValue=None if optics.aperture is None else 2 * math.log2(optics.aperture),
    )
    model = _resource(
        entry, _tag("stCamera", "PerspectiveModel"), Version="2", FocalLengthX=focal, FocalLengthY=focal
    )
    terms = rescaled(fit.coefficients, ratio)
    _resource(
        model,
        _tag("stCamera", "VignetteModel"),
        FocalLengthX=focal,
        FocalLengthY=focal,
        ImageXCenter=0.5 + fit.centre[0] * half / width,
        ImageYCenter=0.5 + fit.centre[1] * half / height,
        **{f"VignetteModelParam{n}": term for n, term in enumerate(terms, start=1)},
    )
    for prefix, uri in _NAMESPACES.items():
        register_namespace(prefix, uri)
    write_text(path, write_xml(root))
    return fit


def read_lcp(path: str | Path, size: ImageSize | None = None) -> tuple[RadialFit, ...]:
    """Read the vignette models of all entries of a profile that have one.

    SettingError if neither the caller nor the profile states the size of the images; FormatError if it is not such a
    profile, or an entry is incomplete or no vignette.
    """
    entries = [element for element in read_xml(path).iter() if local_name(element.tag) == "li"]
    try:
        found = tuple(fit for entry in entries if (fit := _fit(entry, size)) is not None)
    except (FormatError, SettingError) as error:
        raise type(error)(f"{path}: {error}") from None
    if not found:
        raise FormatError(f"{path}: holds no vignette model of an Adobe lens profile")
    return found


def _fit(entry: Element, wanted: ImageSize | None) -> RadialFit | None:
    model = next((element for element in entry.iter() if local_name(element.tag) == "VignetteModel"), None)
    if model is None:
        return None
    geometry = next((e for e in entry.iter() if local_name(e.tag) in ("PerspectiveModel", "FisheyeModel")), None)
    texts = _values(entry) | ({} if geometry is None else _values(geometry)) | _values(model)

    def number(name: str, default: str) -> float:
        return finite_number(texts.get(name, default), name)

    width, height = wanted or (number("ImageWidth", "0"), number("ImageLength", "0"))
    if not (width and height):
        raise SettingError("does not state the image size; import it with 'ospc import --size WxH' first")
    size = image_size(width, height)
    half = half_diagonal(size)
    if "FocalLengthX" in texts:
        ratio = number("FocalLengthX", "0") * max(size) / half
    else:
        try:
            focal_mm, crop_factor = number("FocalLength", "0"), number("SensorFormatFactor", "0")
            ratio = Optics(focal_mm=focal_mm, crop_factor=crop_factor).focal_ratio(size)
        except SettingError:
            ratio = 0.0
    if ratio <= 0:
        raise FormatError("an entry does not state its focal length, the unit of its radius")
    centre = (number("ImageXCenter", "0.5"), number("ImageYCenter", "0.5"))
    first, second, third = (number(f"VignetteModelParam{n}", "0") for n in (1, 2, 3))
    shift = ((centre[0] - 0.5) * size[0] / half, (centre[1] - 0.5) * size[1] / half)
    return RadialFit(size, rescaled((first, second, third), 1 / ratio), shift)


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


def _resource(parent: Element, tag: str, **properties: str | float | None) -> Element:
    """Add a node with those of the properties that are known."""
    node = SubElement(parent, tag, {_tag("rdf", "parseType"): "Resource"})
    for name, value in properties.items():
        if value is not None:
            text = value if isinstance(value, str) else f"{value:.9g}"
            SubElement(node, _tag("stCamera", name)).text = text
    return node
