"""What all tests share."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

# Workers and the processes they start share the processor: their matrices are small, and threads only get in each
# other's way. NumPy reads these when it is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import cv2
import pytest
from hypothesis import settings

import browser
from ospc.simulation import scene

cv2.setNumThreads(1)  # OpenCV reads none of these

# How long an example takes says something about the machine, not about the property; and what is tested is the same
# everywhere: to look for more, run with --hypothesis-seed and other profiles.
settings.register_profile("repeatable", deadline=None, derandomize=True, max_examples=40)
settings.load_profile("repeatable")


# Tests film the same few rooms in turn, and each takes longer to build than a short recording to film.
scene._room = lru_cache(maxsize=6)(scene._room.__wrapped__)

# Nothing that tests write has to survive a power failure, and each call waits for the disk.
os.fsync = lambda _descriptor: None

# What is imported and collected stays to the end. To look through it for garbage, again and again, takes a sixth of
# the time of all tests.
gc.disable()
gc.set_threshold(10_000)


# Each of two workers begins with half of the tests, and whoever is done takes over the last tests of the other. So
# the last ones of each half are those that share little: what they share would be made by both workers. A dot stands
# for the tests of all other folders.
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
    """Film the same room whatever the seed: it takes longer to build than most recordings of tests to film."""
    room = scene._room
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scene, "_room", lambda _seed: room(0))
        yield


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of real recordings; tests that need it skip where it is absent."""
    place = Path(os.environ.get("OSPC_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if not place.is_dir():
        pytest.skip(f"no real recordings at {place}; set OSPC_DATA to their folder")
    return place


@pytest.fixture(scope="session")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[browser.Browser]:
    """A page of a real browser; tests that need it skip where there is none."""
    program = browser.find()
    if program is None:
        pytest.skip(f"no browser of the names {', '.join(browser.NAMES)} on this machine")
    running = browser.Browser(program, tmp_path_factory.mktemp("profile"))
    yield running
    running.close()
