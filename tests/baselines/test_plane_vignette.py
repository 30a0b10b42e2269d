"""The vignette from views of a plane, against known truth."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from ospc.baselines.plane_vignette import PlaneView, marker_view, plane_vignette
from ospc.errors import SettingError
from ospc.evaluation.metrics import vignette_rmse
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette

SIZE = (120, 90)
TRUTH = PolynomialVignette(SIZE, (-0.35, 0.05, -0.15))


def views(count: int, response: Response) -> list[PlaneView]:
    """Images of a smoothly textured square, seen from many sides, that fills most of each."""
    random = np.random.default_rng(4)
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    found = []
    for number in range(count):
        corners = np.array([[-40, -40], [160, -40], [160, 130], [-40, 130]]) + random.uniform(-35, 35, (4, 2))
        homography = cv2.getPerspectiveTransform(
            np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32), corners.astype(np.float32)
        )
        plane = cv2.perspectiveTransform(np.dstack([x, y]).astype(np.float64), np.linalg.inv(homography))
        texture = 0.35 + 0.15 * np.sin(9 * plane[..., 0]) * np.cos(7 * plane[..., 1]) + 0.1 * plane[..., 0]
        exposure = float(np.exp(0.2 * np.sin(number)))
        light = np.clip(exposure * texture * TRUTH.image(), 0, 1)
        grey = 255 * response(light) + 0.3 * random.normal(size=light.shape)
        found.append(PlaneView(np.clip(np.rint(grey), 0, 255).astype(np.uint8), exposure, homography))
    return found


@pytest.mark.parametrize("response", [Response.gamma(1.0), Response.gamma(2.2)])
def test_the_vignette_is_found(response):
    found = plane_vignette(views(25, response), response, cells=120, iterations=12)
    assert vignette_rmse(found, TRUTH) < 0.02
    assert vignette_rmse(PolynomialVignette(SIZE, (0.0, 0.0, 0.0)), TRUTH) > 0.1


def test_too_few_or_unequal_views_are_refused():
    some = views(3, Response.gamma(1.0))
    with pytest.raises(SettingError, match="there are 2"):
        plane_vignette(some[:2], Response.gamma(1.0))
    odd = PlaneView(some[0].image[:-1], 1.0, some[0].homography)
    with pytest.raises(SettingError):
        plane_vignette([*some, odd], Response.gamma(1.0))


def test_a_printed_marker_tells_where_the_plane_is():
    marker = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), 7, 120)
    page = np.full((400, 500), 230, np.uint8)
    page[100:220, 150:270] = marker
    view = marker_view(page, 2.0, margin=1.0)
    assert view is not None
    corners = np.array([[1, 1], [2, 1], [2, 2], [1, 2]]) / 3
    seen = cv2.perspectiveTransform(corners[None].astype(np.float64), view.homography)[0]
    np.testing.assert_allclose(seen, [[150, 100], [269, 100], [269, 219], [150, 219]], atol=1.5)
    assert marker_view(np.full((100, 100), 200, np.uint8), 1.0) is None
