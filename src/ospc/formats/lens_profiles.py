"""Vignettes in XML lens profiles of Adobe (LCP) and of the lensfun database.

The radius in Adobe profiles is in focal lengths, which are given in units of the longer side of the image (Adobe
camera model, 2010). The lensfun models ``pa`` and ``acm`` are the same polynomial of the attenuation, with the radius
in half diagonals and in focal lengths; lensfun corrects by division.

XML files are not trusted: entities are rejected, size is limited, and nothing is fetched.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement, register_namespace

from ospc.arrays import ImageSize
from ospc.errors import FormatError, SettingError
from ospc.formats.files import read_bytes, write_text
from ospc.formats.radial import Optics, RadialFit, fit_radial, rescaled
from ospc.formats.scanning import finite_number
from ospc.photometry.geometry import half_diagonal, image_size
from ospc.photometry.vignette import Vignette

_NAMESPACES = {
    "x": "adobe:ns:meta/",
    "rdf": "http://www.w3.org/1999/02/22-rdf-syntax-ns#",
    "photoshop": "http://ns.adobe.com/photoshop/1.0/",
    "stCamera": "http://ns.adobe.com/photoshop/1.0/camera-profile",
}

_NO_SIZE = (
    "does not state the image size; add --size WxH to 'ospc import', and use the calibration.json that it writes"
)


def write_lcp(vignette: Vignette, path: str | Path, optics: Optics) -> RadialFit:
    """Write a profile with one entry and return the polynomial fitted to the vignette, about its own centre.

    Raises
    ------
    SettingError
        If ``optics`` has no focal length in pixels, or in millimetres with the crop factor.
    FormatError
        If the polynomial is not a valid vignette, or the file cannot be written.
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
    """Read the vignette models of all entries in a profile that have one.

    Raises
    ------
    SettingError
        If neither ``size`` nor the profile states the size of the images.
    FormatError
        If the file is not such a profile, or an entry is incomplete or invalid.
    """
    entries = read_xml(path).iter("li")
    try:
        found = tuple(fit for entry in entries if (fit := _adobe_fit(entry, size)) is not None)
    except (FormatError, SettingError) as error:
        raise type(error)(f"{path}: {error}") from None
    if not found:
        raise FormatError(f"{path}: has no vignette model of an Adobe lens profile")
    return found


def _adobe_fit(entry: Element, assumed: ImageSize | None) -> RadialFit | None:
    model = next(entry.iter("VignetteModel"), None)
    if model is None:
        return None
    geometry = next((e for e in entry.iter() if e.tag in ("PerspectiveModel", "FisheyeModel")), None)
    texts = _values(entry) | ({} if geometry is None else _values(geometry)) | _values(model)

    def number(name: str, default: str) -> float:
        return finite_number(texts.get(name, default), name)

    width, height = number("ImageWidth", "0"), number("ImageLength", "0")
    if not (width and height):
        if assumed is None:
            raise SettingError(_NO_SIZE)
        width, height = assumed
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
        raise FormatError("an entry does not state the focal length, which is the unit of its radius")
    centre = (number("ImageXCenter", "0.5"), number("ImageYCenter", "0.5"))
    first, second, third = (number(f"VignetteModelParam{n}", "0") for n in (1, 2, 3))
    shift = ((centre[0] - 0.5) * size[0] / half, (centre[1] - 0.5) * size[1] / half)
    return RadialFit(size, rescaled((first, second, third), 1 / ratio), shift)


def _values(element: Element) -> dict[str, str]:
    """Return the properties of a node, which are attributes, elements, or inside an rdf:Description."""
    values: dict[str, str] = {}
    for holder in (element, *element.findall("Description")):
        values |= holder.attrib
        values |= {child.tag: text for child in holder if not len(child) and (text := (child.text or "").strip())}
    return values


def _tag(prefix: str, name: str) -> str:
    return f"{{{_NAMESPACES[prefix]}}}{name}"


def _resource(parent: Element, tag: str, **properties: str | float | None) -> Element:
    """Add a node with the properties that are not None."""
    node = SubElement(parent, tag, {_tag("rdf", "parseType"): "Resource"})
    for name, value in properties.items():
        if value is not None:
            text = value if isinstance(value, str) else f"{value:.9g}"
            SubElement(node, _tag("stCamera", name)).text = text
    return node


