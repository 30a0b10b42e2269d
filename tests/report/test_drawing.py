"""Drawing in a process of its own gives what drawing here gives, whatever happens to that process."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import pytest

from calibrations import calibration
from ospc.report import drawing
from ospc.report.charts import Findings
from ospc.report.drawing import DrawingProcess, drawings_of


@pytest.fixture(scope="module")
def process():
    return DrawingProcess()


def test_the_process_draws_the_same_and_elsewhere(process):
    findings = Findings(calibration())
    drawn, place = process.submit(drawings_of, findings), process.submit(os.getpid)
    assert drawn.result() == drawings_of(findings)
    assert place.result() not in {os.getpid()}


def test_what_prints_there_does_not_disturb_results(process):
    assert process.submit(print, "among the results").result() is None
    assert process.submit(abs, -3).result() == 3


def test_what_cannot_be_sent_is_done_here(process):
    here = []
    assert process.submit(lambda: here.append(1)).result() is None
    assert here == [1]


def test_an_error_there_is_the_error_here():
    with pytest.raises(ZeroDivisionError):
        DrawingProcess().submit(divmod, 1, 0).result()


def test_a_process_that_dies_costs_nothing_but_time():
    dying = DrawingProcess()
    assert dying.submit(os.getpid).result() != os.getpid()
    dying._process.kill()
    assert dying.submit(os.getpid).result() == os.getpid()


def test_where_no_process_can_be_started_all_is_done_here(monkeypatch):
    monkeypatch.setattr(drawing.sys, "executable", "/nowhere/python")
    without = DrawingProcess()
    assert without.submit(os.getpid).result() == os.getpid()
    assert without.submit(threading.get_ident).result() != threading.get_ident()


@pytest.mark.parametrize("rest", [b"", b"cut off"])
def test_the_process_ends_with_its_input_as_when_the_one_that_started_it_is_killed(rest):
    program = [sys.executable, "-c", "from ospc.report.drawing import serve; serve()"]
    assert subprocess.run(program, input=rest, capture_output=True, timeout=60, check=True).stdout == b""
