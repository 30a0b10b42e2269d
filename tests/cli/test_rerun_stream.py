"""Streaming a run to the Rerun viewer, read back from the file."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from command_line import leave_out, ospc
from ospc.calibrator import OnlineCalibrator
from ospc.cli.rerun_stream import RerunStream
from ospc.errors import FormatError, MissingExtraError
from ospc.recording import open_recording
from ospc.simulation import SimulationSettings, simulate
from ospc.system.throttle import Throttle

FRAMES = 24


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    place = tmp_path_factory.mktemp("simulated") / "r"
    exposures = {"exposure": "sweep", "exposure_min_ms": 3, "exposure_max_ms": 12}
    simulate(place, SimulationSettings(size=(160, 120), frames=FRAMES, bit_depth=12, **exposures))
    return open_recording(place)


def read_back(place):
    """Return the values of every entity by frame, without static ones."""
    chunks = pytest.importorskip("rerun.chunk").RrdReader(str(place)).stream().to_chunks()
    found = {}
    for chunk in chunks:
        if not chunk.is_static:
            batch = chunk.to_record_batch()
            frames = batch.column("frame").to_pylist()
            for name in (column for column in batch.schema.names if ":" in column):
                values = zip(frames, batch.column(name).to_pylist(), strict=True)
                found.setdefault((chunk.entity_path, name), {}).update(values)
    return found


def test_the_file_contains_images_matches_curves_and_exposures(recording, tmp_path, monkeypatch):
    pytest.importorskip("rerun")
    monkeypatch.setattr(Throttle, "due", True)
    place, calibrator = tmp_path / "new" / "run.rrd", OnlineCalibrator()
    with RerunStream.opened(recording, place, spawn=False) as tell:
        for frame in recording:
            if calibrator.push(frame):
                tell(calibrator, frame)
    found = read_back(place)
    entities = {path for path, _ in found}
    assert entities >= {
        "/recorded/image",
        "/recorded/matches",
        "/corrected/image",
        "/response",
        "/vignette",
        "/coverage",
        "/exposure/stated",
        "/exposure/from_images",
        "/spread/response",
        "/spread/vignette",
    }
    stated = found["/exposure/stated", "Scalars:scalars"]
    assert sorted(stated) == list(range(FRAMES))
    np.testing.assert_allclose([stated[n][0] for n in range(FRAMES)], np.log2(recording.exposures_ms), rtol=1e-6)
    shown = found["/exposure/from_images", "Scalars:scalars"]
    errors = [abs(value[0] - stated[frame][0]) for frame, value in shown.items() if value]
    assert np.median(errors) < 0.1
    assert len(found["/recorded/image", "EncodedImage:blob"]) >= 12


def test_calibrate_streams_to_a_file(recording, tmp_path, monkeypatch):
    pytest.importorskip("rerun")
    leave_out(monkeypatch, "draw", "report")
    done = ospc("calibrate", recording.path, "-o", tmp_path / "out", "-q", "--rerun-file", tmp_path / "run.rrd")
    assert done.exit_code in (0, 3)
    assert len(read_back(tmp_path / "run.rrd")["/exposure/stated", "Scalars:scalars"]) == FRAMES


def test_a_missing_package_is_reported_before_the_run(recording, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    done = ospc("calibrate", str(recording.path), "-o", str(tmp_path / "out"), "--rerun")
    assert isinstance(done.exception, MissingExtraError)
    assert "rerun" in str(done.exception)
    assert not (tmp_path / "out").exists()


def test_the_error_names_a_file_that_cannot_be_written(recording, tmp_path):
    pytest.importorskip("rerun")
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(FormatError, match="cannot be written"),
        RerunStream.opened(recording, tmp_path / "file" / "run.rrd", spawn=False),
    ):
        pass
