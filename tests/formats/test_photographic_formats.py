"""lensfun, Adobe and hugin: coefficients are read back to the format's nine digits, in the right unit."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from log_polynomials import log_polynomial
from ospc.errors import FormatError, SettingError
from ospc.formats.hugin import read_pto, write_pto
from ospc.formats.lens_profiles import read_lcp, read_lensfun, write_lcp, write_lensfun
from ospc.formats.radial import Optics
from ospc.photometry.calibration import Calibration
from ospc.photometry.geometry import half_diagonal
from ospc.photometry.vignette import PolynomialVignette

SIZE = (96, 72)
POLYNOMIAL = PolynomialVignette(SIZE, (-0.31, 0.12, -0.07))
OPTICS = Optics(focal_mm=4.0, crop_factor=6.0, aperture=2.0, maker="A & B", lens='4 mm "wide" <f/2>')
DECENTRED = log_polynomial(SIZE, (-0.3, -0.05), (0.15, -0.08))

triples = st.tuples(st.floats(-0.3, 0.1), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))


@settings(max_examples=20, deadline=None)
@given(triples)
def test_every_format_keeps_the_coefficients(tmp_path_factory, coefficients):
    folder = tmp_path_factory.mktemp("formats")
    vignette = PolynomialVignette(SIZE, coefficients)
    write_lensfun(vignette, folder / "a.xml", OPTICS)
    write_lcp(vignette, folder / "a.lcp", OPTICS)
    write_pto(vignette, folder / "a.pto")
    for back in (
        read_lensfun(folder / "a.xml", SIZE)[0].vignette(),
        read_lcp(folder / "a.lcp")[0].vignette(),
        read_pto(folder / "a.pto")[0].vignette(),
    ):
        assert isinstance(back, PolynomialVignette)
        assert back.size == SIZE
        np.testing.assert_allclose(back.coefficients, coefficients, atol=1e-7)


def test_adobe_measures_the_radius_in_focal_lengths(tmp_path):
    unit = 4.0 * 6.0 / (np.hypot(36, 24) / 2)
    expected = [v * unit ** (2 * n) for n, v in enumerate(POLYNOMIAL.coefficients, 1)]
    write_lcp(POLYNOMIAL, tmp_path / "a.lcp", OPTICS)
    properties = {e.tag.split("}")[1]: e.text for e in ElementTree.parse(tmp_path / "a.lcp").iter()}
    terms = [float(properties[f"VignetteModelParam{n}"]) for n in (1, 2, 3)]
    np.testing.assert_allclose(terms, expected, rtol=1e-7)
    focal_ratio = float(properties["FocalLengthX"])
    assert focal_ratio == pytest.approx(unit * half_diagonal(SIZE) / 96)
    # the value at the corner, computed in the other program's units
    corner = half_diagonal(SIZE) / (focal_ratio * 96)
    value = 1 + sum(a * corner ** (2 * n) for n, a in enumerate(terms, 1))
    assert value == pytest.approx(float(POLYNOMIAL.profile(1.0)), rel=1e-6)
    assert float(properties["ApertureValue"]) == pytest.approx(2 * np.log2(OPTICS.aperture))


def test_lensfun_names_what_the_entry_holds_for(tmp_path):
    write_lensfun(POLYNOMIAL, tmp_path / "a.xml", OPTICS)
    (lens,) = ElementTree.parse(tmp_path / "a.xml").iter("lens")
    assert (lens.findtext("model"), lens.findtext("cropfactor")) == (OPTICS.lens, "6")
    assert lens.findtext("aspect-ratio") == "4:3"
    (element,) = lens.iter("vignetting")
    assert [element.get(name) for name in ("focal", "aperture", "distance")] == ["4", "2", "1000"]


def test_lensfun_wants_the_long_side_of_a_portrait_image_first(tmp_path):
    write_lensfun(PolynomialVignette((72, 96), (-0.3, 0, 0)), tmp_path / "a.xml", OPTICS)
    assert ElementTree.parse(tmp_path / "a.xml").findtext("lens/aspect-ratio") == "4:3"


def test_a_database_with_many_lenses_is_read(tmp_path):
    (tmp_path / "db.xml").write_text(
        '<!DOCTYPE lensdatabase SYSTEM "lensfun-database.dtd">\n'
        '<lensdatabase version="2"><mount><name>M</name></mount>'
        "<lens><maker>X</maker><model>One</model><cropfactor>1.5</cropfactor><calibration>"
        '<distortion model="poly3" focal="18" k1="0.1"/>'
        '<vignetting model="pa" focal="18" aperture="3.5" distance="0.25" k1="-0.5" k2="0.1" k3="-0.1"/>'
        '<vignetting model="pa" focal="18" aperture="8" distance="0.25" k1="-0.2" k2="0.1" k3="-0.1"/>'
        "</calibration></lens><lens><model>Two</model><cropfactor>1</cropfactor><calibration>"
        '<vignetting model="acm" focal="50" aperture="2" distance="10" alpha1="-0.9" alpha2="0.3" alpha3="0"/>'
        "</calibration></lens></lensdatabase>"
    )
    entries = read_lensfun(tmp_path / "db.xml", SIZE)
    assert [fit.coefficients for fit in entries[:2]] == [(-0.5, 0.1, -0.1), (-0.2, 0.1, -0.1)]
    ratio = 50 / (np.hypot(36, 24) / 2)
    assert entries[2].coefficients == pytest.approx((-0.9 / ratio**2, 0.3 / ratio**4, 0))


def test_lensfun_needs_the_camera():
    for optics in (Optics(focal_mm=4.0), Optics(crop_factor=2.0, aperture=2.0)):
        with pytest.raises(SettingError):
            write_lensfun(POLYNOMIAL, "unused.xml", optics)


def test_adobe_and_hugin_keep_a_centre_of_its_own(tmp_path):
    fit = write_lcp(DECENTRED, tmp_path / "a.lcp", OPTICS)
    assert fit.centre == DECENTRED.centre
    assert read_lcp(tmp_path / "a.lcp")[0].centre == pytest.approx(DECENTRED.centre)
    write_pto(DECENTRED, tmp_path / "a.pto")
    hugin = read_pto(tmp_path / "a.pto")[0]
    assert hugin.centre == pytest.approx(DECENTRED.centre)
    expected = DECENTRED.image() / DECENTRED.image().max()
    for back in (read_lcp(tmp_path / "a.lcp")[0].vignette(), hugin.vignette()):
        assert np.abs(back.image() - expected).max() < fit.worst + 0.002


def test_hugin_computes_the_same_vignette(tmp_path):
    """ResponseTransform::calcVigFactor of hugin, whose radius is 1 at half the hypotenuse of width and height."""
    width, height = SIZE
    vignette = PolynomialVignette(SIZE, POLYNOMIAL.coefficients, DECENTRED.centre)
    write_pto(vignette, tmp_path / "a.pto")
    text = (tmp_path / "a.pto").read_text()
    b, c, d, shift_x, shift_y = (float(re.search(rf" V{key}(\S+)", text)[1]) for key in "bcdxy")
    x, y = np.meshgrid(np.arange(width) - (width - 1) / 2 - shift_x, np.arange(height) - (height - 1) / 2 - shift_y)
    squared = (x**2 + y**2) / ((width / 2) ** 2 + (height / 2) ** 2)
    factor = 1 + b * squared + c * squared**2 + d * squared**3
    np.testing.assert_allclose(factor, vignette.image(), atol=1e-6)


@pytest.mark.parametrize("name", ["a.pto", "a.lcp"])
def test_an_imported_centre_is_exported_again(name, tmp_path):
    def write(vignette, path):
        return write_pto(vignette, path) if path.suffix == ".pto" else write_lcp(vignette, path, OPTICS)

    def read(path):
        return (read_pto if path.suffix == ".pto" else read_lcp)(path)[0]

    write(DECENTRED, tmp_path / name)
    first = read(tmp_path / name)
    Calibration(SIZE, vignette=first.vignette()).save(tmp_path / "calibration.json")
    again = write(Calibration.load(tmp_path).vignette, tmp_path / f"again_{name}")
    assert (again.centre, again.coefficients, again.worst) == (first.centre, first.coefficients, 0)
    second = read(tmp_path / f"again_{name}")
    assert second.centre == pytest.approx(first.centre, abs=1e-8)
    assert second.coefficients == pytest.approx(first.coefficients, abs=1e-8)


def test_lcp_in_attribute_form_and_without_its_own_focal_length_is_read(tmp_path):
    (tmp_path / "a.lcp").write_text(
        '<x:xmpmeta xmlns:x="adobe:ns:meta/" xmlns:r="http://www.w3.org/1999/02/22-rdf-syntax-ns#" '
        'xmlns:c="http://ns.adobe.com/photoshop/1.0/camera-profile"><r:RDF><r:Seq><r:li>'
        '<r:Description c:Lens="Zoom" c:SensorFormatFactor="1.5" c:FocalLength="18" c:ApertureValue="4" '
        'c:ImageWidth="96" c:ImageLength="72"><c:PerspectiveModel><r:Description c:Version="2">'
        '<c:VignetteModel c:VignetteModelParam1="-0.4" c:VignetteModelParam2="0.2"/>'
        "</r:Description></c:PerspectiveModel></r:Description></r:li></r:Seq></r:RDF></x:xmpmeta>"
    )
    (entry,) = read_lcp(tmp_path / "a.lcp")
    assert entry.size == SIZE
    ratio = 18 * 1.5 / (np.hypot(36, 24) / 2)
    assert entry.coefficients == pytest.approx((-0.4 / ratio**2, 0.2 / ratio**4, 0))


def test_lcp_without_a_focal_length_or_size_is_not_guessed(tmp_path):
    write_lcp(POLYNOMIAL, tmp_path / "a.lcp", OPTICS)
    text = (tmp_path / "a.lcp").read_text()
    (tmp_path / "b.lcp").write_text(text.replace("ImageWidth", "Nothing"))
    with pytest.raises(SettingError, match="size"):
        read_lcp(tmp_path / "b.lcp")
    np.testing.assert_allclose(read_lcp(tmp_path / "b.lcp", SIZE)[0].coefficients, POLYNOMIAL.coefficients, atol=1e-7)
    assert read_lcp(tmp_path / "a.lcp", (2 * SIZE[0], SIZE[1]))[0].size == SIZE
    (tmp_path / "c.lcp").write_text(text.replace("FocalLengthX", "Nothing").replace("FocalLength>", "Nothing>"))
    with pytest.raises(FormatError, match="focal length"):
        read_lcp(tmp_path / "c.lcp")
    (tmp_path / "d.lcp").write_text(text.replace("VignetteModel", "Nothing"))
    with pytest.raises(FormatError, match="no vignette"):
        read_lcp(tmp_path / "d.lcp")
    (tmp_path / "e.lcp").write_text(text.replace("<stCamera:VignetteModelParam1>", "<stCamera:VignetteModelParam1>x"))
    with pytest.raises(FormatError, match="not a number"):
        read_lcp(tmp_path / "e.lcp")


@pytest.mark.parametrize(
    "name", ["ApertureValue", "FocalLength", "FocalLengthX", "ImageWidth", "VignetteModelParam3"]
)
@pytest.mark.parametrize("number", ["1e300", "-1e300", "1e-300", "0", "1e999", "nan", "9" * 400])
def test_absurd_numbers_in_a_profile_are_ignored_or_refused_by_name(tmp_path, name, number):
    write_lcp(POLYNOMIAL, tmp_path / "a.lcp", OPTICS)
    text = re.sub(rf"(<stCamera:{name}>)[^<]*", rf"\g<1>{number}", (tmp_path / "a.lcp").read_text())
    assert number in text
    (tmp_path / "a.lcp").write_text(text)
    try:
        (fit,) = read_lcp(tmp_path / "a.lcp")
    except (FormatError, SettingError) as error:
        assert "a.lcp" in str(error)  # noqa: PT017
    else:
        assert np.all(fit.vignette().image() > 0)


def test_hugin_links_between_images_are_followed(tmp_path):
    write_pto(POLYNOMIAL, tmp_path / "a.pto")
    linked = 'i w96 h72 f0 v=0 Ra=0 Rb=0 Rc=0 Rd=0 Re=0 Eev1.5 Va=0 Vb=0 Vc=0 Vd=0 Vx=0 Vy=0 Vm5 n"Vb9.jpg"\n'
    (tmp_path / "a.pto").write_text((tmp_path / "a.pto").read_text() + linked)
    first, second = read_pto(tmp_path / "a.pto")
    assert second == first


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "no image line"),
        ("i w0 h72 Vb0\n", "0×72 is no"),
        ("i w999999 h720 Vb0\n", "999999×720 is no"),
        ("i w9999999999999999999999 h72 Vb0\n", "image size"),
        ("i w96 h72 Vb=7\n", "Vb"),
        ("i w96 h72 Vb1e\n", "Vb"),
    ],
)
def test_damaged_projects_are_refused(tmp_path, text, reason):
    (tmp_path / "a.pto").write_text(text)
    with pytest.raises(FormatError, match=reason):
        read_pto(tmp_path / "a.pto")
