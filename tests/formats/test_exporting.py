"""Exported files can be read back unchanged, and exports report what the format cannot store."""

from __future__ import annotations

import numpy as np
import pytest

from log_polynomials import log_polynomial
from ospc.errors import FormatError, NotObservableError, SettingError
from ospc.evaluation.metrics import response_rmse, vignette_pixel_rmse
from ospc.formats.export import adapted, as_calibration, export
from ospc.formats.opening import Photometry, open_photometry
from ospc.formats.radial import Optics
from ospc.photometry.calibration import Calibration
from ospc.photometry.response import Response
from ospc.photometry.verdict import Verdict
from ospc.photometry.vignette import PolynomialVignette, RasterVignette

SIZE = (96, 72)
RESPONSE = Response.gamma(1.9)
VIGNETTE = PolynomialVignette(SIZE, (-0.3, 0.1, -0.1))
FULL = Photometry("full", RESPONSE, VIGNETTE)
OPTICS = Optics(focal_mm=4, crop_factor=6, aperture=2)
FILES = {
    "dso": "folder",
    "hugin": "a.pto",
    "opencv": "a.yml",
    "adobe": "a.lcp",
    "json": "calibration.json",
    "lensfun": "a.xml",
}


@pytest.mark.parametrize("program", sorted(FILES.keys() - {"lensfun"}))
def test_what_is_exported_can_be_opened_again(tmp_path, program):
    written = export(FULL, program, tmp_path / FILES[program], OPTICS)
    assert all(path.exists() for path in written.files)
    back = open_photometry(tmp_path / FILES[program])
    assert vignette_pixel_rmse(back.vignette, VIGNETTE) < 1e-5
    if back.response is not None:
        assert response_rmse(back.response, RESPONSE) < 1e-6
    else:
        assert any("response" in note for note in written.notes)


@pytest.mark.parametrize("program", ["lensfun", "hugin", "adobe"])
def test_residual_of_a_fit_is_stated(tmp_path, program):
    curved = Photometry("curved", None, log_polynomial(SIZE, (-0.9, -0.8)))
    notes = " ".join(export(curved, program, tmp_path / FILES[program], OPTICS).notes)
    assert "residual" in notes
    exact = Photometry("exact", None, VIGNETTE)
    assert "residual" not in " ".join(export(exact, program, tmp_path / FILES[program], OPTICS).notes)


def test_json_of_a_map_names_both_files(tmp_path):
    mapped = Photometry("map", RESPONSE, RasterVignette(VIGNETTE.image()))
    written = export(mapped, "json", tmp_path / "calibration.json")
    assert [path.name for path in written.files] == ["calibration.json", "calibration.vignette.npz"]
    assert vignette_pixel_rmse(open_photometry(tmp_path).vignette, VIGNETTE) < 1e-6


def test_unknown_parts_are_not_invented_and_the_verdict_is_told(tmp_path):
    told = "the vignette is unknown and was not written"
    for remedy, ending in (("turn the camera", "; turn the camera"), ("", "")):
        verdict = Verdict("not identifiable", "radial motion is at most 0.07", remedy)
        calibration = Calibration(SIZE, RESPONSE, None, verdicts={"vignette": verdict})
        known = Photometry("half", RESPONSE, None, calibration)
        written = export(known, "dso", tmp_path / "dso")
        assert [path.name for path in written.files] == ["pcalib.txt"]
        assert written.notes[0] == f"{told}: radial motion is at most 0.07{ending}"
    assert export(Photometry("half", RESPONSE, None), "dso", tmp_path / "dso").notes == (told,)
    for program in ("lensfun", "adobe", "hugin"):
        with pytest.raises(NotObservableError):
            export(known, program, tmp_path / FILES[program], OPTICS)
    for program in ("dso", "opencv"):
        with pytest.raises(NotObservableError):
            export(Photometry("nothing", None, None), program, tmp_path / "out.yml")


def test_nothing_is_written_for_a_program_that_is_not_known(tmp_path):
    with pytest.raises(SettingError, match="'dsoo' is not a program; known: dso, lensfun"):
        export(Photometry("half", RESPONSE, None), "dsoo", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_missing_knowledge_of_the_optics_is_named(tmp_path):
    for program in ("lensfun", "adobe"):
        with pytest.raises(SettingError, match=r"focal|crop"):
            export(FULL, program, tmp_path / FILES[program])


def test_names_without_the_suffix_of_the_format_are_refused(tmp_path):
    for program in FILES.keys() - {"dso"}:
        with pytest.raises(FormatError, match=r"out: such files must have the suffix \.\w+"):
            export(FULL, program, tmp_path / "out", OPTICS)
    assert list(tmp_path.iterdir()) == []


def test_size_of_a_bare_table_is_not_guessed(tmp_path):
    bare = Photometry("pcalib.txt", RESPONSE, None)
    for action in (
        lambda: as_calibration(bare),
        lambda: adapted(bare, size=(48, 36)),
        lambda: export(bare, "json", tmp_path / "a.json"),
    ):
        with pytest.raises(SettingError, match="image size"):
            action()


def test_files_of_another_calibration_next_to_the_new_ones_are_named(tmp_path):
    assert export(FULL, "dso", tmp_path).notes == ()
    assert export(FULL, "dso", tmp_path).notes == ()
    notes = export(Photometry("pcalib.txt", RESPONSE, None), "dso", tmp_path).notes
    assert f"{tmp_path / 'vignette.png'} is not of this calibration" in notes[-1]


def test_crop_comes_before_scaling():
    changed = adapted(FULL, (8, 6, 80, 60), (40, 30))
    assert changed.vignette.size == (40, 30)
    assert changed.calibration is None
    blocks = VIGNETTE.image()[6:66, 8:88].reshape(30, 2, 40, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(
        changed.vignette.image() / changed.vignette.image().max(), blocks / blocks.max(), atol=1e-3
    )
    assert adapted(FULL) is FULL


def test_files_that_cannot_be_written_are_one_clear_error(tmp_path):
    (tmp_path / "file").write_text("")
    for program, out in (("dso", "file"), ("json", "no/a.json"), ("hugin", "no/a.pto"), ("opencv", "no/a.yml")):
        with pytest.raises(FormatError):
            export(FULL, program, tmp_path / out)


@pytest.mark.parametrize("text", ["0 0.00 1.5\n1 0.05 2.5\n", "0,1\n1,2\n", "0.5 0.8\n64 48\n", "# id\n0\n"])
def test_an_invalid_pcalib_is_refused(tmp_path, text):
    place = tmp_path / "times.txt"
    place.write_text(text)
    with pytest.raises(FormatError, match=r"times\.txt: is not a pcalib\.txt, .* on one line; .* by their suffix"):
        open_photometry(place)


def test_the_folder_of_several_calibrations_names_them(tmp_path):
    for channel in ("red", "green"):
        (tmp_path / channel).mkdir()
        export(FULL, "json", tmp_path / channel / "calibration.json")
    with pytest.raises(FormatError, match="; give one of its folders: green, red"):
        open_photometry(tmp_path)


def test_files_with_several_vignettes_are_not_chosen_from(tmp_path):
    export(FULL, "hugin", tmp_path / "a.pto")
    second = 'i w96 h72 Vb-0.9 Vc0 Vd0 n"b.jpg"\n'
    (tmp_path / "a.pto").write_text((tmp_path / "a.pto").read_text() + second)
    with pytest.raises(FormatError, match="2 different"):
        open_photometry(tmp_path / "a.pto")
