"""Validation reports what the programs would do with a file: every broken rule is found, and nothing else."""

from __future__ import annotations

import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest

from log_polynomials import log_polynomial
from ospc.errors import FormatError
from ospc.formats.dso import read_pcalib, write_pcalib, write_times, write_vignette
from ospc.formats.validation import ParameterFile, kind_of, repair, validate
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette
from ospc.simulation.responses import RESPONSES

COUNTING = " ".join(map(str, range(256)))
CAMERA = "0.5 0.6 0.5 0.5 0.9\n640 480\ncrop\n640 480\n"


def found(path: Path, program="dso", size=None) -> list[tuple[str, str]]:
    """Return severity and rule of all findings for one file, except the note that its partner is missing."""
    findings = validate([path], program, size).findings
    assert all(f.file == str(path) and f.rule and f.effect for f in findings)
    return [(f.severity, f.rule) for f in findings if "a vignette is used with" not in f.rule]


def errors(path: Path, program="dso", size=None) -> str:
    """Return all broken rules."""
    return " / ".join(rule for severity, rule in found(path, program, size) if severity == "error")


@pytest.fixture
def folder(tmp_path) -> Path:
    """A valid recording."""
    write_pcalib(Response.gamma(2.0), tmp_path / "pcalib.txt")
    write_vignette(PolynomialVignette((640, 480), (-0.3, 0.0, 0.0)), tmp_path / "vignette.png")
    write_times(tmp_path / "times.txt", [0, 1, 2], [0.0, 0.1, 0.2], [1.0, 2.0, 3.0])
    (tmp_path / "camera.txt").write_text(CAMERA)
    (tmp_path / "images").mkdir()
    for i in range(3):
        (tmp_path / "images" / f"{i:05d}.png").write_bytes(b"")
    return tmp_path


@pytest.mark.parametrize("program", ["dso", "mono"])
def test_what_this_project_writes_is_faultless(folder, program):
    result = validate([folder], program)
    assert result.findings == ()
    assert result.valid
    assert result.size == (640, 480)
    assert [f.kind for f in result.files] == ["pcalib", "vignette", "times", "camera"]


@pytest.mark.parametrize("exponent", [0.45, 0.9])
def test_a_response_instead_of_its_inverse_is_suspected(tmp_path, exponent):
    (tmp_path / "pcalib.txt").write_text(" ".join(f"{v:.9g}" for v in 255 * np.linspace(0, 1, 256) ** exponent))
    ((severity, rule),) = found(tmp_path / "pcalib.txt")
    assert severity == "warning"
    assert "look like the response" in rule


@pytest.mark.parametrize("name", sorted(RESPONSES))
def test_no_inverse_response_is_taken_for_a_response(tmp_path, name):
    write_pcalib(RESPONSES[name](), tmp_path / "pcalib.txt")
    assert "look like the response" not in str(found(tmp_path / "pcalib.txt"))


def test_the_inverse_of_a_vignette_is_suspected(folder):
    before = cv2.imread(str(folder / "vignette.png"), cv2.IMREAD_UNCHANGED).astype(float)
    cv2.imwrite(str(folder / "vignette.png"), np.rint(before.min() / before * 65535).astype(np.uint16))
    ((severity, rule),) = found(folder / "vignette.png", size=(640, 480))
    assert severity == "warning"
    assert "looks like 1/V" in rule


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.4, 0.3)])
def test_flat_and_decentred_vignettes_are_not_taken_for_inverse_ones(tmp_path, shift):
    for strength in (0.0, -0.3, -0.8):
        write_vignette(log_polynomial((160, 120), (strength,), shift), tmp_path / "vignette.png")
        assert "1/V" not in str(found(tmp_path / "vignette.png", size=(160, 120)))


