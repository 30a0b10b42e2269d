"""Commands with a memory limit (``ulimit -v``)."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

resource = pytest.importorskip("resource", reason="needs limits of memory")

PROGRAM = "from ospc.cli.main import main; main()"


def limited(mebibytes, *command):
    """Run Python code with a memory limit."""
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    return subprocess.run(
        [sys.executable, "-c", *command],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (mebibytes * 2**20,) * 2),
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.mark.parametrize("mebibytes", [320, 500, 620])
def test_too_little_memory_is_refused_before_libraries_fail(mebibytes, tmp_path):
    result = limited(mebibytes, PROGRAM, "simulate", tmp_path / "recording", "--frames", "5")
    said = f"{mebibytes} MiB of memory is too little; allow at least 1024 MiB (ulimit -v)"
    assert (result.returncode, result.stderr) == (1, f"ospc: error: {said}\n")


def test_with_a_limit_openblas_uses_memory_for_one_thread():
    ask = "from threadpoolctl import threadpool_info; print({pool['num_threads'] for pool in threadpool_info()})"
    result = limited(3000, f"try:\n {PROGRAM}\nfinally:\n import numpy, scipy.linalg; {ask}", "compare", "a", "b")
    assert result.stdout == "{1}\n", result.stderr
