"""Kill ``ospc calibrate`` at random moments, resume it, and compare with a run that was left alone.

    python benchmarks/kill_and_resume.py --kills 50

Each run writes a checkpoint after every frame and is killed (SIGKILL) at a random moment from its first instruction
to its last file; the next goes on with --resume. After every kill the state must be readable, and when a run ends,
every file must be that of the undisturbed run, bit for bit.
"""

from __future__ import annotations

import argparse
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from ospc.calibrator import OnlineCalibrator
from ospc.simulation import SimulationSettings, simulate

PROGRAM = "from ospc.cli.main import main; main()"
SETTINGS = ("points_per_pair=100", "max_points=3000", "rounds=4")


def started(recording: Path, out: Path) -> subprocess.Popen[bytes]:
    options = [part for setting in SETTINGS for part in ("--set", setting)]
    command = ["calibrate", str(recording), "-o", str(out), *options, "--resume", "--checkpoint-every", "0", "-q"]
    return subprocess.Popen([sys.executable, "-c", PROGRAM, *command], stderr=subprocess.PIPE)


def finished(recording: Path, out: Path) -> float:
    begun_s = time.monotonic()
    process = started(recording, out)
    _, errors = process.communicate()
    if process.returncode not in (0, 3):
        sys.exit(f"failed: {errors.decode()}")
    return time.monotonic() - begun_s


def content(folder: Path) -> dict[str, bytes]:
    return {place.name: place.read_bytes() for place in sorted(folder.iterdir())}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    rng = random.Random(arguments.seed)
    with tempfile.TemporaryDirectory() as folder:
        recording, truth, out = (Path(folder) / name for name in ("recording", "truth", "out"))
        exposures = (3.0, 6.0, 12.0, 24.0)
        simulate(
            recording,
            SimulationSettings(size=(160, 120), frames=arguments.frames, exposure="cycle", exposures_ms=exposures),
        )
        duration_s = finished(recording, truth)
        expected = content(truth)
        kills = before_the_first = resumed = completed = largest = 0
        while kills < arguments.kills:
            process = started(recording, out)
            try:
                process.wait(rng.uniform(0, duration_s))
            except subprocess.TimeoutExpired:
                process.send_signal(signal.SIGKILL)
                kills += 1
            _, errors = process.communicate()
            if process.returncode not in (0, 3, -signal.SIGKILL):
                sys.exit(f"after {kills} kills it did not go on: {errors.decode()}")
            state = out / "state.ospc"
            if process.returncode == -signal.SIGKILL:
                if state.exists():
                    resumed += OnlineCalibrator.load_state(state).frames > 0
                    largest = max(largest, state.stat().st_size)
                else:
                    before_the_first += 1
                continue
            completed += compared(out, expected)
        finished(recording, out)
        completed += compared(out, expected)
    print(
        f"{kills} kills within {duration_s:.1f} s long runs, {before_the_first} before the first checkpoint; "
        f"{resumed} states read, none torn, at most {largest} bytes; {completed} runs ended, all with the bytes of "
        "the undisturbed one"
    )


def compared(out: Path, expected: dict[str, bytes]) -> int:
    found = content(out)
    different = [name for name in found.keys() | expected.keys() if found.get(name) != expected.get(name)]
    if different:
        sys.exit(f"these files are not those of the undisturbed run: {', '.join(sorted(different))}")
    shutil.rmtree(out)
    return 1


if __name__ == "__main__":
    main()