@pytest.mark.parametrize(
    ("text", "program", "complaint"),
    [
        (" ".join(map(str, range(255))), "dso", "at least 256 values on the first line; there are 255"),
        (COUNTING.replace(" ", "\n"), "dso", "there are 1"),
        ("0\n1\n2\n", "dso", "all values must be on one line; 2 lines too many, the first '1'"),
        (COUNTING.replace(" ", ","), "dso", "',1,2,3"),
        (COUNTING.replace(" 100 ", " nan "), "dso", "value 101 is 'nan'"),
        (COUNTING.replace(" 100 ", " 1e60 "), "dso", "value 101 is '1e+60'"),
        (COUNTING.replace(" 100 ", " 98 "), "dso", "after grey level 99 it is not (1 value decreasing, 0 equal"),
        (
            COUNTING.replace(" 100 ", " 99.00000001 "),
            "dso",
            "after grey level 99 it is not (0 values decreasing, 1",
        ),
        (COUNTING + " 256", "mono", "exactly 256 values on the first line; there are 257"),
        (" ".join(map(str, range(65537))), "dso", "at most 65536"),
        ("", "mono", "exactly 256 values on the first line; there are 0"),
        ("0 255", "dso", "at least 256 values on the first line; there are 2"),
    ],
)
def test_tables_that_are_refused(tmp_path, text, program, complaint):
    place = tmp_path / "pcalib.txt"
    place.write_text(text)
    assert complaint in errors(place, program)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (COUNTING + " end\n", "value 257 is 'end'"),
        (COUNTING + "\ngamma: 1\n", "1 line too many"),
        (" ".join(map(str, range(1024))), "1024 values"),
    ],
)
def test_tables_that_are_taken_but_not_as_meant(tmp_path, text, complaint):
    place = tmp_path / "pcalib.txt"
    place.write_text(text)
    assert errors(place) == ""
    assert any(severity == "warning" and complaint in rule for severity, rule in found(place))


def test_a_finding_states_the_file_apart_from_the_rule(tmp_path):
    place = tmp_path / "line\nbreak"
    place.mkdir()
    (place / "vignette.png").write_text("no image")
    assert validate([place / "vignette.png"], "dso").findings[0].rule.startswith("not a PNG")


def test_a_table_too_short_for_converted_images_is_noticed(tmp_path):
    place = tmp_path / "pcalib_16bit.txt"
    for count, noticed in ((4096, True), (65536, False)):
        write_pcalib(Response.gamma(2.0), place, count)
        (finding,) = [f for f in validate([place], "dso").findings if f.severity == "warning"]
        assert ("those written by 'ospc convert' have grey values beyond 4095" in finding.effect) is noticed


@pytest.mark.parametrize(
    "response",
    [
        Response.gamma(1.0),
        Response.gamma(2.2),
        Response(np.interp(np.arange(256), [0, 88, 188, 255], [0, 0.068, 0.464, 1])),
    ],
)
def test_other_curves_with_straight_parts_are_not_doubted(tmp_path, response):
    assert found(write_pcalib(response, tmp_path / "pcalib.txt")) == []


def test_black_level_is_noted(tmp_path):
    place = tmp_path / "pcalib.txt"
    place.write_text(" ".join(str(i + 16) for i in range(256)))
    assert found(place) == [("note", "values run from 16 to 271")]
    assert "losing a black level" in validate([place], "dso").findings[0].effect
    place.write_text(" ".join(str(i * 2) for i in range(256)))
    assert validate([place], "dso").findings[0].effect == "scales them to 0..255"


def test_vignette_of_another_size_is_refused(folder):
    assert "640×480" in errors(folder / "vignette.png", size=(752, 480))
    assert found(folder / "vignette.png", size=(640, 480)) == []
    assert [s for s, _ in found(folder / "vignette.png")] == ["note"]


