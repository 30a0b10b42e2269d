"""Responses and vignettes as OpenCV's file storage, for its functions that merge exposures.

``cv2.createMergeDebevec().process(images, times, response)`` takes the matrix ``response``: 256 rows, one column of
three 32-bit channels, an irradiance each. It takes logarithms, so the first is that of half a grey level, not zero.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from ospc.errors import FormatError
from ospc.formats.files import read_text, write_text
from ospc.formats.png import MOST_PIXELS
from ospc.photometry.response import Response
from ospc.photometry.vignette import RasterVignette, Vignette

_LEVELS = 256
_LARGEST_FILE = 2**30
_MODES = {".yml": cv2.FILE_STORAGE_FORMAT_YAML, ".yaml": cv2.FILE_STORAGE_FORMAT_YAML}


def write_opencv(path: str | Path, response: Response | None = None, vignette: Vignette | None = None) -> Path:
    """Write what is given into a YAML file of OpenCV, atomically, and return its path.

    ``response`` is for OpenCV's functions, ``inverse_response`` the exact table, ``vignette`` the attenuation of
    every pixel as 32-bit floats.

    Raises
    ------
    FormatError
        If the suffix is not .yml or .yaml, or the file cannot be written.
    """
    place = Path(path)
    if place.suffix.lower() not in _MODES:
        raise FormatError(f"{place}: OpenCV's files are written as .yml or .yaml; choose such a name")
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


def read_opencv(path: str | Path, channel: int | None = None) -> tuple[Response | None, Vignette | None]:
    """Read ``inverse_response`` or ``response``, and ``vignette``, from a YAML file of OpenCV.

    Parameters
    ----------
    path
        The file.
    channel
        Which channel of ``response`` to take if they differ: 0, 1 or 2 for blue, green, red.

    Raises
    ------
    FormatError
        If it holds neither, or they are no response and no vignette.
    """
    response, curve, picture = _nodes(path)
    if response is None and curve is None and picture is None:
        raise FormatError(f"{path}: holds no matrix 'response', 'inverse_response' or 'vignette'")
    found: Response | None = None
    if curve is not None:
        found = Response.from_values(np.asarray(curve, dtype=np.float64).ravel(), model=_model(path))
    elif response is not None:
        found = Response.from_values(_one_channel(path, response, channel), model=_model(path))
    vignette = None if picture is None else RasterVignette(picture, {"file": Path(path).name})
    return found, vignette


def _nodes(path: str | Path) -> tuple[np.ndarray | None, np.ndarray | None, np.ndarray | None]:
    text = read_text(path, _LARGEST_FILE)
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        nodes = [storage.getNode(name) for name in ("response", "inverse_response", "vignette")]
        matrices = [None if node.empty() else node.mat() for node in nodes]
    except (cv2.error, SystemError, ValueError):
        raise FormatError(f"{path}: not readable as a file of OpenCV") from None
    for matrix in matrices:
        if matrix is not None and (matrix.size == 0 or matrix.size > MOST_PIXELS):
            raise FormatError(f"{path}: a matrix in it is empty or too large")
    return matrices[0], matrices[1], matrices[2]


def _one_channel(path: str | Path, response: np.ndarray, channel: int | None) -> np.ndarray:
    channels = np.asarray(response, dtype=np.float64).reshape(response.shape[0], -1)
    if channel is not None and not 0 <= channel < channels.shape[1]:
        raise FormatError(f"{path}: has {channels.shape[1]} channels, and none with number {channel}")
    if channel is None and np.any(channels != channels[:, :1]):
        raise FormatError(f"{path}: the response differs between the channels; choose one of them")
    return channels[:, channel or 0]


def _model(path: str | Path) -> dict[str, str]:
    return {"name": "table", "source": Path(path).name}
