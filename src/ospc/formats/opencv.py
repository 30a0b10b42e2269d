"""Responses and vignettes in OpenCV file storage, for its functions that merge exposures.

``cv2.createMergeDebevec().process(images, times, response)`` takes the matrix ``response`` of irradiances: 256 rows
and one column with three 32-bit channels. It takes logarithms, so the first irradiance is that of half a grey level
instead of zero.
"""

from __future__ import annotations

import base64
import math
import re
from pathlib import Path

import cv2
import numpy as np

from ospc.arrays import FloatArray
from ospc.errors import FormatError
from ospc.formats.files import LARGEST_FILE, read_text, write_text
from ospc.photometry.geometry import MOST_PIXELS
from ospc.photometry.response import Response
from ospc.photometry.vignette import RasterVignette, Vignette

_LEVELS = 256
"""Number of grey values of a response: OpenCV only merges 8-bit images."""

_LARGEST_VALUE = 1e30
"""Larger values would overflow the 32-bit floats of a vignette."""

_BASE64_HEADER = 24
"""Number of bytes before the values, which repeat the element type."""

_MATRIX = re.compile(
    r"^(inverse_response|response|vignette): !!opencv-matrix\s+rows: (\d{1,6})\s+cols: (\d{1,6})\s+"
    r"dt: \"?([1-4]?)([fd])\"?\s+data: (\[[^\]]*\]|!!binary \|(?:\r?\n +[A-Za-z0-9+/=]+)+)",
    re.MULTILINE | re.ASCII,
)


def write_opencv(response: Response | None, vignette: Vignette | None, path: str | Path) -> Path:
    """Write a response, a vignette or both to an OpenCV YAML file, atomically, and return its path.

    The matrix ``response`` is for OpenCV functions, ``inverse_response`` is the exact table, and ``vignette`` has the
    attenuation of every pixel as 32-bit floats.

    Raises
    ------
    FormatError
        If the file cannot be written.
    """
    place = Path(path)
    mode = cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | cv2.FILE_STORAGE_WRITE_BASE64
    storage = cv2.FileStorage("memory.yml", mode | cv2.FILE_STORAGE_FORMAT_YAML)
    if response is not None:
        table = response.resampled(_LEVELS)
        positive = np.concatenate([response.inverse(np.array([0.5 / 255])), table[1:]]).astype(np.float32)
        storage.write("response", np.repeat(positive[:, None, None], 3, axis=2))
        storage.write("inverse_response", table[:, None])
    if vignette is not None:
        storage.write("vignette", np.ascontiguousarray(vignette.image()))
    return write_text(place, storage.releaseAndGetString())


def read_opencv(path: str | Path) -> tuple[Response | None, Vignette | None]:
    """Read ``inverse_response`` or ``response``, and ``vignette``, from an OpenCV YAML file.

    Raises
    ------
    FormatError
        If the file has no such matrix, or a response or vignette is invalid.
    """
    matrices = _matrices(path)
    if not matrices:
        raise FormatError(f"{path}: has no matrix 'response', 'inverse_response' or 'vignette'")
    response = None
    if "inverse_response" in matrices:
        response = _table(path, matrices["inverse_response"].ravel())
    elif "response" in matrices:
        response = _table(path, _one_channel(path, matrices["response"]))
    if "vignette" not in matrices:
        return response, None
    picture = matrices["vignette"]
    if picture.shape[2] != 1:
        raise FormatError(f"{path}: its vignette has {picture.shape[2]} channels instead of one")
    return response, RasterVignette(picture[..., 0].astype(np.float32), {"file": Path(path).name})


def _matrices(path: str | Path) -> dict[str, FloatArray]:
    """Return the matrices with known names, shape (rows, cols, channels) each."""
    # The parser of OpenCV is not used because it hangs on some damaged files.
    found: dict[str, FloatArray] = {}
    for name, rows, columns, channels, letter, data in _MATRIX.findall(read_text(path, LARGEST_FILE)):
        shape = (int(rows), int(columns), int(channels or 1))
        count = math.prod(shape)
        try:
            values = _values(data, letter)
        except ValueError:
            raise FormatError(f"{path}: the values of the matrix '{name}' are not numbers") from None
        if not 0 < count <= MOST_PIXELS or values.size != count or not np.all(np.abs(values) < _LARGEST_VALUE):
            raise FormatError(f"{path}: the matrix '{name}' is not {shape[0]}×{shape[1]} finite values")
        found[name] = values.reshape(shape)
    return found


def _values(data: str, letter: str) -> FloatArray:
    if data.startswith("["):
        return np.array([float(word) for word in data.strip("[]").split(",")], dtype=np.float64)
    binary = base64.b64decode("".join(data.split()[2:]), validate=True)[_BASE64_HEADER:]
    with np.errstate(invalid="ignore"):  # NaN is rejected later
        return np.frombuffer(binary, np.dtype("<f4" if letter == "f" else "<f8")).astype(np.float64)


def _one_channel(path: str | Path, response: FloatArray) -> FloatArray:
    channels = response.reshape(response.shape[0], -1)
    if np.any(channels != channels[:, :1]):
        raise FormatError(f"{path}: the response differs between channels; write a file with one of them")
    return channels[:, 0]


def _table(path: str | Path, values: FloatArray) -> Response:
    if values.size < 2 or not np.all(np.diff(values) > 0):
        raise FormatError(f"{path}: its response does not strictly increase; calibrate again")
    return Response.from_values(values, model={"name": "table", "source": Path(path).name})
