"""Whatever a file contains, it is read or refused with one of the library's own errors."""

from __future__ import annotations

import contextlib
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ospc.errors import OspcError
from ospc.evaluation.trajectory import read_trajectory
from ospc.formats.export import export
from ospc.formats.opening import Photometry, open_photometry
from ospc.formats.radial import Optics
from ospc.formats.validation import repair, validate
from ospc.photometry.response import Response
from ospc.photometry.vignette import PolynomialVignette

PARAMETER_FILES = ("pcalib.txt", "vignette.png", "times.txt", "camera.txt")
TEXTS = {
    "times.txt": b"0 0.1 1\n1 0.2 2\n2 0.3 3\n",
    "camera.txt": b"0.5 0.6 0.5 0.5 0.9\n640 480\ncrop\n640 480\n",
    "poses.txt": b"1 2 3 4 0 0 0 1\n" * 4,
}


@pytest.fixture(scope="module")
def originals(tmp_path_factory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("originals")
    known = Photometry("known", Response.gamma(2.0), PolynomialVignette((16, 12), (-0.3, 0.1, 0.0)))
    optics = Optics(focal_mm=4, crop_factor=5, aperture=2)
    names = {"dso": "dso", "hugin": "a.pto", "opencv": "a.yml", "adobe": "a.lcp", "lensfun": "a.xml"}
    files = [path for program, name in names.items() for path in export(known, program, folder / name, optics).files]
    return TEXTS | {path.name: path.read_bytes() for path in files}


def read(place: Path) -> None:
    if place.name in PARAMETER_FILES:
        for program in ("dso", "mono"):
            checked = validate([place], program)
            proposed = any("--repair" in finding.remedy for finding in checked.findings)
            try:
                repaired = repair(checked.files[0], program)
            except OspcError:
                assert not proposed
                raise
            assert bool(repaired.changes) == proposed
            assert not repaired.changes or validate([repaired.path], program).valid
            assert repaired.changes or checked.valid
    if place.name == "poses.txt":
        read_trajectory(place)
    elif place.name not in ("times.txt", "camera.txt"):
        open_photometry(place, (16, 12))


edits = st.lists(
    st.tuples(
        st.floats(0, 1),
        st.integers(0, 40),
        st.one_of(
            st.binary(max_size=6), st.sampled_from([b"nan", b"-", b"1e999", b" ", b"\n", b"9" * 20, b"<", b"[", b"0"])
        ),
    ),
    min_size=1,
    max_size=4,
)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_files_are_read_or_refused(originals, tmp_path, data):
    name = data.draw(st.sampled_from(sorted(originals)))
    content = originals[name]
    for where, length, insertion in data.draw(edits):
        start = int(where * len(content))
        content = content[:start] + insertion + content[start + length :]
    place = tmp_path / name
    place.write_bytes(content)
    with contextlib.suppress(OspcError):
        read(place)
