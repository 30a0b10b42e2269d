"""Parsers of all files other than recordings: calibrations, states, files of other programs, tables."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch
from zipfile import ZIP_DEFLATED, ZipFile
from zlib import crc32

import numpy as np
from image_samples import encoded

from ospc.batch.manifest import read_manifest
from ospc.batch.store import VERSION as RESULT_VERSION
from ospc.batch.store import Result, Store
from ospc.calibrator import OnlineCalibrator
from ospc.errors import FormatError, OspcError
from ospc.evaluation.trajectory import read_trajectory
from ospc.formats.dso import write_pcalib, write_vignette
from ospc.formats.hugin import write_pto
from ospc.formats.lens_profiles import write_lcp, write_lensfun
from ospc.formats.opencv import write_opencv
from ospc.formats.opening import open_photometry
from ospc.formats.radial import Optics
from ospc.formats.validation import repair, validate
from ospc.photometry.calibration import Calibration
from ospc.photometry.vignette import PolynomialVignette, RasterVignette
from ospc.pooling.pool import Pool, merge
from ospc.pooling.prior_calibration import PriorCalibration
from ospc.recording.derived import read_mask
from ospc.recording.table_text import exposures_in
from ospc.recording.writing.conversion import camera_text
from ospc.settings import DefaultSettings
from ospc.simulation import SimulationSettings, frames
from ospc.state import container
from ospc.state.container import Container
from ospc.state.run import KIND, VERSION

SIZE = (96, 72)
RESULT_KEY = "ab12"

QUICK = replace(DefaultSettings(), points_per_pair=40, max_points=400, rounds=2, keyframes=3)
WORDS = [
    b"nan",
    b"1e300",
    b"-5",
    b"0",
    b"null",
    b"[]",
    b"{}",
    b"true",
    b'"',
    b"200000",
    b"9" * 400,
    b"\xff",
    b"\\u0000",
]
OPTICS = Optics(focal_mm=8.0, focal_px=400.0, crop_factor=5.0, aperture=2.8)

Parse = Callable[[bytes, Path], Any]

fitted_to = 1
"""Fit only one in this many accepted states, because fitting takes ten times as long as loading."""


def _in(name: str, parse: Callable[[Path], Any]) -> Parse:
    """Return a parser that writes the data to a file of this name and reads it."""

    def written(data: bytes, folder: Path) -> None:
        place = folder / name
        place.write_bytes(data)
        parse(place)

    return written


def _photometry(place: Path) -> None:
    """Open a calibration and use it as commands do."""
    found = open_photometry(place, SIZE)
    if found.response is not None:
        assert np.all(np.isfinite(found.response.inverse([0.0, 0.3, 1.0])))
    if found.vignette is not None and found.vignette.size[0] * found.vignette.size[1] <= 10**6:
        assert np.all(np.isfinite(found.vignette.image()))
    calibration = found.calibration
    if calibration is not None:
        json.dumps(calibration.as_dict(), allow_nan=False)
        with suppress(OspcError):
            calibration.correct(np.zeros((SIZE[1], SIZE[0]), np.uint8))


def _prior(place: Path) -> None:
    found = PriorCalibration.open(place)
    found.check_size(SIZE)


def _state_of(arrays: dict[str, Any]) -> Parse:
    """Return the parser of the JSON part of a state."""

    def parse(data: bytes, folder: Path) -> None:
        state = Container(KIND, VERSION, _stored(data), arrays)
        _go_on(state, folder, fitted=crc32(data) % fitted_to == 0)

    return parse


def _stored(data: bytes) -> dict[str, Any]:
    """Return the JSON object of a container; refuse what no container can hold."""
    with suppress(ValueError, RecursionError):
        content = json.loads(data)
        json.dumps(content, allow_nan=False)
        if isinstance(content, dict):
            return content
    raise FormatError("no JSON object that a container can hold")


def _arrays_of(content: dict[str, Any], shapes: dict[str, Any]) -> Parse:
    """Return the parser of the arrays of a state; the data may end within any of them."""

    def parse(data: bytes, folder: Path) -> None:
        arrays, begin = {}, 0
        for name, array in shapes.items():
            count = min(array.size, (len(data) - begin) // array.itemsize)
            if array.dtype.kind == "b":
                arrays[name] = np.frombuffer(data, np.uint8, count, begin) % 2 == 1
            else:
                arrays[name] = np.frombuffer(data, array.dtype, count, begin)
            if count == array.size:
                arrays[name] = arrays[name].reshape(array.shape)
            begin += count * array.itemsize
        _go_on(Container(KIND, VERSION, content, arrays), folder, fitted=crc32(data) % fitted_to == 0)

    return parse


def _go_on(state: Container, folder: Path, *, fitted: bool) -> None:
    """Load and use a state without writing and reading its file, which is slow and tested elsewhere."""

    def load(*_: Any) -> Container:
        return replace(state, arrays={name: array.copy() for name, array in state.arrays.items()})

    with patch.multiple(container, load=load, kind_of=lambda _: KIND):
        with suppress(OspcError):
            pool = Pool.load(folder / "state.ospc")
            if fitted:
                merge(pool)
        calibrator = OnlineCalibrator.load_state(folder / "state.ospc")
        if fitted:
            with suppress(OspcError):
                calibrator.calibration()


def _loaded(place: Path) -> None:
    OnlineCalibrator.load_state(place)


def _validated(place: Path) -> None:
    result = validate([place], "dso", SIZE)
    with suppress(OspcError):
        repair(result.files[0], "dso", SIZE)


def _camera(place: Path) -> None:
    camera_text(SimpleNamespace(path=place.parent, size=SIZE))


def _batch_result(data: bytes, folder: Path) -> None:
    """Parse the JSON part of a batch result, sealed with a valid checksum."""
    packed = io.BytesIO()
    with ZipFile(packed, "w", ZIP_DEFLATED, compresslevel=0) as archive:
        archive.writestr("batch-result.json", b'{"version": %d, "content": %b}' % (RESULT_VERSION, data))
        archive.comment = bytes(64)
    checked = packed.getvalue()[:-64]
    store = Store(folder / "store")
    store.put(RESULT_KEY, checked + sha256(checked).hexdigest().encode())
    store.get(RESULT_KEY)


def _thinned(calibrator: OnlineCalibrator) -> OnlineCalibrator:
    """Return the calibrator with fewer samples: a small state is faster to load and to damage."""
    series = calibrator._method._data.stationary.series
    series._places, series._grey = series._places[::40], [grey[::40] for grey in series._grey]
    return calibrator


def file_targets(folder: Path) -> dict[str, tuple[Parse, list[bytes], list[bytes]]]:
    """Return parser, samples and words of each target; samples are created in the folder, which must be empty."""
    calibrator = OnlineCalibrator(QUICK)
    for frame in frames(SimulationSettings(size=SIZE, frames=10, exposure="sweep")):
        calibrator.push(frame)
    calibration = calibrator.calibration()
    assert calibration.response is not None
    state = container.load(_thinned(calibrator).save_state(folder / "a.ospc", complete=True), KIND, VERSION)
    vignette = PolynomialVignette(SIZE, (-0.2, 0.05, 0.0))
    raster = RasterVignette(vignette.image())
    calibration.save(folder / "calibration.json")
    Calibration(SIZE, calibration.response, raster).save(folder / "raster.json")
    write_pcalib(calibration.response, folder / "pcalib.txt")
    write_vignette(vignette, folder / "vignette.png")
    write_pto(vignette, folder / "a.pto")
    write_lcp(vignette, folder / "a.lcp", OPTICS)
    write_lensfun(vignette, folder / "a.xml", OPTICS)
    write_opencv(calibration.response, raster, folder / "a.yml")
    (folder / "state.ospc").write_bytes((folder / "a.ospc").read_bytes())
    result = {"key": RESULT_KEY, "calibration": calibration.as_dict(), "summary": None, "notes": []}
    assert Result.__dataclass_fields__.keys() == result.keys()

    def saved(*names: str) -> list[bytes]:
        return [(folder / name).read_bytes() for name in names]

    def packed(content: Any) -> bytes:
        return json.dumps(content).encode()

    small = {name: array for name, array in state.arrays.items() if array.size}
    return {
        "calibration.json": (_in("calibration.json", _photometry), saved("calibration.json"), WORDS),
        "calibration.json to start from": (_in("calibration.json", _prior), saved("calibration.json"), WORDS),
        "vignette map": (_map_parser(folder), saved("raster.vignette.npz"), WORDS),
        "state.ospc": (_in("state.ospc", _loaded), saved("state.ospc"), WORDS),
        "values of a state": (_state_of(dict(state.arrays)), [packed(state.content)], WORDS),
        "arrays of a state": (
            _arrays_of(state.content, small),
            [b"".join(np.ascontiguousarray(array).tobytes() for array in small.values())],
            [np.float64(value).tobytes() for value in (np.nan, np.inf, -1.0, 1e300)],
        ),
        "result of a batch": (_batch_result, [packed(result)], WORDS),
        "pcalib.txt": (_in("pcalib.txt", _photometry), saved("pcalib.txt"), WORDS),
        "vignette.png": (_in("vignette.png", _photometry), saved("vignette.png"), WORDS),
        "hugin .pto": (_in("a.pto", _photometry), saved("a.pto"), WORDS),
        "Adobe .lcp": (_in("a.lcp", _photometry), saved("a.lcp"), WORDS),
        "lensfun .xml": (_in("a.xml", _photometry), saved("a.xml"), WORDS),
        "OpenCV .yml": (_in("a.yml", _photometry), saved("a.yml"), WORDS),
        "table of a batch": (
            _in("batch.csv", lambda place: read_manifest(str(place))),
            [b"recording,camera,options\na,left,rounds=4\nb,=1+1,kind=euroc\n"],
            WORDS,
        ),
        "trajectory": (
            _in("trajectory.txt", read_trajectory),
            [b"# t x y z qx qy qz qw\n1.0 0 0 0 0 0 0 1\n2.0,1,0,0,0,0,0,1\n"],
            WORDS,
        ),
        "exposures of a program": (
            _in("exposures.txt", exposures_in),
            [b"# e\n0 1.5\n1,2.5\n"],
            WORDS,
        ),
        "validate pcalib.txt": (_in("pcalib.txt", _validated), saved("pcalib.txt"), WORDS),
        "validate vignette.png": (_in("vignette.png", _validated), saved("vignette.png"), WORDS),
        "validate times.txt": (_in("times.txt", _validated), [b"00000 1.5 3.0\n00001 1.6 4.0\n"], WORDS),
        "validate camera.txt": (
            _in("camera.txt", _validated),
            [b"Pinhole 100 100 48 36 0\n96 72\ncrop\n96 72\n", b"0.5 0.7 0.5 0.5 0.9\n96 72\nfull\n96 72\n"],
            WORDS,
        ),
        "camera.txt": (_in("camera.txt", _camera), [b"Pinhole 100 100 48 36 0\n96 72\ncrop\n96 72\n"], WORDS),
        "mask": (
            _in("mask.png", lambda place: read_mask(place, SIZE)),
            [encoded(np.full((SIZE[1], SIZE[0]), 255, np.uint8))],
            WORDS,
        ),
    }


def _map_parser(folder: Path) -> Parse:
    """Return the parser of the vignette map that belongs to a calibration file."""
    calibration = (folder / "raster.json").read_bytes()

    def parse(data: bytes, place: Path) -> None:
        (place / "raster.json").write_bytes(calibration)
        (place / "raster.vignette.npz").write_bytes(data)
        _photometry(place / "raster.json")

    return parse
