"""A real Dask cluster on this machine gives the same results as this process, even if workers fail."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import pytest

from batch_recordings import QUICK, simulated, variant
from ospc.batch.cluster import on_cluster
from ospc.batch.manifest import Entry
from ospc.batch.run import run_batch
from ospc.batch.work import Task, work
from ospc.errors import MissingExtraError, SettingError

pytestmark = pytest.mark.skipif(find_spec("distributed") is None, reason="Dask is not installed")

RECORDINGS, CORRUPT, MISSING, WORKERS = 16, 7, 10, 2
NO_FIT = (("min_points", "1000000"),)
"""Skips the estimation, which takes most of the time; counts, noise and coverage are still computed."""


@dataclass
class Machines:
    """A scheduler and its workers, each in its own process."""

    address: str
    folder: str
    processes: list[subprocess.Popen]

    def start(self, *arguments):
        command = [sys.executable, "-m", *arguments]
        with Path(self.folder, f"{len(self.processes)}.log").open("wb") as log:
            self.processes.append(subprocess.Popen(command, stdout=log, stderr=log, cwd=self.folder))
        return self.processes[-1]

    def start_worker(self):
        return self.start(
            "distributed.cli.dask_worker",
            self.address,
            *("--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", self.folder),
        )


@pytest.fixture(scope="module")
def machines(tmp_path_factory):
    """Start a scheduler, and stop it and its workers at the end."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    found = Machines(f"tcp://127.0.0.1:{port}", str(tmp_path_factory.mktemp("machines")), [])
    try:
        found.start(
            "distributed.cli.dask_scheduler",
            "--host",
            "127.0.0.1",
            "--port",
            str(port),
            "--no-dashboard",
            "--no-show",
        )
        yield found
    finally:
        for process in found.processes:
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def workers(machines):
    """Workers that cannot read any file while ``blind<process id>`` exists."""
    Path(machines.folder, "sitecustomize.py").write_text(
        "import os\nfrom ospc.batch import cluster\nreadable_of = cluster._readable_of\n"
        "cluster._readable_of = lambda paths: [] if os.path.exists(f'blind{os.getpid()}') else readable_of(paths)\n"
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", machines.folder, prepend=os.pathsep)
        return [machines.start_worker() for _ in range(WORKERS)]


@pytest.fixture(scope="module")
def entries(tmp_path_factory):
    """Recordings of three cameras, one of them corrupt and one missing."""
    place = tmp_path_factory.mktemp("recordings")
    originals = [simulated(place / f"original{seed}", seed) for seed in range(2)]
    found = []
    for number in range(RECORDINGS):
        recording = place / f"r{number:03}"
        if number == CORRUPT:
            shutil.copytree(originals[0], recording)
            (recording / "times.txt").write_text("0 0.0 none\n")
        elif number != MISSING:
            variant(originals[number % 2], recording, 1 + number / 100)
        found.append(Entry(str(recording), f"camera {number % 3}", QUICK if number == 0 else NO_FIT))
    return found


def test_a_scheduler_without_workers_is_reported(machines, entries):
    """This is the first test, because the others start workers."""
    deadline_s = time.monotonic() + 30
    while time.monotonic() < deadline_s:
        try:
            with pytest.raises(SettingError, match="the scheduler has no workers; start some"):
                list(on_cluster([Task(0, entries[1])], machines.address, patience_s=0.0))
            break
        except AssertionError:
            time.sleep(0.2)


def test_a_recording_goes_to_a_worker_that_can_read_it(machines, workers, entries):
    from distributed import Client

    blind, reading = workers
    mark = Path(machines.folder, f"blind{blind.pid}")
    mark.touch()
    with Client(machines.address, set_as_default=False, timeout=30) as client:
        client.wait_for_workers(WORKERS, timeout=30)
    answers = list(on_cluster((Task(n, entries[n]) for n in (1, 2, 3)), machines.address))
    assert {int(answer.worker.rsplit(":", 1)[1]) for answer in answers} == {reading.pid}
    mark.unlink()


def test_every_recording_is_done_though_one_of_two_workers_is_killed(machines, workers, entries, tmp_path):
    def killing(tasks):
        answered = []
        for answer in on_cluster(tasks, machines.address):
            yield answer
            answered.append(int(answer.worker.rsplit(":", 1)[1]))
            # Killed before its first answer was fetched, the worker would leave no result to check.
            if len(answered) >= 8 and workers[1].pid in answered and workers[1].poll() is None:
                os.kill(workers[1].pid, signal.SIGKILL)

    outcome = run_batch(entries, tmp_path / "out", killing)
    assert workers[1].poll() is not None
    assert [row.recording[-4:] for row in outcome.failed] == [f"r{CORRUPT:03}", f"r{MISSING:03}"]
    corrupt, missing = outcome.failed
    assert "times.txt" in corrupt.error
    assert "there is no such file or folder" in missing.error
    assert {row.attempts for row in outcome.failed} == {2}
    done = [row for row in outcome.rows if row.status == "done"]
    assert len(done) == RECORDINGS - 2
    assert len({row.worker for row in done}) == WORKERS
    for number, row in enumerate(outcome.rows):
        if row.status == "done":
            kept = tmp_path / "out" / "recordings" / row.key[:2] / f"{row.key}.ospc"
            assert kept.read_bytes() == work(Task(0, entries[number])).result


def test_a_missing_scheduler_is_reported(monkeypatch):
    monkeypatch.setattr("ospc.batch.cluster._CONNECT_S", 0.5)
    with pytest.raises(SettingError, match="no Dask scheduler answers there"):
        list(on_cluster([], "tcp://127.0.0.1:9"))


def test_without_dask_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtraError, match=r"ospc\[cluster\]"):
        list(on_cluster([], "tcp://127.0.0.1:9"))
