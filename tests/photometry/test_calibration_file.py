"""Calibration files: loading restores the saved values, and errors about other files name the file."""

from __future__ import annotations

import json
import shutil
import tracemalloc
import zipfile
from dataclasses import fields, replace
from typing import get_args
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ospc.errors import FormatError
from ospc.photometry.calibration import PROFILE_RADII, SCHEMA, Calibration
from ospc.photometry.coverage import Coverage, ExposureRatios
from ospc.photometry.noise import NoiseModel
from ospc.photometry.response import Response
from ospc.photometry.verdict import State, Verdict
from ospc.photometry.vignette import LogSplineVignette, PolynomialVignette, RasterVignette

SIZE = (12, 9)
VIGNETTES = {
    "polynomial": PolynomialVignette(SIZE, (-0.31, 0.07, -0.1 / 3)),
    "decentred polynomial": PolynomialVignette(SIZE, (-0.31, 0.07, -0.1 / 3), (0.05, -0.02)),
    "spline": LogSplineVignette(
        SIZE, (-0.31, 0.07, -0.1 / 3, 1e-9), (0.05, -0.02), (0.02, -0.01, 0.01, -0.02, 0.03, -0.04, 0.05, -0.06)
    ),
    "limited spline": LogSplineVignette(SIZE, (-0.31, 0.07, -0.1 / 3), (0.05, -0.02), limit=0.9, reach=1.1),
    "raster": RasterVignette(
        np.random.default_rng(0).uniform(0.2, 1, SIZE[::-1]).astype(np.float32), {"file": "vignette.png"}
    ),
    "none": None,
}
FULL = Calibration(
    size=SIZE,
    response=Response(
        np.linspace(0, 1, 256) ** (7 / 3),
        log_sigma=np.linspace(0.5, 0, 256) / 7,
        scale_sigma=0.1 / 3,
        support=(1 / 255, 0.1 + 0.2),
        model={"name": "polynomial", "coefficients": [0.0, 1 / 3, 2 / 3]},
    ),
    vignette=VIGNETTES["spline"],
    verdicts={
        "response": Verdict("identifiable", "ln g is known to ±0.01"),
        "vignette": Verdict("marginal", "hardly any motion, 0.05 ½-diagonals", "pan the camera"),
        "exposures": Verdict("marginal", "exposures are recorded 1 frame late"),
    },
    vignette_sigma=PROFILE_RADII**2 / 70,
    noise=NoiseModel(1 / 3e5, 2 / 7e4, (1 / 3e5, 1 / 7e4), (0.25, 0.75)),
    exposure_ratios=ExposureRatios(
        np.array([[0, 3], [1, 4]]), np.array([1 / 3, 1.7]), np.array([0.34, 5 / 3]), np.array([120, 7])
    ),
    covariance={"vignette": {"parameters": ["a1", "a2"], "matrix": [[1e-4, 1e-5], [1e-5, 2e-4 / 3]]}},
    max_grey=4095,
    converged=True,
    partial=True,
    counts={"frames": 12, "skipped": 1, "pairs": 2, "samples": 127},
    settings={"preset": "default", "views": 20, "smoothing_px": 1.5},
    source={"kind": "array", "name": "é", "frames": 12},
    versions={"ospc": "0.1.0"},
    advice=("pan the camera",),
    notes=("exposures were moved by 1 frame", "a second note"),
    warnings=("the vignette changed at about frame 7, by -12%",),
)


def assert_same(a, b):
    assert type(a) is type(b)
    if isinstance(a, np.ndarray):
        np.testing.assert_array_equal(a, b, strict=True)
    elif hasattr(a, "__dataclass_fields__"):
        for f in fields(a):
            assert_same(getattr(a, f.name), getattr(b, f.name))
    else:
        assert a == b


@pytest.fixture
def saved(tmp_path):
    return FULL.save(tmp_path / "calibration.json")


@pytest.mark.parametrize("name", VIGNETTES)
def test_every_field_survives_exactly(name, tmp_path):
    sigma = None if name == "none" else FULL.vignette_sigma
    calibration = replace(FULL, vignette=VIGNETTES[name], vignette_sigma=sigma)
    path = calibration.save(tmp_path / "calibration.json")
    assert path == tmp_path / "calibration.json"
    assert_same(Calibration.load(path), calibration)
    assert_same(Calibration.load(str(tmp_path)), calibration)


