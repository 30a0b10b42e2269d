"""Feature matches between an image and its shifted copy are displaced by the shift."""

from __future__ import annotations

import pickle
import sys

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ospc.correspondence.features import EXTRACTORS, Features, extract, match
from ospc.errors import MissingExtraError, needs_extra
from ospc.methods.paper import FeatureMatcher
from ospc.recording.frame import Frame
from ospc.settings import PaperSettings

SHIFT = np.array([13, -7])


def textured(width=360, height=280):
    random = np.random.default_rng(3)
    octaves = [
        cv2.GaussianBlur(random.standard_normal((height, width)).astype(np.float32), (0, 0), s) * s
        for s in (2, 5, 12)
    ]
    image = sum(octaves)
    return np.clip(128 + 45 * image / image.std(), 2, 253).astype(np.uint8)


WIDE = textured()


def cut(x, y, dtype=np.uint8, factor=1):
    return WIDE[y : y + 240, x : x + 320].astype(dtype) * factor


@pytest.fixture(params=["sift", "orb", "surf"])
def extractor(request):
    if request.param == "surf":
        pytest.importorskip("mahotas", reason="SURF needs the extra 'surf'")
    return EXTRACTORS[request.param](400)


@pytest.mark.parametrize(("dtype", "factor", "max_grey"), [(np.uint8, 1, 255), (np.uint16, 16, 4080)])
def test_a_shifted_copy_is_recognised_as_such(extractor, dtype, factor, max_grey):
    # A feature at x in the first window is at x − 13 in the second, which begins 13 pixels further right.
    frames = [
        Frame.of_array(cut(20, 20, dtype, factor), 2.0, index=4, max_grey=max_grey),
        Frame.of_array(cut(20 + 13, 20 - 7, dtype, factor), 4.0, index=9, max_grey=max_grey),
    ]
    features = [extract(frame, extractor) for frame in frames]
    index0, index1 = match(*features, extractor.norm, 0.75)
    assert len(index0) == len(index1) > 50
    assert len(np.unique(index1)) == len(index1)
    moved = features[1].points[index1] - features[0].points[index0]
    # Points found in a reduced image lie on its pixel grid, and the shift is not a multiple of its step.
    right = np.linalg.norm(moved + SHIFT, axis=1) < 2
    assert right.mean() > 0.95
    np.testing.assert_allclose(np.median(moved, axis=0), -SHIFT, atol=0.05)
    np.testing.assert_allclose(features[0].grey[index0][right], features[1].grey[index1][right], atol=0.15)


def test_features_are_described_by_the_frame_they_are_of(extractor):
    frame = Frame.of_array(cut(0, 0), 2.5, index=7)
    features = extract(frame, extractor)
    n = len(features.points)
    assert features.frame == 7
    assert 50 < n <= 410
    assert features.points.shape == (n, 2)
    assert len(features.descriptors) == n
    assert np.all((features.points >= -0.5) & (features.points <= [319.5, 239.5]))
    column, row = np.rint(features.points).astype(int).T
    np.testing.assert_array_equal(features.grey, frame.image[row, column] / 255)


def test_an_image_without_structure_has_no_features(extractor):
    features = extract(Frame.of_array(np.full((120, 160), 90, np.uint8), 1.0), extractor)
    assert features.points.shape == (0, 2)
    assert features.grey.shape == (0,)
    index0, index1 = match(features, features, extractor.norm, 0.75)
    assert len(index0) == len(index1) == 0


def test_surf_without_its_extra_names_what_to_install(monkeypatch):
    for name in [n for n in sys.modules if n.split(".")[0] == "mahotas"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "mahotas", None)
    with pytest.raises(MissingExtraError, match=r"^SURF needs an optional dependency: pip install 'ospc\[surf\]'$"):
        EXTRACTORS["surf"](100)


def test_the_error_for_a_missing_library_can_be_sent_from_another_process():
    with pytest.raises(MissingExtraError) as caught, needs_extra("SURF", "surf"):
        raise ImportError
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


def features_of(descriptors, norm_dtype):
    n = len(descriptors)
    return Features(0, np.zeros((n, 2)), np.zeros(n), np.asarray(descriptors, dtype=norm_dtype))


@given(st.integers(0, 2**32 - 1), st.integers(2, 25), st.integers(2, 25), st.floats(0.3, 1.0))
def test_matches_are_the_nearest_that_stand_out_and_no_partner_is_shared(seed, n0, n1, ratio):
    random = np.random.default_rng(seed)
    first, second = random.integers(0, 40, (n0, 4)), random.integers(0, 40, (n1, 4))
    distance = np.linalg.norm(first[:, None].astype(float) - second[None], axis=2)
    nearest = distance.argmin(axis=1)
    two = np.sort(distance, axis=1)
    accepted = np.flatnonzero(two[:, 0].astype(np.float32) < ratio * two[:, 1].astype(np.float32))
    index0, index1 = match(features_of(first, np.uint8), features_of(second, np.uint8), cv2.NORM_L2, ratio)
    assert set(index0) <= set(accepted)
    np.testing.assert_array_equal(index1, nearest[index0])
    assert sorted(index1) == sorted(set(nearest[accepted]))
    for i, j in zip(index0, index1, strict=True):
        assert distance[i, j] == min(distance[a, j] for a in accepted if nearest[a] == j)


def test_binary_descriptors_are_compared_by_their_bits():
    # By value, 128 is nearer to 127 than to 0; by bits it is nearer to 0.
    index0, index1 = match(
        features_of([[128], [1]], np.uint8), features_of([[127], [0]], np.uint8), cv2.NORM_HAMMING, 0.75
    )
    assert dict(zip(index0.tolist(), index1.tolist(), strict=True)) == {0: 1}


def test_the_matcher_puts_features_matches_and_filter_together():
    matcher = FeatureMatcher(PaperSettings(max_features=300))
    left = matcher.features(Frame.of_array(cut(20, 20), 2.0, index=4))
    right = matcher.features(Frame.of_array(cut(33, 13), 8.0, index=9))
    found = matcher.correspondences(left, right, (320, 240))
    assert found.frames == (4, 9)
    assert len(found) > 50
    moved = found.points1 - found.points0
    assert np.mean(np.linalg.norm(moved + SHIFT, axis=1) < 1) > 0.97
    centre = np.array([159.5, 119.5])
    expected = np.linalg.norm(found.points0 - centre, axis=1) / np.linalg.norm(centre)
    np.testing.assert_allclose(found.radius0, expected)
    np.testing.assert_allclose(found.radial_displacement, np.abs(found.radius0 - found.radius1))
    some = found.select(found.radius0 < 0.5)
    assert len(some) == np.count_nonzero(found.radius0 < 0.5)
    assert np.all(some.radius0 < 0.5)