@pytest.mark.parametrize(
    ("change", "program", "severity", "complaint"),
    [
        (lambda v: np.dstack([v] * 3), "dso", "warning", "there are 3"),
        (lambda v: np.dstack([v] * 3), "mono", "error", "there are 3"),
        (lambda v: np.dstack([v] * 4), "mono", "error", "there are 4"),
        (lambda v: v * 0, "dso", "error", "black"),
        (lambda v: np.where(np.arange(v.size).reshape(v.shape) == 5000, 0, v), "dso", "error", "1 pixel of 0 inside"),
        (lambda v: np.where(np.arange(v.shape[1]) < 3, 0, v), "dso", "warning", "288 pixels of 0 in a surround"),
        (lambda v: np.where(np.arange(v.shape[1]) < 2, 1, v), "dso", "warning", "192 pixels below 1/20"),
        (lambda v: (v // 257).astype(np.uint8), "dso", "note", "16 bits"),
    ],
)
def test_vignettes_that_are_not_as_they_should_be(tmp_path, change, program, severity, complaint):
    values = np.full((96, 128), 60000, np.uint16)
    changed = change(values)
    place = tmp_path / "vignette.png"
    cv2.imwrite(str(place), changed.astype(np.uint8 if changed.dtype == np.uint8 else np.uint16))
    matching = [(s, rule) for s, rule in found(place, program, (128, 96)) if complaint in rule]
    assert [s for s, _ in matching] == [severity]
    assert len(found(place, program, (128, 96))) == 1


def test_a_black_vignette_is_refused_even_if_it_is_opaque(tmp_path):
    black = np.zeros((96, 128, 4), np.uint16)
    black[..., 3] = 65535
    cv2.imwrite(str(tmp_path / "vignette.png"), black)
    assert "not entirely black" in errors(tmp_path / "vignette.png")


def test_broken_picture_is_a_finding_and_does_not_stop_the_others(folder):
    (folder / "vignette.png").write_bytes((folder / "vignette.png").read_bytes()[:500])
    result = validate([folder], "dso")
    assert [(f.severity, Path(f.file).name) for f in result.findings] == [("error", "vignette.png")]
    assert len(result.files) == 4


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("0 0.0 1\n2 0.1 2\n", "2 lines for 3 files in images; no line for 00001.png"),
        ("0 0 1\n1 1 2\n2 2 2\n3 3 2\n", "4 lines for 3 files in images; no image for 3"),
        ("7 0.0 1\n8 0.1 2\n", "2 lines for 3 files in images"),
        ("", "there is none"),
        ("0.png 0.0 1\n1.png 0.1 2\n2.png 0.2 3\n", "3 lines differ, first line 1: '0.png 0.0 1'"),
        ("0,0.0,1\n1,0.1,2\n2,0.2,3\n", "separated by spaces; 3 lines differ, first line 1: '0,0.0,1'"),
        ("0.5 1\n0.6 2\n0.7 3\n", "with an integer id; 3 lines differ, first line 1: '0.5 1'"),
        ("0 0.0 0\n1 0.1\n2 0.2\n", "every zero exposure has a positive neighbour; 3 of 3 have none, first in row 1"),
        ("0 0.0 1\n1 0.1 -2\n2 0.2 nan\n", "2 of 3 are negative or not a number, first in row 2"),
        ("0 0.0 1\n" + " " * 1000 + "1 0.1 2\n2 0.2 2\n", "line 2 is longer"),
    ],
)
def test_times_that_are_dropped_or_misread(folder, text, complaint):
    (folder / "times.txt").write_text(text)
    assert complaint in errors(folder / "times.txt")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("0 0.0 1\n1 0.1 0\n2 0.2 3\n", "1 of 3 is zero or missing, first in row 2"),
        ("0 0.0 1e-3\n1 0.1 2e-3\n2 0.2 3e-3\n", "in seconds"),
        ("0 0.0 1000\n1 0.1 5000\n2 0.2 8000\n", "in microseconds"),
        ("0 0 1\n1 100000000 2\n2 200000000 3\n", "as if they were in milli- or nanoseconds"),
        ("0 0.1 1\n1 0.1 2\n2 0.2 3\n", "after line 1 they do not"),
        ("1520531829251142058 0 1\n1520531829351142058 0.1 2\n1520531829451142058 0.2 3\n", "32-bit integers"),
    ],
)
def test_times_that_are_taken_but_not_as_meant(folder, text, complaint):
    (folder / "times.txt").write_text(text)
    assert [s for s, rule in found(folder / "times.txt") if complaint in rule] == ["warning"]
    assert errors(folder / "times.txt") == ""


def test_times_without_exposures_are_valid_and_said(folder):
    (folder / "times.txt").write_text("0 0.0\n1 0.1\n2 0.2\n")
    assert found(folder / "times.txt") == [("note", "the third column has the exposures; there is none")]


