"""A guided capture in a real browser: bars fill, the instruction changes, and the saved result is the calibration."""

from __future__ import annotations

import json
import queue
import threading
import time

import pytest

from browser import CUT_OFF
from command_line import leave_out, ospc
from ospc.simulation import SimulationSettings, simulate

pytest.importorskip("websockets")

STATE = """JSON.stringify({
  text: document.getElementById('instruction').textContent,
  bars: [...document.querySelectorAll('progress')].map(bar => bar.value),
  pictures: Number(document.getElementById('picture').dataset.shown || 0),
  state: document.getElementById('state').textContent,
})"""


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    place = tmp_path_factory.mktemp("simulated") / "r"
    simulate(place, SimulationSettings(size=(256, 192), frames=50, seed=3, response="srgb"))
    return place


@pytest.fixture
def live(monkeypatch, recording, tmp_path):
    """Return a function that starts the command and returns the page's address and a wait for the outcome."""
    # Plots and reports take most of the time and have their own tests.
    leave_out(monkeypatch, "draw", "report")
    addresses = queue.Queue()
    monkeypatch.setattr("click.launch", addresses.put)
    outcomes = []

    def start(*options):
        words = ("live", recording, "-o", tmp_path / "live", "--goal", "0", *options)
        running = threading.Thread(target=lambda: outcomes.append(ospc(*words)))
        running.start()

        def ended():
            running.join(30)
            return outcomes[0]

        return addresses.get(timeout=20), ended

    return start


def watched(chromium, until):
    """Return the states of the page until it shows a text."""
    seen, end_s = [], time.monotonic() + 40
    while not seen or until not in seen[-1]["text"]:
        assert time.monotonic() < end_s, seen[-1:]
        seen.append(json.loads(chromium.value(STATE)))
        time.sleep(0.05)
    return seen


def test_bars_fill_instructions_change_and_the_result_is_that_of_the_command(live, chromium, recording, tmp_path):
    url, ended = live()
    chromium.show(url, 1400)
    seen = watched(chromium, "Written to")
    outcome = ended()
    assert outcome.exit_code in (0, 3), outcome.output
    first, last = seen[0], seen[-1]
    assert all(after >= before for before, after in zip(first["bars"], last["bars"], strict=True))
    assert sum(last["bars"]) > sum(first["bars"]) + 1
    assert len({moment["text"] for moment in seen[:-1] if moment["text"]}) >= 3
    assert last["pictures"] > 5
    assert chromium.complaints() == []
    assert all(asked.startswith(url) for asked in chromium.requests())
    assert ospc("calibrate", recording, "-o", tmp_path / "command", "-q").exit_code == outcome.exit_code
    names = {file.name for file in (tmp_path / "command").iterdir()}
    assert {file.name for file in (tmp_path / "live").iterdir()} == names
    for name in ("calibration.json", "pcalib.txt", "vignette.png", "times.txt", "state.ospc"):
        assert (tmp_path / "live" / name).read_bytes() == (tmp_path / "command" / name).read_bytes(), name


def test_the_button_ends_it_and_nothing_is_cut_off(live, chromium, tmp_path):
    url, ended = live("--pace", "0.5")
    chromium.show(url, 420, "dark")
    watched(chromium, "Film")
    assert chromium.value(CUT_OFF) == []
    chromium.value("document.getElementById('finish').click()")
    watched(chromium, "Written to")
    assert chromium.value("document.getElementById('finish').disabled")
    assert ended().exit_code == 3
    known = json.loads((tmp_path / "live" / "calibration.json").read_text())
    assert 0 < known["counts"]["frames"] < 50
    assert chromium.complaints() == []
