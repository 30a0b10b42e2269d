"""The picture of ``ospc compare``."""

import cv2

from ospc.formats.opening import Photometry
from ospc.photometry.response import Response
from ospc.report.pictures import plot_photometries


def test_a_long_name_leaves_room_for_the_curves(tmp_path):
    def drawn(name):
        return cv2.imread(str(plot_photometries([Photometry(name, Response.gamma(2.2), None)], tmp_path / "a.png")))

    short, long = drawn("a" * 30), drawn("folder/" * 50)
    # The borders of the axes are dark in the same columns of both pictures.
    assert ((short[300] < 128).any(axis=1) == (long[300] < 128).any(axis=1)).mean() > 0.98