def test_run_of_zero_exposures_drops_all_of_them_only_in_dso(folder):
    # the first zero is replaced by its left neighbour, then the second by the first
    (folder / "times.txt").write_text("0 0.0 1\n1 0.1 0\n2 0.2 0\n")
    assert errors(folder / "times.txt", "dso") == ""
    assert "2 of 3" in errors(folder / "times.txt", "mono")


def test_comments_are_passed_over(folder):
    (folder / "times.txt").write_text("# id stamp exposure\n0 0.0 1\n1 0.1 2\n\n2 0.2 3\n")
    assert found(folder / "times.txt") == []


def test_images_that_sort_in_another_order_as_text_are_refused(folder):
    for i in range(3):
        (folder / "images" / f"{i:05d}.png").rename(folder / "images" / f"{i + 8}.png")
    assert "'10.png' comes before '8.png'" in errors(folder / "times.txt")
    assert "'10.png' comes before '8.png'" in errors(folder / "times.txt", "mono")
    with pytest.raises(FormatError, match="ospc convert"):
        repair(ParameterFile(folder / "times.txt", "times"))


def test_a_byte_order_mark_is_named_removed_and_skipped_where_we_read(folder):
    for name in ("pcalib.txt", "times.txt", "camera.txt"):
        place = folder / name
        known, before = kind_of(place), place.read_text()
        place.write_text(f"\ufeff{before}")
        assert kind_of(place) == known
        assert errors(place) == "no byte order mark at the beginning; there is one"
        assert repair(ParameterFile(place, known)).path.read_text() == before
    assert read_pcalib(folder / "pcalib.txt").inverse_table.size == 256


def test_decimal_commas_are_not_taken_for_separators(tmp_path):
    place = tmp_path / "pcalib.txt"
    place.write_text(" ".join(f"{i},5" for i in range(256)))
    assert "decimal points" in validate([place], "dso").findings[0].remedy
    with pytest.raises(FormatError, match="decimal points"):
        repair(ParameterFile(place, "pcalib"))


def test_images_in_an_archive_are_counted(folder):
    for image in (folder / "images").iterdir():
        image.unlink()
    (folder / "images").rmdir()
    assert [s for s, _ in found(folder / "times.txt")] == ["note"]
    assert "images.zip" in validate([folder], "dso").findings[0].remedy
    with zipfile.ZipFile(folder / "images.zip", "w") as archive:
        for i in range(4):
            archive.writestr(f"{i}.png", b"")
    assert "3 lines for 4 files" in errors(folder / "times.txt")
    content = (folder / "images.zip").read_bytes()
    (folder / "images.zip").write_bytes(content.replace(b"PK\x01\x02\x14\x03\x14", b"PK\x01\x02\x14\x03\x63"))
    assert "was not compared" in validate([folder], "dso").findings[0].effect


@pytest.mark.parametrize(
    ("text", "program", "complaint"),
    [
        (CAMERA.replace("\n", "\r\n"), "dso", "'crop\\r'"),
        ("FOV " + CAMERA, "mono", "without a name"),
        (CAMERA.replace("crop", "full"), "dso", "not 'full'"),
        (CAMERA.replace("crop", "none").replace("640 480\n", "320 240\n", 1), "dso", "320×240 becomes 640×480"),
        ("0.5 0.6 0.5 0.5 0.9\n640 480\n", "dso", "line 3"),
        ("0.5 0.6 0.5 0.5 0.9\n640 480\ncrop\n", "mono", "line 4"),
        ("0.5 0.6 0.5 0.5\n640 480\ncrop\n640 480\n", "dso", "line 1"),
        ("0.5 0.6 0.5 0.5 0.9\nVGA\ncrop\n640 480\n", "dso", "line 2"),
        ("400 400 0.5 0.5 0.9\n640 480\ncrop\n640 480\n", "dso", "same unit"),
        ("400 400 320 240 0.9\n640 480\ncrop\n640 480\n", "mono", "relative to the image size"),
        ("0.5 0.6 0.5 0.5 50\n640 480\ncrop\n640 480\n", "dso", "radians"),
        (CAMERA.replace("crop\n640 480", "crop\n642 482"), "dso", "642×482 ends at 321×241 after 1"),
    ],
)
def test_cameras_that_are_refused_or_misread(tmp_path, text, program, complaint):
    place = tmp_path / "camera.txt"
    place.write_bytes(text.encode())
    assert complaint in errors(place, program)


