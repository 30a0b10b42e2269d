"""Work in other processes."""

from __future__ import annotations

import os
import signal
import sys

import pytest

from ospc.system.processes import Worker


@pytest.mark.skipif(sys.platform == "win32", reason="no signals")
def test_ctrl_c_does_not_end_a_process_that_is_still_starting():
    worker = Worker(abs)
    os.kill(worker.process.pid, signal.SIGINT)
    worker.give(-3)
    assert worker.connection.recv() == 3
    worker.end(at_once=False)
