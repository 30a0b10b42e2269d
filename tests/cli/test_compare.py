from __future__ import annotations

import json

import pytest

from command_line import leave_out, ospc
from ospc.errors import FormatError, SettingError
from ospc.formats.dso import write_pcalib, write_vignette
from ospc.formats.lens_profiles import write_lensfun
from ospc.formats.radial import Optics
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette
from ospc.simulation import SimulationSettings, simulate


@pytest.fixture(scope="module", autouse=True)
def pictures() -> None:
    """Render pictures in full."""


@pytest.fixture
def folders(tmp_path):
    for name, exponent, fall in (("a", 1.8, -0.27), ("b", 2.0, -0.3)):
        (tmp_path / name).mkdir()
        write_pcalib(Response.gamma(exponent), tmp_path / name / "pcalib.txt")
        write_vignette(PolynomialVignette((64, 48), (fall, 0.0, 0.0)), tmp_path / name / "vignette.png")
    return str(tmp_path / "a"), str(tmp_path / "b")


def run(*arguments: str):
    result = ospc("compare", *arguments)
    assert result.exit_code == 0, result.output
    return result.output


def test_the_table_explains_the_scale_and_aligns_nothing_by_default(folders):
    output = run(*folders)
    assert "The scale cannot be observed" in output
    assert "unaligned" in output
    assert "γ =" not in output


def test_gamma_alignment_is_labelled_and_shown_with_the_unaligned_figures(folders):
    output = run(*folders, "--gamma")
    assert "unaligned" in output
    assert "after γ = 1.1" in output
    assert "exponent" in output


def test_images_of_different_sizes_are_stated(folders, tmp_path):
    write_vignette(PolynomialVignette((32, 24), (-0.3, 0.0, 0.0)), tmp_path / "half.png")
    assert "The images have" not in run(*folders)
    output = run(folders[0], str(tmp_path / "half.png"))
    assert "The images have 64x48 and 32x24 pixels, so vignettes are compared along the half diagonals" in output


def test_json(folders, tmp_path):
    content = json.loads(run(*folders, "--json", "--gamma"))
    assert content["unaligned"]["exponent"] == 1
    assert content["gamma_aligned"]["exponent"] == pytest.approx(2 / 1.8, rel=0.02)
    assert content["gamma_aligned"]["response_rmse"] < content["unaligned"]["response_rmse"]


def test_lensfun_takes_the_image_size_from_the_other_file(folders, tmp_path):
    vignette = PolynomialVignette((64, 48), (-0.3, 0.0, 0.0))
    write_lensfun(vignette, tmp_path / "lens.xml", Optics(focal_mm=4.0, crop_factor=6.0, aperture=2.0))
    lens = str(tmp_path / "lens.xml")
    for pair in ((lens, folders[1]), (folders[1], lens)):
        assert json.loads(run(*pair, "--json"))["unaligned"]["vignette_pixel_rmse"] < 1e-5
    result = ospc("compare", lens, lens)
    assert isinstance(result.exception, SettingError)


def test_other_commands_take_it_from_the_recording_or_the_calibration(tmp_path, monkeypatch):
    leave_out(monkeypatch, "draw", "report")
    recording, lens, out = tmp_path / "recording", tmp_path / "lens.xml", tmp_path / "out"
    made = simulate(recording, SimulationSettings(size=(128, 96), frames=12, speed=2.0, exposure="cycle"))
    write_lensfun(made.vignette, lens, Optics(focal_mm=4.0, crop_factor=6.0, aperture=2.0))
    for command in (
        ["calibrate", recording, "-o", out],
        ["report", out],
        ["merge", out, "-o", tmp_path / "merged"],
    ):
        result = ospc(*command, "--truth", lens)
        assert result.exit_code in (0, 3), result.exception
    result = ospc("evaluate", "tracking", recording, "--calibration", lens, "--assume-missing")
    assert result.exit_code == 0, result.exception


def test_repair_is_not_suggested_for_files_of_another_kind(folders, tmp_path):
    for name, text in (("lens.txt", "<lensdatabase/>"), ("notes.md", "0 1 2"), ("empty.txt", "")):
        (tmp_path / name).write_text(text)
        result = ospc("compare", str(tmp_path / name), folders[0])
        assert isinstance(result.exception, FormatError)
        assert "--repair" not in str(result.exception)
    result = ospc("compare", str(tmp_path / "lens.txt"), folders[0])
    assert "other files are recognised by their suffix: .pto (hugin)" in str(result.exception)


def test_a_table_that_can_be_repaired_is_sent_to_validate(folders, tmp_path):
    (tmp_path / "pcalib.txt").write_text(" ".join(str(i if i != 100 else 98) for i in range(256)))
    result = ospc("compare", str(tmp_path / "pcalib.txt"), folders[0])
    assert "run 'ospc validate --repair FILE' for a repaired copy" in str(result.exception)


def test_plot(folders, tmp_path):
    assert "plot.svg" in run(*folders, "--plot", str(tmp_path / "plot.svg"))
    assert (tmp_path / "plot.svg").stat().st_size > 1000
    again = ospc("compare", *folders, "--plot", tmp_path / "plot.svg")
    assert "exists already" in str(again.exception)
    assert "plot.svg" in run(*folders, "--plot", str(tmp_path / "plot.svg"), "--force")


def test_calibrations_in_folders_of_the_same_name_are_distinguished(folders, tmp_path):
    for name, folder in zip(("one", "two"), folders, strict=True):
        (tmp_path / name).mkdir()
        (tmp_path / name / "seq").symlink_to(folder)
    pair = [str(tmp_path / name / "seq") for name in ("one", "two")]
    assert f"{pair[0]}  against  {pair[1]}" in run(*pair, "--plot", str(tmp_path / "plot.svg"))
    drawn = (tmp_path / "plot.svg").read_text()
    assert "one/seq" in drawn
    assert "two/seq" in drawn