@pytest.mark.parametrize(
    ("text", "program"),
    [
        (CAMERA, "mono"),
        ("FOV " + CAMERA, "dso"),
        ("Pinhole 400 400 319.5 239.5 0\n640 480\nnone\n640 480\n", "dso"),
        ("400 400 319.5 239.5 0\n640 480\n0.4 0.5 0.5 0.5 0\n640 480\n", "dso"),
        ("RadTan 400 400 319.5 239.5 0.1 -0.2 0 0\n640 480\ncrop\n640 480\n", "dso"),
        ("400 400 319.5 239.5 0.1 -0.2 0 0\n640 480\ncrop\n640 480\n", "dso"),
        ("EquiDistant 190 190 254 256 0.003 0.0007 -0.002 0.0002\n512 512\ncrop\n512 512\n", "dso"),
    ],
)
def test_cameras_that_are_accepted(tmp_path, text, program):
    place = tmp_path / "camera.txt"
    place.write_text(text)
    assert found(place, program) == []


def test_camera_for_another_size_is_refused(folder):
    assert "320×240" in errors(folder / "camera.txt", size=(320, 240))


def test_kinds_are_recognised_by_content_if_the_name_does_not_tell(folder):
    for name in ("pcalib.txt", "vignette.png", "times.txt", "camera.txt"):
        kind = kind_of(folder / name)
        renamed = (folder / name).rename(folder / f"{kind[0]}.dat")
        assert kind_of(renamed) == kind
    for text in ("hello", "Pinhole", "FOV\nis short for field of view"):
        (folder / "notes.md").write_text(text)
        with pytest.raises(FormatError, match="not recognised"):
            kind_of(folder / "notes.md")


def test_nothing_to_check_is_an_error(tmp_path):
    with pytest.raises(FormatError, match="has none of"):
        validate([tmp_path], "dso")
    with pytest.raises(FormatError, match="no such file"):
        validate([tmp_path / "pcalib.txt"], "dso")


def test_vignette_without_response_is_noted(folder):
    (note,) = validate([folder / "vignette.png", folder / "camera.txt"], "mono").findings
    assert note.rule == "a vignette is used with a pcalib.txt; none was given"
    assert note.effect.startswith("then corrects neither")  # after "it"


@pytest.mark.parametrize(
    ("name", "program", "expected"),
    [
        ("dji_pcalib.txt", "dso", [("error", "after grey level 54 it is not (30 values decreasing")]),
        ("dji_pcalib.txt", "mono", [("error", "after grey level 54 it is not (30 values decreasing")]),
        ("denguetim_pcalib.txt", "dso", [("warning", "'vis_exponent: 1.000000'")]),
        ("tum_vi_pcalib_65536.txt", "dso", [("warning", "65536 values"), ("note", "from 0 to 65535")]),
        ("tum_vi_pcalib_65536.txt", "mono", [("error", "exactly 256 values"), ("note", "from 0 to 65535")]),
        ("shuttum_gamma_cam1.txt", "mono", [("note", "from 0.382902 to 255")]),
        ("denguetim_vignette.png", "dso", [("note", "752×480")]),
        ("shuttum_vignette_1280x1024.png", "dso", [("note", "1280×1024")]),
        (
            "tum_vi_vignette_fisheye_512.png",
            "dso",
            [("note", "512×512"), ("warning", "16891 pixels of 0 in a surround"), ("warning", "209 pixels")],
        ),
        ("tum_vi_times.txt", "dso", [("warning", "32-bit integers"), ("note", "5990 lines")]),
        ("camera_narrow.txt", "dso", [("error", "line 3")]),
        ("camera_wide.txt", "mono", [("error", "without a name"), ("error", "line 3")]),
    ],
)
def test_real_files_are_diagnosed(real_data, name, program, expected):
    actual = found(real_data / "params" / name, program)
    assert [severity for severity, _ in actual] == [severity for severity, _ in expected]
    for (_, rule), (_, words) in zip(actual, expected, strict=True):
        assert words in rule


def test_real_vignette_for_other_images_is_refused(real_data):
    assert "752×480" in errors(real_data / "params" / "denguetim_vignette.png", size=(640, 480))