@pytest.mark.parametrize(
    "unknown",
    [
        {"response": None},
        {"noise": None},
        {"vignette_sigma": None},
        {"exposure_ratios": ExposureRatios.none(), "covariance": {}, "verdicts": {}, "advice": ()},
        {"notes": (), "warnings": ()},
        {"response": Response.gamma(2.2)},
    ],
    ids=",".join,
)
def test_what_is_unknown_stays_unknown(unknown, tmp_path):
    calibration = replace(FULL, **unknown)
    assert_same(Calibration.load(calibration.save(tmp_path / "c.json")), calibration)


@pytest.mark.parametrize("name", VIGNETTES)
def test_what_is_read_again_is_equal_to_what_was_written(name, tmp_path):
    sigma = None if name == "none" else FULL.vignette_sigma
    coverage = Coverage(np.array([1.0, 2.0]), np.ones((1, 4), int), np.eye(3, dtype=int), np.full((4, 3), -np.nan))
    whole = replace(FULL, vignette=VIGNETTES[name], vignette_sigma=sigma, coverage=coverage)
    again = Calibration.load(whole.save(tmp_path / "c.json"))
    assert again == whole
    assert hash(again) == hash(whole)
    assert len({again, whole, FULL, replace(whole)}) == 2


@pytest.mark.parametrize(
    "other",
    [
        replace(FULL, partial=False),
        replace(FULL, response=Response.gamma(2.2)),
        replace(FULL, response=replace(FULL.response, log_sigma=None)),
        replace(FULL, vignette=VIGNETTES["raster"]),
        replace(FULL, vignette_sigma=np.nextafter(FULL.vignette_sigma, 1)),
        replace(FULL, exposure_ratios=ExposureRatios.none()),
        replace(FULL, counts={**FULL.counts, "pairs": 3}),
        "a calibration",
    ],
)
def test_what_differs_anywhere_is_not_equal(other):
    assert other != FULL
    assert replace(FULL) == FULL


def test_an_empty_calibration_is_one_too(tmp_path):
    empty = Calibration(SIZE)
    assert not empty.complete
    assert not FULL.complete  # its vignette is only marginal
    sure = Verdict("identifiable", "it was seen")
    assert replace(FULL, verdicts=dict.fromkeys(FULL.verdicts, sure), warnings=()).complete
    assert_same(Calibration.load(empty.save(tmp_path / "c.json")), empty)


def test_the_file_contains_tables_for_other_programs(saved):
    content = json.loads(saved.read_text())
    assert content["schema"] == SCHEMA
    assert content["response"]["inverse_table"] == FULL.response.inverse_table.tolist()
    assert content["vignette"]["profile_radius"] == PROFILE_RADII.tolist()
    corners = [(x, y) for x in (0, SIZE[0] - 1) for y in (0, SIZE[1] - 1)]
    centre = FULL.vignette.at((np.array(SIZE) - 1) / 2)
    assert content["vignette"]["profile"][0] == 1
    assert content["vignette"]["profile"][-1] == pytest.approx(FULL.vignette.at(corners).mean() / centre)
    assert content["exposure_ratios"]["bias"] == FULL.exposure_ratios.bias
    assert (content["notes"], content["warnings"]) == (list(FULL.notes), list(FULL.warnings))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_no_number_is_never_written(bad, saved):
    before = saved.read_bytes()
    broken = replace(FULL, noise=NoiseModel(bad, 0.0))
    with pytest.raises(FormatError, match="JSON"):
        broken.save(saved)
    assert saved.read_bytes() == before
    assert "NaN" not in before.decode()
    assert "Infinity" not in before.decode()


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(FormatError, match="nowhere"):
        FULL.save(tmp_path / "nowhere" / "calibration.json")


def test_ratios_without_pairs_have_no_bias():
    assert np.isnan(ExposureRatios.none().bias)
    assert ExposureRatios.none().log_residual.shape == (0,)


@given(st.lists(st.tuples(st.floats(0.1, 10), st.floats(-0.5, 0.5)), min_size=1, max_size=9))
def test_the_bias_does_not_depend_on_which_frame_of_a_pair_comes_first(pairs):
    metadata, error = np.array(pairs).T
    estimated = metadata * np.exp(error)
    frames, samples = np.zeros((len(pairs), 2), np.int64), np.ones(len(pairs), np.int64)
    there = ExposureRatios(frames, metadata, estimated, samples)
    back = ExposureRatios(frames, 1 / metadata, 1 / estimated, samples)
    assert back.bias == pytest.approx(there.bias, abs=1e-9)


