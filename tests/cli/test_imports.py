"""Commands import only what they need, to save time and memory."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from ospc.simulation import SimulationSettings, simulate


def imported(program: str, *names: str, exit_code: int = 0) -> list[str]:
    """Run a program in a new interpreter; return which of the named modules it has loaded."""
    ask = f"import sys; print('imported', *[name for name in {names!r} if name in sys.modules])"
    script = f"try:\n {program}\nfinally:\n {ask}"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == exit_code, done.stderr
    return done.stdout.splitlines()[-1].split()[1:]


def test_a_missing_recording_is_refused_before_heavy_imports(tmp_path: Path) -> None:
    words = ["ospc", "calibrate", str(tmp_path / "missing"), "-o", str(tmp_path / "out")]
    program = f"import sys; sys.argv = {words!r}; from ospc.cli.main import main; main()"
    names = ("scipy", "matplotlib", "rich", "ospc.engine.engine", "ospc.estimation", "ospc.report", "ospc.recording")
    assert imported(program, *names, exit_code=1) == ["ospc.recording"]


def test_a_default_calibration_does_not_import_scipy(tmp_path: Path) -> None:
    recording = tmp_path / "recording"
    simulate(recording, SimulationSettings(size=(160, 120), frames=24, exposure="sweep", speed=2.0))
    program = f"import ospc; assert ospc.calibrate({str(recording)!r}).vignette is not None"
    names = ("scipy.linalg", "scipy.ndimage", "scipy.optimize", "scipy.special", "ospc.estimation.fit")
    assert imported(program, *names) == ["ospc.estimation.fit"]
