"""Drawing in a second process gives the same result as drawing here, whatever happens to that process."""

from __future__ import annotations

import os
import threading

import pytest

from calibrations import calibration
from ospc.report import drawing
from ospc.report.charts import ReportFindings
from ospc.report.drawing import DrawingProcess
from ospc.report.pictures import drawings_of


@pytest.fixture(scope="module")
def process():
    return DrawingProcess()


def test_the_process_draws_the_same_in_another_process(process):
    findings = ReportFindings(calibration())
    drawn, place = process.submit(drawings_of, findings), process.submit(os.getpid)
    assert drawn.result() == drawings_of(findings)
    assert place.result() not in {os.getpid()}


def test_printing_in_the_process_does_not_disturb_results(process):
    assert process.submit(print, "among the results").result() is None
    assert process.submit(abs, -3).result() == 3


def test_functions_that_cannot_be_sent_run_in_this_process(process):
    here = []
    assert process.submit(lambda: here.append(1)).result() is None
    assert here == [1]


def test_errors_in_the_process_are_raised_here():
    with pytest.raises(ZeroDivisionError):
        DrawingProcess().submit(divmod, 1, 0).result()


def test_work_continues_here_if_the_process_dies():
    dying = DrawingProcess()
    assert dying.submit(os.getpid).result() != os.getpid()
    dying._worker.process.kill()
    assert dying.submit(os.getpid).result() == os.getpid()


def test_work_runs_here_if_no_process_can_be_started(monkeypatch):
    def refused(_function):
        raise OSError

    monkeypatch.setattr(drawing, "Worker", refused)
    without = DrawingProcess()
    assert without.submit(os.getpid).result() == os.getpid()
    assert without.submit(threading.get_ident).result() != threading.get_ident()
