"""The picture of ``ospc compare``."""

import cv2
import numpy as np
import pytest

from calibrations import calibration
from ospc.formats.opening import Photometry
from ospc.photometry.response import Response
from ospc.report.pictures import plot_photometries


def test_a_long_name_leaves_room_for_the_curves(tmp_path):
    def drawn(name):
        return cv2.imread(str(plot_photometries([Photometry(name, Response.gamma(2.2), None)], tmp_path / "a.png")))

    short, long = drawn("a" * 30), drawn("folder/" * 50)
    # The borders of the axes are dark in the same columns of both pictures.
    assert ((short[300] < 128).any(axis=1) == (long[300] < 128).any(axis=1)).mean() > 0.98


@pytest.fixture
def axes_of(monkeypatch, tmp_path):
    def drawn(*photometries):
        figures = []
        with monkeypatch.context() as patch:
            patch.setattr("ospc.report.pictures.save", lambda figure, _path: figures.append(figure))
            plot_photometries(photometries, tmp_path / "plot.png")
        return figures[0].axes

    return drawn


def legend(axes):
    return [text.get_text().strip() for text in axes.get_legend().get_texts()]


def test_responses_of_equal_shape_coincide_with_their_bands_whatever_their_scale(axes_of):
    grey = np.linspace(0, 1, 256)
    brighter = Response.from_values(grey**2 + 3 * np.maximum(grey - 0.8, 0), log_sigma=np.full(256, 0.01))
    one = Response(grey**2, log_sigma=np.full(256, 0.01), support=(0.0, 0.8))
    left, _ = axes_of(Photometry("one", one, None), Photometry("other", brighter, None))
    first, second = (line.get_ydata() for line in left.lines)
    np.testing.assert_allclose(second[grey < 0.8], first[grey < 0.8], rtol=1e-9)
    assert left.get_ylim()[1] > second.max() > 1
    bands = [band.get_paths()[0].vertices for band in left.collections]
    for band, g in zip(bands, (first, second), strict=True):
        assert band[:, 1].max() == pytest.approx(1.02 * g.max())
    assert "equal at grey level 102" in left.get_title()


def test_missing_parts_are_named(axes_of):
    known = calibration()
    left, right = axes_of(Photometry("one", known.response, None), Photometry("two", None, None))
    assert legend(left) == ["one", "two: no response"]
    assert legend(right) == ["one: no vignette", "two: no vignette"]
