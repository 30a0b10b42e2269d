"""OpenCV's file storage: read back exactly, and usable with OpenCV's own functions."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from log_polynomials import log_polynomial
from ospc.errors import FormatError
from ospc.formats.opencv import read_opencv, write_opencv
from ospc.photometry.response import Response

SIZE = (64, 48)
RESPONSE = Response.gamma(2.2)
VIGNETTE = log_polynomial(SIZE, (-0.3, -0.1), (0.1, 0.0), (0.03, -0.02, 0.05, 0.0, 0.0, 0.02, 0.0, 0.02))


def test_round_trip(tmp_path):
    response, vignette = read_opencv(write_opencv(RESPONSE, VIGNETTE, tmp_path / "camera.yml"))
    np.testing.assert_allclose(response.inverse_table, RESPONSE.inverse_table, atol=1e-12)
    np.testing.assert_allclose(vignette.image(), VIGNETTE.image() / VIGNETTE.image().max(), atol=1e-6)
    assert read_opencv(write_opencv(RESPONSE, None, tmp_path / "response.yml"))[1] is None
    assert read_opencv(write_opencv(None, VIGNETTE, tmp_path / "vignette.yml"))[0] is None


def test_opencv_merges_exposures_with_it(tmp_path):
    write_opencv(RESPONSE, None, tmp_path / "camera.yml")
    storage = cv2.FileStorage(str(tmp_path / "camera.yml"), cv2.FILE_STORAGE_READ)
    table = storage.getNode("response").mat()
    storage.release()
    assert table.shape == (256, 1, 3)
    assert table.dtype == np.float32
    irradiance = np.geomspace(0.02, 0.5, 64).reshape(8, 8)
    times = np.array([0.5, 1.0, 2.0], np.float32)
    images = [np.repeat(np.round(255 * RESPONSE(irradiance * t))[..., None], 3, 2).astype(np.uint8) for t in times]
    merged = cv2.createMergeDebevec().process(images, times, table)[..., 0]
    np.testing.assert_allclose(merged / irradiance, 1, atol=0.06)


def test_plain_response_of_opencv_is_read_if_channels_are_equal(tmp_path):
    levels = np.linspace(0.1, 1, 256, dtype=np.float32)
    for name, powers in (("equal.yml", (2, 2, 2)), ("different.yml", (1, 2, 3))):
        storage = cv2.FileStorage(str(tmp_path / name), cv2.FILE_STORAGE_WRITE)
        storage.write("response", np.stack([levels**power for power in powers], axis=-1)[:, None])
        storage.release()
    response, _ = read_opencv(tmp_path / "equal.yml")
    np.testing.assert_allclose(response.inverse_table, (levels**2 - 0.01) / 0.99, atol=1e-6)
    with pytest.raises(FormatError, match="differs between channels"):
        read_opencv(tmp_path / "different.yml")


@pytest.mark.parametrize(
    "text",
    [
        "",
        "%YAML:1.0\n---\nother: 3\n",
        "%YAML:1.0\n---\nresponse: 3\n",
        "%YAML:1.0\n---\nresponse: !!opencv-matrix\n   rows: 90000\n   cols: 90000\n   dt: d\n   data: [ 1., 2. ]\n",
        "no yaml at all",
    ],
)
def test_other_files_are_refused(tmp_path, text):
    place = tmp_path / "camera.yml"
    place.write_text(text)
    with pytest.raises(FormatError, match=r"camera\.yml"):
        read_opencv(place)
