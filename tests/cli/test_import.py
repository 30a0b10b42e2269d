"""``ospc import`` turns other programs' files into a calibration; exporting it restores them unchanged."""

from __future__ import annotations

import numpy as np
import pytest

from command_line import ospc
from log_polynomials import log_polynomial
from ospc.errors import FormatError, SettingError
from ospc.formats.dso import write_pcalib, write_vignette
from ospc.formats.hugin import write_pto
from ospc.formats.lens_profiles import write_lensfun
from ospc.formats.radial import Optics
from ospc.photometry.calibration import Calibration
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette

SIZE = (64, 48)


@pytest.fixture
def files(tmp_path):
    pcalib = write_pcalib(Response.gamma(2.2), tmp_path / "pcalib.txt")
    return pcalib, write_vignette(log_polynomial(SIZE, (-0.6, -0.2), (0.1, 0.0)), tmp_path / "vignette.png")


run = ospc


def test_export_writes_the_imported_files_again(files, tmp_path):
    place = tmp_path / "calibration.json"
    assert run("import", *files, "-o", place).exit_code == 0
    assert run("export", place, "--to", "dso", "-o", tmp_path / "back").exit_code == 0
    for file in files:
        assert (tmp_path / "back" / file.name).read_bytes() == file.read_bytes()


def test_the_result_names_its_sources_and_states_no_uncertainty(files, tmp_path):
    result = run("import", *files, "-o", tmp_path / "c.json")
    assert "64x48" in result.output
    assert "pcalib.txt" in result.output
    calibration = Calibration.load(tmp_path / "c.json")
    assert (calibration.size, calibration.max_grey, calibration.complete) == (SIZE, 255, True)
    assert calibration.response.inverse_sigma is None
    assert "no uncertainty" in calibration.verdicts["response"].reason
    assert "pcalib.txt" in calibration.source["imported_from"]
    np.testing.assert_allclose(calibration.response.inverse_table, np.linspace(0, 1, 256) ** 2.2, atol=1e-8)


def test_a_single_part_stays_a_single_part(files, tmp_path):
    pcalib, vignette = files
    assert run("import", pcalib, "--size", "64x48", "-o", tmp_path / "g.json").exit_code == 0
    response_only = Calibration.load(tmp_path / "g.json")
    assert response_only.vignette is None
    assert not response_only.verdicts["vignette"].known
    assert run("import", vignette, "-o", tmp_path / "v.json").exit_code == 0
    vignette_only = Calibration.load(tmp_path / "v.json")
    assert vignette_only.response is None
    assert vignette_only.size == SIZE
    assert run("import", tmp_path / "g.json", tmp_path / "v.json", "-o", tmp_path / "both.json").exit_code == 0
    assert Calibration.load(tmp_path / "both.json").complete


def test_the_response_of_a_pto_is_said_not_to_be_read_instead_of_missing(files, tmp_path):
    write_pto(PolynomialVignette(SIZE, (-0.3, 0.0, 0.0)), tmp_path / "x.pto")
    result = run("import", tmp_path / "x.pto", "-o", tmp_path / "x.json")
    assert "response: the response in a .pto is not read, because" in result.stdout
    assert "import it from a pcalib.txt" in result.stdout
    both = run("import", files[0], tmp_path / "x.pto", "-o", tmp_path / "both.json")
    assert "not read" not in both.stdout
    assert Calibration.load(tmp_path / "both.json").complete


def test_folders_and_calibrations_are_imported_completely(files, tmp_path):
    assert run("import", tmp_path, "-o", tmp_path / "out.json").exit_code == 0
    assert Calibration.load(tmp_path / "out.json").complete
    whole = Calibration(SIZE, Response.gamma(2.0), PolynomialVignette(SIZE, (-0.3, 0.0, 0.0)), counts={"pairs": 7})
    place = whole.save(tmp_path / "whole.json")
    assert run("import", place, "--max-grey", 4095, "-o", tmp_path / "again.json").exit_code == 0
    again = Calibration.load(tmp_path / "again.json")
    assert (again.counts, again.max_grey) == ({"pairs": 7}, 4095)


