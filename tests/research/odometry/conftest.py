"""A recording with truth, and fake odometry programs."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from ospc.formats.opening import Photometry, open_photometry
from ospc.recording import open_recording
from ospc.research.odometry.inputs import OdometryInput, chosen, images_of
from ospc.research.odometry.program import Program
from ospc.simulation import SimulationSettings, simulate

FAKE = """#!{python}
import pathlib, random, sys, time
given = dict(a.split("=", 1) for a in sys.argv[1:])
assert pathlib.Path(given["files"]).is_dir() and pathlib.Path(given["calib"]).is_file()
for name in ("gamma", "vignette"):
    assert (name in given) == (given["mode"] == "0"), given
    assert name not in given or pathlib.Path(given[name]).is_file()
exposures = [line.split()[2] for line in open("times.txt")]
assert (len(set(exposures)) == 1) == (given["mode"] == "2")
with open({calls!r}, "a") as calls:
    calls.write(" ".join(sys.argv[1:]) + "\\n")
{behaviour}
"""

TRACK = """
noise = 0.001 if given["mode"] == "0" else 0.1
rows = [line.split() for line in open({truth!r})]
with open("result.txt", "w") as out:
    for row in rows[{part}]:
        position = [str(3 * float(x) + random.gauss(0, noise)) for x in row[1:4]]
        out.write(" ".join([row[0], *position, *row[4:]]) + "\\n")
"""


@pytest.fixture(scope="session")
def simulated(tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("odometry") / "room"
    simulate(
        place,
        SimulationSettings(
            size=(160, 120), frames=40, fps=10.0, speed=0.5, seed=3, scene_seed=0, response="tum_narrow"
        ),
    )
    return place


@pytest.fixture
def recording(simulated):
    return open_recording(simulated)


@pytest.fixture
def make_program(tmp_path, simulated):
    """Return a function that makes a program from the body of a Python script."""

    def make(behaviour: str | None = None, part: str = ":", **settings) -> Program:
        if behaviour is None:
            behaviour = TRACK.format(truth=str(simulated / "groundtruthSync.txt"), part=part)
        place = tmp_path / "fake_dso"
        calls = str(tmp_path / "calls.txt")
        place.write_text(FAKE.format(python=sys.executable, calls=calls, behaviour=behaviour))
        place.chmod(0o755)
        return Program(place, **settings)

    return make


@pytest.fixture
def source(recording, tmp_path):
    """Return a function that gives the input for a named condition."""

    def under(name: str) -> OdometryInput:
        (condition,) = chosen([name])
        photometry = open_photometry(recording.path) if condition.calibrated else Photometry("none", None, None)
        return OdometryInput.of(recording, images_of(recording, tmp_path / "images"), condition, photometry)

    return under