def write_lensfun(vignette: Vignette, path: str | Path, optics: Optics) -> RadialFit:
    """Write a database file with one lens and return the polynomial fitted to the vignette, about the image centre.

    The model is ``pa``.

    Raises
    ------
    SettingError
        If ``optics`` lacks crop factor, aperture or focal length.
    FormatError
        If the polynomial is not a valid vignette, or the file cannot be written.
    """
    if optics.crop_factor is None or optics.aperture is None:
        raise SettingError(
            "lensfun needs the crop factor, aperture and focal length; add --crop-factor, --aperture and --focal-mm "
            "(or --focal-px)"
        )
    fit = fit_radial(vignette)
    focal_mm = optics.focal_in_mm(fit.size)
    short, long = sorted(fit.size)
    divisor = math.gcd(short, long)
    database = Element("lensdatabase", version="1")
    lens = SubElement(database, "lens")
    for name, text in (
        ("maker", optics.maker),
        ("model", optics.lens),
        ("mount", "Generic"),
        ("cropfactor", f"{optics.crop_factor:.9g}"),
        ("aspect-ratio", f"{long // divisor}:{short // divisor}"),
    ):
        SubElement(lens, name).text = text
    SubElement(
        SubElement(lens, "calibration"),
        "vignetting",
        {
            "model": "pa",
            "focal": f"{focal_mm:.9g}",
            "aperture": f"{optics.aperture:.9g}",
            "distance": "1000",  # a focus distance that stands for infinity
            **{f"k{n}": f"{term:.9g}" for n, term in enumerate(fit.coefficients, start=1)},
        },
    )
    write_text(path, write_xml(database))
    return fit


def read_lensfun(path: str | Path, size: ImageSize | None) -> tuple[RadialFit, ...]:
    """Read the vignetting entries of all lenses in a database file, for cameras with the crop factor in the file.

    Raises
    ------
    SettingError
        If ``size`` is None, because the file does not state the size of the images.
    FormatError
        If it is not such a file, or an entry is incomplete or invalid.
    """
    root = read_xml(path)
    if root.tag != "lensdatabase":
        raise FormatError(f"{path}: not a lensfun database, its root is <{root.tag}>")
    entries = [
        (lens, element)
        for lens in root.iter("lens")
        for element in lens.iter("vignetting")
        if element.get("model") in ("pa", "acm")
    ]
    if entries and size is None:
        raise SettingError(f"{path}: {_NO_SIZE}")
    try:
        return tuple(_lensfun_fit(lens, element, size or (0, 0)) for lens, element in entries)
    except (FormatError, SettingError) as error:
        raise FormatError(f"{path}: {error}") from None


def _lensfun_fit(lens: Element, element: Element, size: ImageSize) -> RadialFit:
    # lensfun accepts the names of the terms of either model in both.
    terms = (element.get(f"k{n}", element.get(f"alpha{n}", "0")) for n in (1, 2, 3))
    k1, k2, k3 = (finite_number(term, f"k{n}") for n, term in enumerate(terms, start=1))
    if element.get("model") == "pa":
        return RadialFit(size, (k1, k2, k3))
    optics = Optics(
        focal_mm=finite_number(element.get("focal"), "focal"),
        crop_factor=finite_number(lens.findtext("cropfactor"), "cropfactor"),
    )
    return RadialFit(size, rescaled((k1, k2, k3), 1 / optics.focal_ratio(size)))


_DEFINITIONS = re.compile(rb"<!DOCTYPE[^>]*\[|<!ENTITY")
"""Definitions of a document type inside the file, or of an entity."""

_LARGEST = 2**24
"""Maximum size in bytes: the tree takes twenty times as much memory. The largest profiles have a few megabytes."""


def read_xml(path: str | Path) -> Element:
    """Return the root of an XML file, with names without name spaces.

    A document type that only refers to an external definition, as in lensfun files, is ignored and not fetched. One
    with its own definitions is rejected, because entities can expand without limit.

    Raises
    ------
    FormatError
        If the file cannot be read, is not XML, or defines or uses entities.
    """
    content = read_bytes(path, _LARGEST)
    if _DEFINITIONS.search(content.replace(b"\0", b"")):  # without the zeros of UTF-16
        raise FormatError(f"{path}: defines its own document type, which is not allowed; remove <!DOCTYPE>")
    try:
        root = ElementTree.fromstring(content)  # noqa: S314  definitions are refused above
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise FormatError(f"{path}: not readable as XML ({error})") from None
    for element in root.iter():
        element.tag = _local_name(element.tag)
        element.attrib = {_local_name(name): text for name, text in element.attrib.items()}
    return root


def _local_name(name: str) -> str:
    return name.rpartition("}")[2]


def write_xml(root: Element) -> str:
    """Return an element as the text of an indented XML file."""
    ElementTree.indent(root, " ")
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=False) + "\n"
