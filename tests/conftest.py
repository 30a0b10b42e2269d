"""Settings and fixtures of all tests."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Iterator
from functools import lru_cache
from html import escape
from pathlib import Path
from weakref import ref

# Test workers and their child processes share the processor. Their matrices are small, so more threads only slow them
# down. NumPy reads these variables when it is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import cv2
import pytest
from hypothesis import settings

import browser
from ospc.arrays import Float32Array
from ospc.simulation import camera, rendering, scene
from ospc.simulation.surface import Face
from ospc.system.second_thread import SecondThread

cv2.setNumThreads(1)  # OpenCV ignores these variables

# No deadline, because the time of an example depends on the machine. Examples are the same everywhere; to try others,
# run with --hypothesis-seed and another profile.
settings.register_profile("repeatable", deadline=None, derandomize=True, max_examples=40)
settings.load_profile("repeatable")


# Tests use the same few rooms in turn, and building a room takes longer than simulating a short recording in it.
scene._room = lru_cache(maxsize=6)(scene._room.__wrapped__)

# Most tests film the same walk through the same room, and differ only in what the camera makes of its light. So what
# is seen of a room is kept as long as the room, except large images and scenes in which something moves.
_MOST_VIEWS, _WIDEST_PX = 500, 240
_VIEWS: dict[int, tuple[ref[Face], dict[tuple[object, ...], Float32Array]]] = {}


def _radiance(room: scene.Scene, view: rendering.View, time_s: float) -> Float32Array:
    if room.patches or view.size[0] > _WIDEST_PX:
        return rendering.radiance(room, view, time_s)
    wall = room.walls[0]
    number = id(wall)
    if number not in _VIEWS:
        _VIEWS[number] = ref(wall, lambda _: _VIEWS.pop(number, None)), {}
    views = _VIEWS[number][1]
    what = (room.scale, view.size, view.focal_px, view.position_m.tobytes(), view.rotation.tobytes())
    if what not in views:
        if len(views) == _MOST_VIEWS:
            views.clear()
        views[what] = rendering.radiance(room, view, time_s)
    return views[what].copy()


camera.radiance = sys.modules["ospc.simulation.truth"].radiance = _radiance

# Files written by tests need not survive a power failure, and each call waits for the disk.
os.fsync = lambda _descriptor: None

# Imported modules and collected tests stay in memory until the end. Searching them for garbage again and again takes
# a sixth of the time of all tests.
gc.disable()
gc.set_threshold(10_000)


# Each of two workers starts with half of the tests. The one that finishes first takes over the last tests of the
# other. So the last tests of each half should share little data, because both workers would have to create it. A dot
# stands for the tests of all other folders.
_FOLDERS = (
    *("accuracy", "batch", "cli", "diagnosis", "docs", "formats", "photometry", ".", "recording"),
    *("live", "methods", "pooling", "report", "research", "state", "unknown_exposures"),
    *("correspondence", "estimation", "evaluation", "simulation"),
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    place = {Path(__file__).parent / folder: number for number, folder in enumerate(_FOLDERS)}

    def of(item: pytest.Item) -> int:
        return next((place[folder] for folder in item.path.parents if folder in place), len(place))

    items.sort(key=of)


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="module")
def one_room() -> Iterator[None]:
    """Use one room for every seed, because building a room takes longer than simulating most test recordings."""
    room = scene._room
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scene, "_room", lambda _seed: room(0))
        yield


_SECOND_THREAD = SecondThread()


@pytest.fixture(scope="module", autouse=True)
def pictures() -> Iterator[None]:
    """Draw figures but do not render them, which takes far longer; tests of pictures replace this fixture.

    Commands draw in a second thread instead of a second process, which would render them.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ospc.report.charts.as_svg", lambda _figure, title: f'<svg aria-label="{escape(title)}"></svg>')
        for module in ("style", "pictures"):
            patch.setattr(f"ospc.report.{module}.as_bytes", lambda _figure, _kind: b"")
        for module in ("report.drawing", "cli.calibration_run"):
            patch.setattr(f"ospc.{module}.drawing_process", lambda: _SECOND_THREAD)
        yield


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of real recordings; tests that need it are skipped if it is missing."""
    place = Path(os.environ.get("OSPC_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if not place.is_dir():
        pytest.skip(f"no real recordings at {place}; set OSPC_DATA to their folder")
    return place


@pytest.fixture(scope="session")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[browser.Browser]:
    """A page of a real browser; tests that need it are skipped if no browser is installed."""
    program = browser.find()
    if program is None:
        pytest.skip(f"no browser of the names {', '.join(browser.NAMES)} on this machine")
    running = browser.Browser(program, tmp_path_factory.mktemp("profile"))
    yield running
    running.close()