@given(st.lists(st.tuples(st.floats(-0.5, 0.5), st.integers(1, 5)), min_size=1, max_size=9))
def test_the_misfit_is_the_median_over_samples(pairs):
    error, samples = (np.array(column) for column in zip(*pairs, strict=True))
    ratios = ExposureRatios(np.zeros((len(pairs), 2), np.int64), np.ones(len(pairs)), np.exp(error), samples)
    every = np.sort(np.repeat(np.abs(error), samples))
    assert ratios.misfit == pytest.approx(every[(len(every) - 1) // 2], abs=1e-12)


# Files that are not valid calibrations.


def test_files_of_others_and_of_the_future_are_refused_by_name(saved):
    for content, complaint in (
        ({}, "schema None"),
        ([1, 2], "schema None"),
        (3.5, "schema None"),
        ({"schema": "ospc-calibration/2"}, "ospc-calibration/2"),
        ({"schema": SCHEMA}, "damaged"),
    ):
        saved.write_text(json.dumps(content))
        with pytest.raises(FormatError, match=complaint) as refusal:
            Calibration.load(saved)
        assert str(saved) in str(refusal.value)


@pytest.mark.parametrize(
    "content", [b"", b"\xff\xfe", b"{", b"[" * 100_000, b"0.1 0.2", b'{"schema": NaN}', b"1e999", b"9" * 10_000]
)
def test_what_is_no_json_is_refused_by_name(content, saved):
    saved.write_bytes(content)
    with pytest.raises(FormatError) as refusal:
        Calibration.load(saved)
    assert str(saved) in str(refusal.value)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(FormatError, match=r"calibration\.json: there is no such"):
        Calibration.load(tmp_path)
    with pytest.raises(FormatError, match="other"):
        Calibration.load(tmp_path / "other")


def test_a_file_without_end_is_not_read(saved):
    with saved.open("r+b") as file:
        file.truncate(10**12)
    with pytest.raises(FormatError, match="larger than"):
        Calibration.load(saved)


DAMAGE = st.sampled_from(
    [
        *(None, 0, -1, -5, 7, 0.5, 200_000, 1e300, -1e300, 1e-300, 10**400, True, "", "x", "<script>"),
        *([], [1], [0.5] * 4, [1e300] * 51, [None, None], ["a", 2], [[1], [2]], {}, {"name": 1}),
    ]
)


def places_in(content, path=()):
    """Yield the path of every value of a JSON document; of lists, only that of the first element."""
    yield path
    if isinstance(content, dict):
        for name, value in content.items():
            yield from places_in(value, (*path, name))
    elif isinstance(content, list) and content:
        yield from places_in(content[0], (*path, 0))


@given(data=st.data(), vignette=st.sampled_from(["polynomial", "spline", "raster"]), remove=st.booleans())
def test_damage_anywhere_is_refused_by_name_or_harmless(data, vignette, remove, tmp_path_factory):
    place = tmp_path_factory.mktemp("damaged") / "calibration.json"
    calibration = replace(FULL, vignette=VIGNETTES[vignette])
    calibration.save(place)
    content = json.loads(place.read_text())
    path = data.draw(st.sampled_from([p for p in places_in(content) if p]))
    holder = content
    for step in path[:-1]:
        holder = holder[step]
    if remove:
        del holder[path[-1]]
    else:
        holder[path[-1]] = data.draw(DAMAGE)
    place.write_text(json.dumps(content))
    try:
        refusal = ""
        loaded = Calibration.load(place)
    except FormatError as error:
        refusal = str(error)
    finally:
        shutil.rmtree(place.parent)
    if refusal:
        assert str(place) in refusal
    else:
        check_usable(loaded)


def test_the_map_of_a_vignette_is_not_listed_with_the_rest():
    width, height = 640, 480
    values = np.linspace(0.5, 1, width * height, dtype=np.float32).reshape(height, width)
    found = Calibration((width, height), vignette=RasterVignette(values))
    tracemalloc.start()
    try:
        content = found.as_dict()
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert sorted(content["vignette"]) == ["model", "profile", "profile_radius", "profile_sigma"]
    assert peak < 20 * width * height  # a number in a list occupies 32 bytes


def check_usable(loaded):
    """Check that every use of a calibration works."""
    image = np.full(loaded.size[::-1], loaded.max_grey // 2, np.uint8 if loaded.max_grey < 256 else np.uint16)
    if max(loaded.size) < 1000:
        corrected = loaded.correct(image, 3.0, assume_missing=True)
        assert corrected.shape == image.shape
    if loaded.response is not None:
        loaded.warp_exposure(image, 1.0, 2.0)
        assert 0 <= loaded.response.support[0] <= loaded.response.support[1] <= 1
    if loaded.noise is not None:
        variance = loaded.noise.variance(np.linspace(0, 1, 9))
        assert np.all((variance >= 0) & (variance <= 2))
    assert loaded.vignette is None or loaded.vignette.size == loaded.size
    assert loaded.vignette_sigma is None or loaded.vignette_sigma.shape == PROFILE_RADII.shape
    assert all(verdict.state in get_args(State) for verdict in loaded.verdicts.values())
    assert np.all(np.isfinite(loaded.exposure_ratios.log_residual))
    assert 1 <= loaded.max_grey <= 65535
    json.dumps(loaded.as_dict(), allow_nan=False)


@pytest.mark.parametrize(
    ("path", "value", "complaint"),
    [
        (["size"], [200_000, 200_000], "image size"),
        (["max_grey"], -5, "max_grey"),
        (["max_grey"], 255.5, "max_grey"),
        (["vignette", "profile_sigma"], [0.1] * 50, "profile_sigma"),
        (["vignette", "profile_sigma", 3], 1e300, "profile_sigma"),
        (["vignette", "model", "coefficients", 0], 1e300, "coefficients"),
        (["vignette", "model", "coefficients", 0], 1e6, "vignette"),
        (["vignette", "model", "non_radial"], [0.1], "non_radial"),
        (["response", "log_sigma"], [0.1] * 255, "log_sigma"),
        (["response", "inverse_table"], np.linspace(0, 1, 65537).tolist(), "grey levels"),
        (["response", "support"], [0.8, 0.2], "support"),
        (["response", "reference_grey"], 0.0, "reference"),
        (["response", "reference_grey"], 1.5, "reference"),
        (["noise", "read_variance"], -1.0, "read_variance"),
        (["noise", "table"], [1e-4, 1e300], "noise table"),
        (["noise", "measured"], [0.0, 1.5], "measured grey levels"),
        (["exposure_ratios", "samples"], [1], "samples"),
        (["exposure_ratios", "estimated", 0], 0.0, "estimated"),
        (["covariance", "vignette", "matrix"], [[1e-4]], "covariance"),
        (["verdicts", "response", "state"], '"><script>', "verdict"),
        (["advice"], [3], "text"),
        (["notes"], "one text instead of a list", "notes"),
        (["warnings"], [None], "text"),
        (["counts", "pairs"], -1, "pairs"),
    ],
)
def test_impossible_values_are_refused_when_the_file_is_loaded(saved, path, value, complaint):
    content = json.loads(saved.read_text())
    *holders, last = path
    holder = content
    for step in holders:
        holder = holder[step]
    holder[last] = value
    saved.write_text(json.dumps(content))
    with pytest.raises(FormatError, match=complaint) as refusal:
        Calibration.load(saved)
    assert str(saved) in str(refusal.value)


def write_zip(place, content):
    with zipfile.ZipFile(place, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("vignette.npy", content)


def npy_header(shape):
    text = f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}".ljust(117).encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


@pytest.mark.parametrize(
    "damage",
    {
        "absent": lambda place: place.unlink(),
        "empty": lambda place: place.write_bytes(b""),
        "no archive": lambda place: place.write_bytes(b"PK\x03\x04 and nothing else"),
        "cut": lambda place: place.write_bytes(place.read_bytes()[:-40]),
        "other magic": lambda place: write_zip(place, b"\x93numpy\x01\x00" + bytes(600)),
        "short": lambda place: write_zip(place, npy_header(SIZE[::-1]) + bytes(9)),
        "corrupt": lambda place: place.write_bytes(place.read_bytes()[:90] + b"\0" * 60 + place.read_bytes()[150:]),
        "other content": lambda place: np.savez(place, other=np.ones(3)),
        "objects": lambda place: np.savez(place, allow_pickle=True, vignette=np.array([{}, []], dtype=object)),
        "other size": lambda place: np.savez(place, vignette=np.ones(SIZE, np.float32)),
        "words": lambda place: np.savez(place, vignette=np.full(SIZE[::-1], "a")),
        "not finite": lambda place: np.savez(place, vignette=np.full(SIZE[::-1], np.nan)),
        "too large": lambda place: write_zip(place, npy_header((3000, 3000)) + bytes(36_000_000)),
        "claims to be large": lambda place: write_zip(place, npy_header((10**6, 10**7))),
    }.items(),
    ids=lambda item: item[0],
)
def test_a_damaged_map_is_refused_by_name(damage, tmp_path):
    path = replace(FULL, vignette=VIGNETTES["raster"]).save(tmp_path / "calibration.json")
    damage[1](tmp_path / "calibration.vignette.npz")
    with pytest.raises(FormatError) as refusal:
        Calibration.load(path)
    assert str(path) in str(refusal.value)


def test_shown_in_a_terminal_or_notebook_it_is_short_and_harmless():
    shown = repr(FULL)
    assert shown == (
        "<Calibration of é, 12×9 pixels, 12 frames, partial, response identifiable, vignette marginal, "
        "exposures marginal>"
    )
    assert repr(Calibration(SIZE)) == "<Calibration of a camera, 12×9 pixels>"
    page = replace(FULL, source={"name": "<script>"})._repr_html_()
    assert "<script" not in page
    assert all(verdict.reason in page for verdict in FULL.verdicts.values())
    assert len(repr(FULL.response)) < 500


@pytest.mark.parametrize("known", [("response", "vignette"), ("response",), ("vignette",), ()])
def test_notebooks_draw_the_curves_that_are_known_inside_their_axes(known):
    parts = {name: getattr(FULL, name) if name in known else None for name in ("response", "vignette")}
    drawn = ElementTree.fromstring(f"<div>{replace(FULL, **parts)._repr_html_()}</div>").findall("svg")
    assert [picture.get("aria-label").split()[0] for picture in drawn] == list(known)
    for picture in drawn:
        right, bottom = float(picture.get("width")), float(picture.get("height"))
        for shape in (*picture.findall("polyline"), *picture.findall("polygon")):
            places = np.array([point.split(",") for point in shape.get("points").split()], float)
            assert np.all((places > 0) & (places < (right, bottom)))


def test_a_polynomial_without_a_centre_has_that_of_the_image(tmp_path):
    vignette = VIGNETTES["polynomial"]
    replace(FULL, vignette=vignette).save(tmp_path / "calibration.json")
    content = json.loads((tmp_path / "calibration.json").read_text())
    del content["vignette"]["model"]["centre"]
    (tmp_path / "calibration.json").write_text(json.dumps(content))
    assert Calibration.load(tmp_path).vignette == vignette
    for damaged in ([0.1], [0.1, "x"], [0.1, 1e300]):
        content["vignette"]["model"]["centre"] = damaged
        (tmp_path / "calibration.json").write_text(json.dumps(content))
        with pytest.raises(FormatError):
            Calibration.load(tmp_path)


def test_maps_of_calibrations_in_one_folder_are_apart_whatever_their_names(tmp_path):
    left, right = (
        Calibration(SIZE, vignette=RasterVignette(np.full(SIZE[::-1], level, np.float32) ** np.eye(*SIZE[::-1])))
        for level in (0.5, 0.9)
    )
    left.save(tmp_path / "robot.left")
    right.save(tmp_path / "robot.right")
    assert Calibration.load(tmp_path / "robot.left").vignette == left.vignette
    assert Calibration.load(tmp_path / "robot.right").vignette == right.vignette


@pytest.mark.parametrize("content", [{}, None, {"size": [12, 9]}])
def test_values_of_no_calibration_are_refused(content):
    with pytest.raises(FormatError):
        Calibration.from_dict(content)


def test_values_do_not_contain_the_map_of_a_vignette():
    with pytest.raises(FormatError, match="load the calibration file"):
        Calibration.from_dict(Calibration(SIZE, vignette=VIGNETTES["raster"]).as_dict())


def test_numbers_of_numpy_are_saved_and_what_json_cannot_hold_is_refused(tmp_path):
    numbers = Calibration(SIZE, max_grey=np.uint16(4095), source={"gain": np.float32(2)})
    assert Calibration.load(numbers.save(tmp_path / "a.json")).source == {"gain": 2.0}
    with pytest.raises(FormatError, match="JSON has no form for it"):
        Calibration(SIZE, source={"driver": object()}).save(tmp_path / "a.json")
    assert Calibration.load(tmp_path / "a.json").max_grey == 4095
