"""Every fault changes a recording as described, and changes nothing else."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from ospc.research.faults.footage import STRENGTHS, Fault, Footage
from ospc.research.faults.judging import FAULTS, KINDS

IMAGES_ONLY = [f.name for kind in ("light, optics and scene", "grey values") for f in KINDS[kind]]
SCENE = ("constant-exposure", "small-range", "nominal-exposures", "inexact-steps")
"""Scene faults that change the exposures and the metadata consistently."""

COUNTS = (
    "lost-images", "lost-block", "dropped", "time-lapse", "short", "missing-files",
)  # fmt: skip
"""Faults that remove images."""


def put(name: str, footage: Footage, strength: float) -> Footage:
    return FAULTS[name].put_on(footage, strength)


def stack(footage: Footage) -> np.ndarray:
    return np.stack(footage.images).astype(float)


def same_images(first: Footage, second: Footage) -> bool:
    pairs = zip(first.images, second.images, strict=False)
    return len(first) == len(second) and all(np.array_equal(a, b) for a, b in pairs)


def test_there_are_sixty_kinds_and_more_with_three_strengths_each():
    assert len(FAULTS) == sum(len(faults) for faults in KINDS.values()) >= 60
    for fault in FAULTS.values():
        assert len(set(fault.strengths)) == len(STRENGTHS)
        assert "{}" in fault.text
        assert "{}" not in fault.in_words(fault.strengths[0])


@pytest.mark.parametrize("fault", FAULTS.values(), ids=str)
def test_every_strength_changes_the_recording_and_is_repeatable(fault: Fault, footage):
    before = stack(footage), footage.exposures_ms.copy(), footage.stamps_s.copy()
    for strength in fault.strengths:
        found, again = (fault.put_on(footage, strength) for _ in range(2))
        assert len(found) == len(found.exposures_ms) == len(found.stamps_s) == len(found.names)
        assert all(image.dtype == np.uint8 and image.ndim == 2 for image in found.images)
        assert same_images(found, again)
        assert np.array_equal(found.exposures_ms, again.exposures_ms, equal_nan=True)
        assert not (
            same_images(found, footage)
            and np.array_equal(found.exposures_ms, footage.exposures_ms)
            and np.array_equal(found.stamps_s, footage.stamps_s)
            and not found.times
        )
    after = stack(footage), footage.exposures_ms, footage.stamps_s
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))


@pytest.mark.parametrize("name", IMAGES_ONLY)
def test_faults_of_images_leave_the_metadata_alone(name, footage):
    found = put(name, footage, FAULTS[name].strengths[1])
    assert not same_images(found, footage) or name == "constant-exposure"
    assert found.names == footage.names
    assert (name in SCENE) != np.array_equal(found.exposures_ms, footage.exposures_ms)


@pytest.mark.parametrize("name", [fault.name for fault in KINDS["exposures"]])
def test_faults_of_exposures_leave_the_images_alone(name, footage):
    found = put(name, footage, FAULTS[name].strengths[1])
    assert same_images(found, footage)
    assert not np.array_equal(found.exposures_ms, footage.exposures_ms)


@pytest.mark.parametrize("name", IMAGES_ONLY)
def test_a_stronger_fault_changes_more(name, footage):
    if name in ("constant-exposure", "two-gammas"):
        pytest.skip("its strengths are not ordered")
    changes = [np.abs(stack(put(name, footage, s)) - stack(footage)).mean() for s in FAULTS[name].strengths]
    assert all(weak <= strong * 1.02 for weak, strong in pairwise(changes))


def test_an_image_exposed_again_is_the_same(footage):
    again = footage.relit(lambda light, _i: light)
    assert same_images(again, footage)


@pytest.mark.parametrize(
    ("name", "strength", "grey", "expected"),
    [
        ("limited-range", 16, (0, 128, 255), (16, 126, 235)),
        ("expanded-twice", 16, (16, 126, 235), (0, 128, 255)),
        ("pedestal", 10, (0, 100, 250), (10, 110, 255)),
        ("white-clipped", 200, (100, 210), (100, 200)),
    ],
)
def test_curves_of_grey_levels(name, strength, grey, expected, footage):
    ramp = footage.with_images([np.arange(256, dtype=np.uint8).reshape(16, 16)])
    assert put(name, ramp, strength).images[0].ravel()[list(grey)].tolist() == list(expected)


def test_a_curve_on_all_grey_levels_is_another_true_response(footage):
    camera, stored = put("limited-range", footage, 16).responses
    greys = np.array([40.0, 80.0, 200.0])
    assert stored.inverse((16 + greys * 219 / 255) / 255) == pytest.approx(camera.inverse(greys / 255), abs=2e-3)
    camera, stored = put("pedestal", footage, 10).responses
    ratios = stored.inverse((greys + 10) / 255) / camera.inverse(greys / 255)
    assert ratios == pytest.approx(ratios[0], rel=2e-3)


def test_faults_of_a_half_leave_the_first_alone(footage):
    for name in ("gamma-midway", "vignette-midway", "zoom", "resized", "lag-midway"):
        found = put(name, footage, FAULTS[name].strengths[2])
        assert all(np.array_equal(a, b) for a, b in zip(found.images[:30], footage.images[:30], strict=True))
        assert np.array_equal(found.exposures_ms[:30], footage.exposures_ms[:30])


def light_with(name, footage, strength):
    """Return the light on the sensor in each frame with a fault."""
    seen = []
    camera = footage.camera
    recorder = Footage(
        **vars(footage) | {"camera": type(camera)(**vars(camera) | {"expose": lambda light, _i: seen.append(light)})}
    )
    put(name, recorder, strength)
    return seen


def test_glare_is_a_share_of_the_mean_irradiance(footage):
    for light, before in zip(light_with("glare", footage, 0.05), footage.camera.irradiance, strict=True):
        assert light - before == pytest.approx(0.05 * before.mean(), abs=1e-5)


def test_a_leaf_shutter_brightens_the_corners_in_long_exposures(footage):
    shown = light_with("leaf-shutter", footage, 0.1)
    exposures_ms = footage.camera.exposures_ms
    for light, before, exposure_ms in zip(shown, footage.camera.irradiance, exposures_ms, strict=True):
        rise = np.log(light[[0, -1], [-1, 0]] / before[[0, -1], [-1, 0]])
        assert rise == pytest.approx(0.1 * np.log(exposure_ms / np.median(exposures_ms)), abs=1e-3)


def test_constant_shading_belongs_to_the_true_vignette(footage):
    for name in ("smudge", "graduated-filter", "decentred", "shading-corrected"):
        found = put(name, footage, FAULTS[name].strengths[2])
        change = found.vignette.image() / footage.camera.attenuation
        assert np.ptp(change) > 0.05
        unclipped = (stack(footage) < 240) & (stack(footage) > 20) & (stack(found) < 240) & (stack(found) > 20)
        light = [footage.responses[0].inverse(stack(f) / 255) for f in (found, footage)]
        seen = np.median(np.divide(*light, out=np.full_like(light[0], np.nan), where=unclipped)[0], axis=0)
        known = np.isfinite(seen)
        ratio = seen[known] / np.broadcast_to(change[0], seen.shape)[known]
        assert np.std(ratio) < 0.3 * np.mean(ratio)


def test_the_vignette_of_stabilised_images_is_that_of_what_they_show(footage):
    even = footage.with_images([np.rint(250 * footage.vignette.image()).astype(np.uint8)] * len(footage))
    found = put("stabilised", even, 3)
    seen = stack(found).mean(axis=0) / 250
    error = np.abs(seen - found.vignette.image())
    assert error.max() < 0.02
    assert error.mean() < 0.2 * np.abs(seen - footage.vignette.image()).mean()


def test_a_camera_at_rest_sees_one_view(footage):
    found = put("standing-still", footage, 1)
    light = [
        found.responses[0].inverse(image / 255) / e for image, e in zip(found.images, found.exposures_ms, strict=True)
    ]
    assert light[0].mean() == pytest.approx(light[40].mean(), rel=0.1)


def test_exposures_within_a_factor(footage):
    found = put("small-range", footage, 1.2)
    assert found.exposures_ms.max() / found.exposures_ms.min() == pytest.approx(1.2)
    assert np.ptp(put("constant-exposure", footage, 1).exposures_ms) == 0


@pytest.mark.parametrize(
    ("name", "strength", "formula"),
    [
        ("offset", 2, lambda e: e + 2),
        ("offset-down", 0.5, lambda e: e - 0.5 * e.min()),
        ("logarithm", 5, lambda e: np.log2(e) + 5),
        ("power", 0.8, lambda e: e**0.8),
        ("power-up", 1.25, lambda e: e**1.25),
        ("reciprocal", 1, lambda e: 1000 / e),
        ("ceiling", 0.85, lambda e: np.minimum(e, np.quantile(e, 0.85))),
        ("floor", 0.15, lambda e: np.maximum(e, np.quantile(e, 0.15))),
        ("dual-gain", 2, lambda e: np.where(e > np.median(e), e / 2, e)),
        ("gain-when-dark", 4, lambda e: np.where(e > np.quantile(e, 0.8), e / 4, e)),
        ("drift", 1.5, lambda e: e * 1.5 ** np.linspace(0, 1, len(e))),
        ("stale", 3, lambda e: np.repeat(e[::3], 3)),
        ("late", 2, lambda e: np.concatenate([e[[0, 0]], e[:-2]])),
        ("early", 1, lambda e: np.append(e[1:], e[-1])),
        ("another-unit", 1000, lambda e: 1000 * e),
        ("constant-written", 1, lambda e: np.full_like(e, np.median(e))),
    ],
)
def test_exposures_by_formula(name, strength, formula, footage):
    assert put(name, footage, strength).exposures_ms == pytest.approx(formula(footage.exposures_ms))


@pytest.mark.parametrize(
    ("name", "ratio"),
    [("tenfold", 10), ("mixed-units", 1000), ("zero", 0), ("negative", -1), ("not-a-number", np.nan)],
)
def test_wrong_lines_are_a_share_of_all(name, ratio, footage):
    found = put(name, footage, 0.2).exposures_ms / footage.exposures_ms
    wrong = ~np.isclose(found, 1)
    assert wrong.sum() == 12
    assert np.allclose(found[wrong], ratio, equal_nan=True)


def test_rounded_exposures(footage):
    assert np.log2(put("stops", footage, 0.5).exposures_ms) * 2 == pytest.approx(
        np.rint(np.log2(footage.exposures_ms) * 2)
    )
    assert put("rounded", footage, 5).exposures_ms % 5 == pytest.approx(0)


def test_a_hidden_gain_is_of_blocks(footage):
    gain = footage.exposures_ms / put("hidden-gain", footage, 0.05).exposures_ms
    assert np.abs(gain - 1) == pytest.approx(0.05)
    assert np.ptp(gain.reshape(6, 10), axis=1) == pytest.approx(0)
    assert np.ptp(gain) == pytest.approx(0.1)


def test_the_vignette_is_judged_where_the_scene_is_seen(footage):
    assert put("disc", footage, 1).max_radius == pytest.approx(24 / np.hypot(31.5, 23.5), abs=0.02)
    assert 0.9 < put("letterbox", footage, 0.15).max_radius < 1
    assert put("overlay", footage, 0.05).max_radius == 1


def test_mixed_up_exposures_are_the_same_values(footage):
    for name in ("swapped", "shuffled"):
        found = put(name, footage, 0.2).exposures_ms
        assert sorted(found) == sorted(footage.exposures_ms)


@pytest.mark.parametrize("name", COUNTS)
def test_lost_images(name, footage):
    found = put(name, footage, FAULTS[name].strengths[1])
    assert len(found) < len(footage)
    kept = {image.tobytes() for image in footage.images}
    assert all(image.tobytes() in kept for image in found.images)


def test_numbering_goes_on_after_lost_images(footage):
    found = put("lost-block", footage, 10)
    assert len(found) == 50
    assert np.array_equal(found.exposures_ms, footage.exposures_ms[:50])
    assert found.names == footage.names[:50]
    assert np.array_equal(found.images[-1], footage.images[-1])


def test_dropped_frames_keep_their_exposures(footage):
    found = put("time-lapse", footage, 4)
    assert np.array_equal(found.exposures_ms, footage.exposures_ms[::4])
    assert same_images(found, footage.with_images(footage.images[::4]))


def test_repeated_images_with_and_without_their_exposures(footage):
    late, own = put("stutter", footage, 0.1), put("repeated", footage, 0.2)
    assert sum(np.array_equal(*pair) for pair in pairwise(late.images)) == 6
    assert np.array_equal(late.exposures_ms, footage.exposures_ms)
    assert sum(a == b for a, b in pairwise(own.exposures_ms)) >= 12


def test_lines_of_a_file(footage):
    assert len(put("missing-lines", footage, 0.1).times) == 54
    assert len(put("missing-files", footage, 0.1).images) == 54
    assert all("," in line and "." not in line for line in put("decimal-commas", footage, 1).times[1:])
    ids = [line.split()[0] for line in put("duplicate-ids", footage, 0.1).times]
    assert sum(a != b for a, b in zip(ids, footage.names, strict=True)) == 6
    assert len(set(ids)) < len(ids)
    assert sum(len(line.split()) == 2 for line in put("cut-lines", footage, 0.1).times) == 6
    good, swapped = (
        put("cut-lines", footage, 0.01).times[2].split(),
        put("swapped-columns", footage, 1).times[2].split(),
    )
    assert swapped == [good[0], good[2], good[1]]
