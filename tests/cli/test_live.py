"""Watching a run in the terminal: what is drawn is what is known, and watching changes nothing."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from ospc import OnlineCalibrator, open_recording
from ospc.cli import pace
from ospc.cli.live import LiveView, Watching, figures
from ospc.cli.live_marks import Canvas, bars, falling
from ospc.cli.pace import Pace
from ospc.cli.progress import ProgressLine
from ospc.simulation import SimulationSettings, simulate


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    place = tmp_path_factory.mktemp("simulated") / "r"
    settings = SimulationSettings(size=(160, 120), frames=24, exposure="sweep", exposure_min_ms=3, exposure_max_ms=12)
    simulate(place, settings)
    return open_recording(place)


@pytest.fixture
def terminal():
    return Console(file=io.StringIO(), width=80, height=30, force_terminal=True, color_system=None)


@given(st.lists(st.integers(0, 10**7), min_size=1, max_size=40))
def test_bars_grow_with_the_counts_and_mark_what_was_never_seen(counts):
    drawn = bars(np.array(counts))
    assert len(drawn) == len(counts)
    assert [mark == "·" for mark in drawn] == [count == 0 for count in counts]
    order = sorted((count, mark) for count, mark in zip(counts, drawn, strict=True) if count)
    assert [mark for _, mark in order] == sorted(mark for _, mark in order)


@given(st.lists(st.floats(1e-6, 1e3), max_size=50), st.integers(1, 30))
def test_convergence_is_drawn_from_the_latest_values(values, most):
    drawn = falling(values, most)
    assert len(drawn) == min(len(values), most)
    if len(drawn) > 1 and np.ptp(np.log(values[-most:])) > 0.1:
        assert drawn[int(np.argmin(values[-most:]))] == "▁"
        assert drawn[int(np.argmax(values[-most:]))] == "█"


@given(st.lists(st.floats(-2, 3), min_size=2, max_size=60), st.integers(2, 40), st.integers(1, 12))
def test_curves_stay_in_their_frame(heights, columns, rows):
    canvas = Canvas(columns, rows)
    canvas.line(np.array(heights), "red")
    lines = canvas.text().plain.split("\n")
    assert len(lines) == rows
    assert {len(line) for line in lines} == {columns}


def test_a_curve_is_where_its_values_are():
    canvas = Canvas(10, 4)
    canvas.line(np.array([0.0, 1.0]), "red")
    lines = canvas.text().plain.split("\n")
    empty = "\u2800"
    assert lines[0][-1] != empty
    assert lines[-1][0] != empty
    assert lines[0][0] == lines[-1][-1] == empty


def test_the_view_fits_the_terminal_and_shows_everything(recording, terminal):
    calibrator, view = OnlineCalibrator(), LiveView(len(recording))
    line = ProgressLine(terminal)
    terminal.print(view.picture(line.bar, calibrator.preview(), terminal.width))
    for frame in recording:
        calibrator.push(frame)
    line.show("comparing", len(recording), len(recording), figures(calibrator.status))
    terminal.print(view.picture(line.bar, calibrator.preview(), terminal.width))
    shown = terminal.file.getvalue()
    assert max(len(line) for line in shown.splitlines()) <= 80
    for part in (
        "nothing was compared yet",
        "24/24",
        "pairs",
        "grey levels",
        "exposures",
        "radii",
        "g(M)",
        "V(R)",
        "±",
    ):
        assert part in shown


def test_a_stage_of_unknown_length_shows_no_full_bar(terminal):
    line = ProgressLine(terminal)
    line.show("comparing", 24, 24)
    line.show("estimating", 0, 0)
    assert line.bar.tasks[0].total is None
    terminal.print(line.bar)
    assert "24/24" not in terminal.file.getvalue()
    line.show("comparing", 6, 24)
    assert (line.bar.tasks[0].completed, line.bar.tasks[0].total) == (6, 24)


def test_watching_changes_nothing(recording, terminal):
    watched, alone = OnlineCalibrator(), OnlineCalibrator()
    with LiveView(len(recording), terminal, Pace(0.0, 1.0)).shown() as show:
        for frame in recording:
            watched.push(frame)
            show(watched, "comparing", frame)
            alone.push(frame)
        show(watched, "estimating", None)
    assert watched.calibration().as_dict() == alone.calibration().as_dict()
    assert "estimating" in terminal.file.getvalue()


def test_nobody_looking_costs_nothing(recording):
    with Watching().of(recording) as tell:
        tell(None, "comparing", None)  # not even asked


def test_looks_are_rare_where_they_take_long(monkeypatch):
    now_s = [100.0]
    monkeypatch.setattr(pace.time, "monotonic", lambda: now_s[0])
    waiting = Pace(0.5, 0.1)
    assert waiting.due
    with waiting.look():
        now_s[0] += 1.0
    now_s[0] += 9.9
    assert not waiting.due
    now_s[0] += 0.2
    assert waiting.due
    with waiting.look():
        pass
    assert not waiting.due
    now_s[0] += 0.6
    assert waiting.due


def test_small_spreads_are_not_rounded_to_nothing(recording):
    status = OnlineCalibrator().status
    progress = replace(status.progress, pairs=3, response_sigma=0.00042, vignette_sigma=0.0123456)
    assert figures(replace(status, progress=progress)) == "3 pairs  g ±0.00042  V ±0.012"