@pytest.mark.parametrize("names", [("",), ("pcalib.txt", "vignette.png")])
def test_files_of_unknown_exposures_stay_labelled(tmp_path, names):
    response, vignette = Response.gamma(2.0), PolynomialVignette(SIZE, (-0.3, 0.0, 0.0))
    unknown = Calibration(SIZE, response, vignette, exponent_sigma=0.3)
    folder = tmp_path / "files"
    assert run("export", unknown.save(tmp_path / "unknown.json"), "--to", "dso", "-o", folder).exit_code == 0
    result = run("import", *(folder / name for name in names), "-o", tmp_path / "c.json")
    assert unknown.caveat in result.output
    calibration = Calibration.load(tmp_path / "c.json")
    assert calibration.caveat == unknown.caveat
    assert calibration.verdicts["response"].state == calibration.verdicts["vignette"].state == "marginal"
    assert run("export", tmp_path / "c.json", "--to", "dso", "-o", tmp_path / "back").exit_code == 0
    label = "EXPOSURES_UNKNOWN.txt"
    assert (tmp_path / "back" / label).read_bytes() == (folder / label).read_bytes()


def test_lensfun_files_require_a_size(tmp_path):
    vignette = PolynomialVignette(SIZE, (-0.3, 0.1, -0.05))
    write_lensfun(vignette, tmp_path / "lens.xml", Optics(focal_mm=4.0, crop_factor=6.0, aperture=2.0))
    refused = run("import", tmp_path / "lens.xml", "-o", tmp_path / "c.json")
    assert isinstance(refused.exception, SettingError)
    assert "lens.xml: does not state the image size; add --size WxH to 'ospc import'" in str(refused.exception)
    assert run("import", tmp_path / "lens.xml", "--size", "64x48", "-o", tmp_path / "c.json").exit_code == 0
    assert Calibration.load(tmp_path / "c.json").vignette == vignette


@pytest.mark.parametrize(
    ("values", "options", "max_grey"),
    [(256, [], 255), (257, [], 256), (4096, [], 4095), (65536, [], 65535), (256, ["--max-grey", 4095], 4095)],
)
def test_the_largest_grey_value_is_that_of_the_table_by_default(files, tmp_path, values, options, max_grey):
    write_pcalib(Response.gamma(1.5, values), files[0], values)
    assert run("import", *files, *options, "-o", tmp_path / "c.json").exit_code == 0
    assert Calibration.load(tmp_path / "c.json").max_grey == max_grey


def test_invalid_combinations_are_refused(files, tmp_path):
    pcalib, vignette = files
    out = tmp_path / "c.json"
    cases = [
        ((pcalib,), SettingError, "image size"),
        ((pcalib, pcalib), FormatError, "must have only a response"),
        ((tmp_path, vignette), FormatError, "must have only a response"),
        ((pcalib, vignette, "--size", "32x24"), SettingError, "64×48"),
        ((pcalib, "--size", "999999x999999"), FormatError, "at most"),
        ((tmp_path / "no.txt",), FormatError, "No such file"),
    ]
    for arguments, error, words in cases:
        result = run("import", *arguments, "-o", out)
        assert isinstance(result.exception, error), arguments
        assert words in str(result.exception)
        assert not out.exists()
    before = pcalib.read_bytes()
    assert isinstance(run("import", pcalib, vignette, "-o", pcalib).exception, SettingError)
    assert pcalib.read_bytes() == before
    falling = tmp_path / "falling.txt"
    falling.write_text(" ".join(str(255 - i) for i in range(256)))
    assert isinstance(run("import", falling, vignette, "-o", out).exception, FormatError)
    assert run("import", pcalib, vignette).exit_code == 2
    assert run("import", pcalib, "--max-grey", 0, "-o", out).exit_code == 2


def test_a_file_that_exists_is_replaced_only_by_force(files, tmp_path):
    out = tmp_path / "times.json"
    out.write_text("mine")
    assert "exists already" in str(run("import", *files, "-o", out).exception)
    assert out.read_text() == "mine"
    assert run("import", *files, "-o", out, "--force").exit_code == 0
    assert "must have the suffix .json" in str(run("import", *files, "-o", tmp_path / "out.txt").exception)
