"""Work in other processes."""

from __future__ import annotations

import os
import signal
import sys
from time import monotonic

import pytest

from ospc.system import processes
from ospc.system.processes import Worker, end, in_processes


@pytest.mark.skipif(sys.platform == "win32", reason="no signals")
def test_ctrl_c_does_not_end_a_process_that_is_still_starting():
    worker = Worker(abs)
    os.kill(worker.process.pid, signal.SIGINT)
    worker.give(-3)
    assert worker.connection.recv() == 3
    end([worker])


def test_processes_that_cannot_be_interrupted_are_ended_together(monkeypatch):
    monkeypatch.setattr(processes, "_PATIENCE_S", 1)
    results = in_processes(sum, [range(1), range(10**12), range(10**12), range(10**12)], 4, lambda *_: 0)
    assert next(results) == (range(1), 0)
    before = monotonic()
    results.close()
    assert monotonic() - before < 2.5
